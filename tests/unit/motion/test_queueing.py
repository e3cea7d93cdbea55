"""Waiting in the gate's queue behind those that go first."""

from math import inf, pi

import bench
import pytest

from rmr.base.geometry import Point, Pose, distance, point_segment_distance
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.priority import Heard
from rmr.node.motion.queueing import APART_M, REACH_M, room_for_first, waits_in_queue
from rmr.node.motion.route import leader_route

ARENA = bench.corridor()
GATE = ARENA.area("entry").places[0]
FIRST = Point(GATE.x - 0.2, GATE.y)
SECOND = Point(GATE.x - 0.4, GATE.y)
RADIUS = ARENA.shape.radius
ROUTE = leader_route(ARENA, SECOND, ARENA.area("exit").places[0], (), through_gate=True)
assert ROUTE is not None
HOLD_M = EntryGate(ARENA.shape, holding=False).hold_line_m(ROUTE)


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


def heard(x: float, y: float) -> Heard:
    return Heard(3, Pose(x, y, pi / 2), None, 1, 0)


def test_a_robot_leaves_one_that_comes_to_the_gate_from_beside_it_its_way():
    other = heard(GATE.x - 0.02, GATE.y - 0.18)
    at = room_for_first(ROUTE, 0.0, HOLD_M, ARENA.shape, [other])
    assert 0.1 < at < HOLD_M
    keeps = point_segment_distance(*ROUTE.point(at), other.pose.x, other.pose.y, *GATE)
    assert 2.0 * RADIUS + APART_M <= keeps < 2.0 * RADIUS + APART_M + 0.02


@pytest.mark.parametrize(
    "other",
    [
        (GATE.x - 0.15, GATE.y + 0.03),  # on the own way: it is followed
        (GATE.x + 0.2, GATE.y - 0.05),  # it has entered
        (GATE.x - 0.3, GATE.y - 0.6),  # not yet near
    ],
)
def test_it_drives_up_to_the_hold_line_behind_others(other: tuple[float, float]):
    assert room_for_first(ROUTE, 0.0, HOLD_M, ARENA.shape, [heard(*other)]) == inf


def test_one_that_stands_in_the_way_already_stays():
    s = HOLD_M - 0.02
    assert distance(*ROUTE.point(s), *GATE) < 2.0 * RADIUS
    assert room_for_first(ROUTE, s, HOLD_M, ARENA.shape, [heard(GATE.x - 0.02, GATE.y - 0.18)]) == s
