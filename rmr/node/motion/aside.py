"""Make room: where a robot steps aside to when another one stands on its goal and wants to get past it.

Two robots that want each other's places are in a stand-off without a way around: each goal is occupied until the other
has left. Each then drives a little to its right, and comes back when the other has had time to pass. On their
right hand both leave the line between them on different sides.
"""

import math
from collections.abc import Sequence

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance
from rmr.base.time import Duration, seconds
from rmr.node.motion.grid import MARGIN_M, segment_clearance

ASIDE_S: Duration = seconds(4)
"""How long a robot stays aside at most, the way there included."""
ASIDE_RADII = 4.0
"""How far aside: two hulls and as much room between them."""
ANGLES = (-90, -135, -45, 90, 135, 45, 180)
"""Degrees from the way to the goal, to the right first."""


def aside(arena: Arena, start: Point, goal: Point, others: Sequence[Point]) -> Point | None:
    """Return where to step aside from `start` on the way to `goal`, clear of `others`; None where there is no room."""
    radius = arena.shape.radius
    ahead, away = math.atan2(goal.y - start.y, goal.x - start.x), ASIDE_RADII * radius
    for degrees in ANGLES:
        turn = ahead + math.radians(degrees)
        spot = Point(start.x + away * math.cos(turn), start.y + away * math.sin(turn))
        free = all(distance(*spot, *other) > 2.0 * radius + MARGIN_M for other in others)
        if free and segment_clearance(arena, start, spot) > radius:
            return spot
    return None
