"""Plane geometry: metres, radians, x to the right, y up, angles counter-clockwise from the x axis."""

import math
from typing import Final, NamedTuple


class Point(NamedTuple):
    """A point in metres."""

    x: float
    y: float


class Pose(NamedTuple):
    """Where a robot is (metres) and where it faces (radians)."""

    x: float
    y: float
    theta: float


class Twist(NamedTuple):
    """A wheel command: forward speed in m/s, turn rate in rad/s (counter-clockwise)."""

    v: float
    w: float


STILL: Final = Twist(0.0, 0.0)


def wrap(angle: float) -> float:
    """Return `angle` in (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def distance(ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance between (ax, ay) and (bx, by) in metres."""
    return math.hypot(bx - ax, by - ay)


def point_segment_distance(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance of point p from the segment a-b in metres."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    t = 0.0 if length2 == 0.0 else ((px - ax) * dx + (py - ay) * dy) / length2
    if t < 0.0:
        t = 0.0
    elif t > 1.0:
        t = 1.0
    return math.hypot(px - ax - t * dx, py - ay - t * dy)
