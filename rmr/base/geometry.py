"""Plane geometry: metres, radians, x to the right, y up, angles counter-clockwise from the x axis."""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple, final, overload

hypot: Final = math.hypot
"""`math.hypot` as a constant: compiled code would look up the attribute of `math` at every call."""
_remainder: Final = math.remainder


class Point(NamedTuple):
    """A point in metres."""

    x: float
    y: float


@final
class Pose:
    """Position (metres) and heading (radians) of a robot. Immutable.

    Like `Twist` no named tuple: even in compiled code those are built and unpacked by the interpreter. It can be
    unpacked, indexed, sliced, copied and pickled like one; access by name is the fast one.
    """

    __slots__ = ("theta", "x", "y")

    def __init__(self, x: float, y: float, theta: float) -> None:
        self.x: Final = x
        self.y: Final = y
        self.theta: Final = theta

    def __iter__(self) -> Iterator[float]:
        return iter((self.x, self.y, self.theta))

    @overload
    def __getitem__(self, index: int) -> float: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[float, ...]: ...

    def __getitem__(self, index: int | slice) -> float | tuple[float, ...]:
        values: tuple[float, ...] = (self.x, self.y, self.theta)
        return values[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pose) and self.x == other.x and self.y == other.y and self.theta == other.theta

    def __hash__(self) -> int:
        return (self.x, self.y, self.theta).__hash__()

    def __repr__(self) -> str:
        return f"Pose(x={self.x!r}, y={self.y!r}, theta={self.theta!r})"

    def __reduce__(self) -> tuple[type["Pose"], tuple[float, ...]]:
        return Pose, (self.x, self.y, self.theta)


@final
class Twist:
    """A wheel command: forward speed in m/s, turn rate in rad/s (counter-clockwise). Immutable."""

    __slots__ = ("v", "w")

    def __init__(self, v: float, w: float) -> None:
        self.v: Final = v
        self.w: Final = w

    def __iter__(self) -> Iterator[float]:
        return iter((self.v, self.w))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Twist) and self.v == other.v and self.w == other.w

    def __hash__(self) -> int:
        return (self.v, self.w).__hash__()

    def __repr__(self) -> str:
        return f"Twist(v={self.v!r}, w={self.w!r})"

    def __reduce__(self) -> tuple[type["Twist"], tuple[float, ...]]:
        return Twist, (self.v, self.w)


PI: Final = 3.141592653589793
"""`math.pi` as a literal, which compiled code contains as a constant."""
STILL: Final = Twist(0.0, 0.0)


def wrap(angle: float) -> float:
    """Return `angle` in (-pi, pi]."""
    if -PI < angle < PI:
        return angle
    wrapped: float = _remainder(angle, 2.0 * PI)
    return PI if wrapped == -PI else wrapped


def distance(ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance between (ax, ay) and (bx, by) in metres."""
    return hypot(bx - ax, by - ay)


def point_segment_distance(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance of point p from the segment a-b in metres."""
    dx = bx - ax
    dy = by - ay
    # The projection of p on the line, as a share of the segment, clamped to it; a segment of length 0 is a point.
    length2 = dx * dx + dy * dy
    t = 0.0 if length2 == 0.0 else ((px - ax) * dx + (py - ay) * dy) / length2
    if t < 0.0:
        t = 0.0
    elif t > 1.0:
        t = 1.0
    return hypot(px - ax - t * dx, py - ay - t * dy)
