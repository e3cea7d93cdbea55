"""Waiting behind others in the gate's queue: those that stand before this robot there go first."""

from collections.abc import Sequence
from typing import Final

from rmr.base.arena import Arena, RobotShape
from rmr.base.geometry import Point, distance
from rmr.base.motion_scale import scale_of
from rmr.node.motion.route import off_queue

REACH_M: Final = 0.3
"""A waiting robot keeps the one behind it waiting if it is this near, times the size of the robots."""


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
