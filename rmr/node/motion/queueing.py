"""Waiting before the gate for those that go first: in the places of the queue, or on their way from beside."""

from collections.abc import Sequence
from math import cos, inf, sin
from typing import Final

from rmr.base.arena import Arena, RobotShape
from rmr.base.geometry import Point, Pose, distance, point_segment_distance
from rmr.base.motion_scale import scale_of
from rmr.node.motion.priority import Heard
from rmr.node.motion.route import Route, off_queue

REACH_M: Final = 0.3
"""A waiting robot keeps the one behind it waiting if it is this near, times the size of the robots."""
BESIDE_RADII: Final = 8.0
"""One that goes first is left its way to the gate from no farther than this."""
APART_M: Final = 0.03
"""What is left between the hulls of the two there, times the size: the way of the first one is not quite straight."""
STEP_M: Final = 0.01
"""How closely the own way is looked at, times the size."""


def queue_reach(shape: RobotShape) -> float:
    """Return how near a waiting robot is that keeps the one behind it waiting, metres."""
    return REACH_M * scale_of(shape).size


def waits_in_queue(arena: Arena, at: Point, parked: Sequence[Point]) -> bool:
    """Return whether one of `parked` that goes first stands before a robot `at` a place on its way to the gate."""
    x = at.x
    y = at.y
    reach = queue_reach(arena.shape)
    near = [p for p in parked if abs(p.x - x) < reach and abs(p.y - y) < reach and distance(*p, x, y) < reach]
    return bool(near) and len(off_queue(arena, at, near)) < len(near)


def room_for_first(route: Route, s: float, hold_m: float, shape: RobotShape, first: Sequence[Heard]) -> float:
    """Return the arc length at which a robot at `s` waits for those that go `first`, metres; infinite if for none.

    At its hold line, `hold_m`, it would stand in the way of one that comes to the gate from beside it. One that drives
    on its own way it follows. Where others come out, the hold line is far enough from the mouth.
    """
    reach = BESIDE_RADII * shape.radius
    if route.gate_m is None or route.room_m > 0.0 or hold_m - s > reach:
        return inf
    here = route.point(s)
    mouth = route.mouth
    beside = [
        other.pose
        for other in first
        if _is_before(other.pose, mouth, reach)
        and point_segment_distance(other.pose.x, other.pose.y, *here, mouth.x, mouth.y) >= shape.radius
    ]
    if not beside:
        return inf
    size = scale_of(shape).size
    keep = 2.0 * shape.radius + APART_M * size
    at = s
    while at < hold_m:
        ahead = at + STEP_M * size
        x, y = route.place(ahead)
        if any(point_segment_distance(x, y, pose.x, pose.y, mouth.x, mouth.y) < keep for pose in beside):
            return at
        at = ahead
    return inf


def _is_before(pose: Pose, mouth: Pose, reach: float) -> bool:
    """Return whether a robot at `pose` is within `reach` of a `mouth` by which it has not entered."""
    dx = pose.x - mouth.x
    dy = pose.y - mouth.y
    return distance(pose.x, pose.y, mouth.x, mouth.y) <= reach and dx * cos(mouth.theta) + dy * sin(mouth.theta) <= 0.0
