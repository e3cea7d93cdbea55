"""Waiting in the gate's queue behind those that go first."""

import bench
import pytest

from rmr.base.geometry import Point
from rmr.node.motion.queueing import REACH_M, waits_in_queue

ARENA = bench.corridor()
GATE = ARENA.area("entry").places[0]
FIRST = Point(GATE.x - 0.2, GATE.y)
SECOND = Point(GATE.x - 0.4, GATE.y)


def test_a_robot_waits_for_the_one_that_stands_before_it_in_the_queue():
    assert waits_in_queue(ARENA, SECOND, [FIRST])


@pytest.mark.parametrize(
    "other",
    [
        Point(SECOND.x - 0.2, SECOND.y),  # behind it
        Point(SECOND.x, SECOND.y + 0.2),  # beside the queue
        Point(GATE.x, GATE.y),  # too far ahead to keep it waiting
    ],
)
def test_it_waits_for_no_other(other: Point):
    assert abs(GATE.x - SECOND.x) > REACH_M
    assert not waits_in_queue(ARENA, SECOND, [other])
