"""Where the radio secures frames they are shorter: schedules and paths take more of them and mean the same."""

import pytest
from coord_harness import EVENT, Air, Model, ms

from rmr.base.grid_path import GridPath
from rmr.coord.events import PathReceived
from rmr.coord.messages import Sched, decode
from rmr.coord.timing import Timing


@pytest.mark.parametrize(("limit", "parts"), [(107, 2), (95, 3)])
def test_a_schedule_of_several_short_parts_gives_every_robot_a_rank_of_its_own(limit: int, parts: int) -> None:
    seen: list[int] = []

    def measure(source: int, target: int, payload: bytes, now: int) -> bool:
        message = decode(payload, limit)
        seen.append(message.parts if isinstance(message, Sched) else 0)
        return True

    model = Model(3, 15, Air(filter=measure), Timing(payload_max=limit))
    for robot in model.ids:
        model.trigger(ms(robot), robot, deadline=ms(60_000 + 1000 * robot))
    assert model.run_until(model.all_slotted, ms(10_000))
    slots = [mind.slot.rank for mind in model.minds.values()]
    assert sorted(slots) == list(range(1, 16)), "as each reads it in the parts of the schedule"
    model.run(ms(90_000))
    assert model.violations == []
    assert sorted(entry.rank for entry in model.entries) == list(range(1, 16))
    assert max(seen) == parts


def test_a_path_of_several_short_frames_arrives_whole() -> None:
    model = Model(4, 3, timing=Timing(payload_max=95))
    for robot in model.ids:
        model.trigger(ms(robot), robot, deadline=ms(60_000))
    model.run(ms(2000))
    (leader,) = model.leaders()
    path = GridPath((2, 15), tuple([0] * 300 + [7] * 100))
    model.minds[leader].core.offer_path(model.now, EVENT, 0, path)
    model.settle(model.minds[leader])
    model.run(ms(3000))
    got = {r: [e.path for _, e in model.minds[r].log if isinstance(e, PathReceived)] for r in model.ids}
    assert got == {robot: [] if robot == leader else [path] for robot in model.ids}
