"""Waiting behind others in the gate's queue: those that stand before this robot there go first."""

from collections.abc import Sequence
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance
from rmr.node.motion.route import off_queue

REACH_M: Final = 0.3
"""A waiting robot keeps the one behind it waiting if it is this near."""


def waits_in_queue(arena: Arena, at: Point, parked: Sequence[Point]) -> bool:
    """Return whether one of `parked` that goes first stands before a robot `at` a place on its way to the gate."""
    x = at.x
    y = at.y
    near = [p for p in parked if abs(p.x - x) < REACH_M and abs(p.y - y) < REACH_M and distance(*p, x, y) < REACH_M]
    return bool(near) and len(off_queue(arena, at, near)) < len(near)
