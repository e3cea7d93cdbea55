"""A robot that finds itself inside as its job starts, as after a restart."""

from coord_harness import Air, Model, ms


def passages(loss: float, way: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return start and end of robot 1, which begins inside at 100 ms, and of robot 2, which asks then for `way`."""
    model = Model(1, 2, Air(loss=loss))
    model.trigger(ms(100), 1, deadline=ms(20_000), inside=True)
    model.trigger(ms(100), 2, deadline=ms(20_000), way=way)
    model.run(ms(200))
    model.run_until(model.all_served, ms(60_000))
    by_robot = {entry.robot: (entry.start, entry.end) for entry in model.entries}
    return by_robot[1], by_robot[2]


def test_it_is_inside_at_once_without_a_slot() -> None:
    (start, end), _ = passages(0.0, 1)
    assert start == ms(100)
    assert end > start


def test_who_comes_towards_it_waits_until_it_is_out() -> None:
    for loss in (0.0, 0.2):
        (_, out), (entry, _) = passages(loss, 1)
        assert entry >= out


def test_who_goes_the_same_way_follows_by_a_headway() -> None:
    (start, out), (entry, _) = passages(0.0, 0)
    assert start + ms(950) <= entry < out
