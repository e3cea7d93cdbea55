"""Where the radio leaves less room in a frame, a node's frames are shorter and say as much."""

import flock
import pytest
from flock import Flock

TURNS = """
type waits(robot, float).
type hello(robot, string).
type action pass(R: robot) -o through(R).
type action complain(robot).
arrived(R).
arrived(R) -o waits(R, 60.0), pass(R).
pass_all: assert(waits(R, D), through(R), D, complain(R)).
through(R), R = @1 -o hello(@2, "%s").
"""


@pytest.mark.parametrize("room", [116, 95])
def test_ten_robots_take_turns_and_tell_long_texts_in_frames_of_any_length(monkeypatch, room):
    monkeypatch.setattr(flock._Robot, "payload_max", room)
    sizes = {}

    def measure(now, source, target, payload):
        sizes[payload[0]] = max(sizes.get(payload[0], 0), len(payload))
        return True

    robots = Flock(TURNS % ("word " * 100), robots=10, passes=measure, action_s=0.1).run(60)
    passed = [at for robot in range(1, 11) for at, _ in robots.node(robot).services.action_log]
    assert len(passed) == 10
    assert f'hello(@2, "{"word " * 100}")' in robots.facts(2)
    assert all(size <= room for size in sizes.values())
    schedule, fragment = sizes[0x02], sizes[0x12]
    assert schedule == 24 + 9 * ((room - 24) // 9)
    assert fragment == room
