"""Where the radio secures frames they are shorter: schedules and paths take more of them and mean the same."""

import pytest
from coord_harness import Air, Model, ms

from rmr.coord.messages import Sched, decode
from rmr.coord.values import Values


@pytest.mark.parametrize(("limit", "parts"), [(116, 2), (107, 2), (103, 2), (95, 3)])
def test_a_schedule_of_several_short_parts_gives_every_robot_a_rank_of_its_own(limit: int, parts: int) -> None:
    seen: list[int] = []

    def measure(source: int, target: int, payload: bytes, now: int) -> bool:
        message = decode(payload, limit)
        seen.append(message.parts if isinstance(message, Sched) else 0)
        return True

    model = Model(3, 15, Air(filter=measure), Values(payload_max=limit))
    for robot in model.ids:
        model.trigger(ms(robot), robot, deadline=ms(60_000 + 1000 * robot))
    model.run(ms(90_000))
    assert model.violations == []
    assert sorted(entry.rank for entry in model.entries) == list(range(1, 16))
    assert max(seen) == parts
