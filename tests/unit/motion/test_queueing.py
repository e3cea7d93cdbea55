"""Waiting in the gate's queue behind those that go first, but not for ever."""

import bench
import pytest

from rmr.base.geometry import Point, Pose
from rmr.base.time import Instant, seconds
from rmr.node.motion.follow import STILL
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.queueing import OVERTAKE, REACH_M, Queueing

ARENA = bench.corridor()
GATE = ARENA.area("entry").places[0]
OPENS: Instant = seconds(10)
FIRST = Point(GATE.x - 0.2, GATE.y)
SECOND = Point(GATE.x - 0.4, GATE.y)


def waits(queue: Queueing, now: Instant, *parked: Point) -> bool:
    return queue.waits(now, ARENA, SECOND, parked, OPENS)


def test_a_robot_waits_for_the_one_that_stands_before_it_in_the_queue():
    assert waits(Queueing(), 0, FIRST)


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
    assert not waits(Queueing(), 0, other)


def test_it_overtakes_one_that_still_stands_there_long_after_its_own_slot_has_begun():
    queue = Queueing()
    for now in (0, OPENS, OPENS + seconds(0.1), OPENS + OVERTAKE):
        assert waits(queue, now, FIRST)
        assert not queue.late
    waits(queue, OPENS + OVERTAKE + seconds(0.2), FIRST)
    assert queue.late


def test_one_that_leaves_in_between_is_waited_for_anew():
    queue = Queueing()
    assert waits(queue, OPENS + seconds(0.1), FIRST)
    assert not waits(queue, OPENS + seconds(3))
    assert waits(queue, OPENS + seconds(3.1), FIRST)
    waits(queue, OPENS + OVERTAKE + seconds(0.2), FIRST)
    assert not queue.late


def test_who_may_enter_drives_around_one_that_still_stands_before_it():
    navigator, now = Navigator(ARENA, 1), 0
    at = Pose(SECOND.x, SECOND.y, 0.0)
    navigator.go(now, at, Point(2.6, 1.35), parked=[FIRST], through_gate=True)
    navigator.gate(None, opened=True)
    left_at = None
    while now < 2 * OVERTAKE and left_at is None:
        now += seconds(1 / 60)
        twist = navigator.step(now, at, 0.003, [], bumped=False)
        left_at = None if twist == STILL else now
    assert left_at == pytest.approx(OVERTAKE, abs=seconds(0.1))
