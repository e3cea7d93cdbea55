"""Make room: a little way back, and where a robot steps aside to when one that wants to get past it is on its goal.

Two robots that want each other's places are in a stand-off without a way around: each goal is occupied until the other
has left. Each then drives a little to its right, and comes back when the other has had time to pass. On their
right hand both leave the line between them on different sides. One that waits for its turn in a mouth by which others
come out drives out of their way alike.
"""

import math
from collections.abc import Sequence

from rmr.base.arena import Arena
from rmr.base.geometry import STILL, Point, Pose, Twist, distance
from rmr.base.time import Duration, seconds
from rmr.node.motion.avoid import BACK_MPS
from rmr.node.motion.grid import MARGIN_M, segment_clearance
from rmr.node.ports import SeenBody

BACK_MARGIN_M = 0.03
"""Gap to other robots that driving back keeps: it is done blind."""
AHEAD_M = 0.03
"""How far it looks."""
ASIDE_S: Duration = seconds(4)
"""How long a robot stays aside at most, the way there included."""
ASIDE_RADII = 4.0
"""How far aside: two hulls and as much room between them."""
ANGLES = (-90, -135, -45, 90, 135, 45, 180)
"""Degrees from the way to the goal, to the right first."""


FARTHER = (1.0, 1.5, 2.0, 3.0)
"""Times as far, where there is no room nearer."""


def aside(
    arena: Arena, start: Point, goal: Point, others: Sequence[Point], mouth: Pose | None = None, off_m: float = 0.0
) -> Point | None:
    """Return where to step aside from `start` on the way to `goal`, clear of `others`; None where there is no room.

    If the pose of a `mouth` is given, as one who enters by it has it, the place is before it, at least `off_m` away.
    """
    radius = arena.shape.radius
    ahead = math.atan2(goal.y - start.y, goal.x - start.x)
    for times in FARTHER[: 1 if mouth is None else None]:
        away = times * ASIDE_RADII * radius
        for degrees in ANGLES:
            turn = ahead + math.radians(degrees)
            spot = Point(start.x + away * math.cos(turn), start.y + away * math.sin(turn))
            free = all(distance(*spot, *other) > 2.0 * radius + MARGIN_M for other in others)
            free = free and (mouth is None or _before(mouth, spot, off_m))
            if free and segment_clearance(arena, start, spot) > radius:
                return spot
    return None


def _before(mouth: Pose, spot: Point, off_m: float) -> bool:
    """Return whether `spot` is farther than `off_m` from a mouth, on the side from which the mouth is entered."""
    x, y, theta = mouth
    ahead = (spot.x - x) * math.cos(theta) + (spot.y - y) * math.sin(theta)
    return ahead < 0.0 and distance(*spot, x, y) > off_m


def back(arena: Arena, pose: Pose, around: Sequence[SeenBody]) -> Twist:
    """Return the wheel command that drives straight back, unless something is known to be there."""
    radius, (x, y, theta) = arena.shape.radius, pose
    free = arena.clearance(x - math.cos(theta) * AHEAD_M, y - math.sin(theta) * AHEAD_M) > radius and all(
        math.hypot(body.x + AHEAD_M, body.y) > 2.0 * radius + BACK_MARGIN_M or body.x > 0.0 for body in around
    )
    return Twist(-BACK_MPS, 0.0) if free else STILL
