"""A robot that finds itself inside as its job starts, as after a restart."""

from coord_harness import EVENT, Air, Model, ms

from rmr.coord.messages import Beacon, decode


def passages(loss: float, direction: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return start and end of robot 1, which begins inside at 100 ms, and of robot 2, which asks then for `way`."""
    model = Model(1, 2, Air(loss=loss))
    model.trigger(ms(100), 1, deadline=ms(20_000), inside=True)
    model.trigger(ms(100), 2, deadline=ms(20_000), direction=direction)
    model.run(ms(200))
    model.run_until(model.all_served, ms(60_000))
    by_robot = {entry.robot: (entry.start, entry.end) for entry in model.entries}
    return by_robot[1], by_robot[2]


def test_robot_already_inside_is_registered_without_a_slot() -> None:
    (start, end), _ = passages(0.0, 1)
    assert start == ms(100)
    assert end > start


def test_opposed_robot_waits_until_the_one_inside_is_out() -> None:
    for loss in (0.0, 0.2):
        (_, out), (entry, _) = passages(loss, 1)
        assert entry >= out


def test_robot_of_the_same_direction_follows_by_a_headway() -> None:
    (start, out), (entry, _) = passages(0.0, 0)
    assert start + ms(950) <= entry < out


def test_robot_that_knows_it_from_the_schedule_only_follows_by_a_headway() -> None:
    model = Model(1, 3)
    model.trigger(0, 3, deadline=ms(10_000))
    model.trigger(ms(100), 2, deadline=ms(20_000))
    model.run_until(lambda: model.now > ms(101) and model.all_slotted(), ms(2000))
    job = model.minds[2].core.job(EVENT)
    assert job is not None
    assert job.slot is not None
    begins = job.slot[0] - ms(300)  # the slot of 2 stands, it is frozen

    def deaf(source: int, target: int, payload: bytes, now: int) -> bool:
        return not (source == 1 and target == 2 and isinstance(decode(payload), Beacon))

    model.air.filter = deaf
    model.trigger(begins, 1, deadline=ms(20_000), inside=True)
    model.run(begins)
    assert model.run_until(model.all_served, ms(60_000))
    starts = {entry.robot: entry.start for entry in model.entries}
    assert starts[1] == begins
    assert starts[2] >= begins + ms(950)
