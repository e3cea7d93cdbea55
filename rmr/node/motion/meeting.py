"""Robots that come towards each other: each keeps to the right in time, before they stand face to face."""

from collections.abc import Sequence
from math import cos, sin
from typing import Final

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, Pose
from rmr.base.motion_scale import scale_of
from rmr.base.time import Instant
from rmr.node.motion.priority import AGE_MAX, Heard

TOWARDS: Final = -0.7
"""Two whose headings differ by at least the angle with this cosine, 134 degrees, drive towards each other."""
NEAR_RADII: Final = 6.0
"""Nearer than this there is no room to keep to the right: the rules for bodies apply."""
FAR_HORIZONS: Final = 2.25
"""Farther away than a robot drives in so many horizons of its prediction, 1.8 m for the reference robot, they do not
meet yet."""
BESIDE_M: Final = 0.05
"""Two whose lines are farther apart than their hulls and this, times the size, pass each other."""


def oncoming(now: Instant, pose: Pose, others: Sequence[Heard], shape: RobotShape, within_m: float) -> dict[int, Point]:
    """Return, by robot, the places that a robot at `pose` passes on the right so as to pass whom it would meet.

    Of `others`, those that drive, it meets the ones that come towards it on its own line, before it has driven
    `within_m` metres. A place lies half way, on the left of the line.
    """
    dx = cos(pose.theta)
    dy = sin(pose.theta)
    scale = scale_of(shape)
    beside = BESIDE_M * scale.size
    keep = 2.0 * shape.radius + beside
    near = NEAR_RADII * shape.radius
    far = min(FAR_HORIZONS * scale.horizon_s * shape.speed, 2.0 * within_m)
    aside = shape.radius + 0.5 * beside
    places = {}
    for other in others:
        if now - other.at > AGE_MAX:
            continue
        x = other.pose.x - pose.x
        y = other.pose.y - pose.y
        ahead = x * dx + y * dy
        if not near < ahead < far or abs(dx * y - dy * x) > keep:
            continue
        ox = cos(other.pose.theta)
        oy = sin(other.pose.theta)
        if dx * ox + dy * oy <= TOWARDS and abs(ox * y - oy * x) <= keep:
            places[other.robot] = Point(pose.x + 0.5 * x - aside * dy, pose.y + 0.5 * y + aside * dx)
    return places
