"""How long a drive would take: the times of a request for a slot."""

from typing import Final, NamedTuple

from rmr.base.arena import RobotShape
from rmr.base.geometry import Pose
from rmr.base.motion_scale import scale_of
from rmr.base.time import Duration, seconds
from rmr.node.motion.follow import PIVOT_END, Follower
from rmr.node.motion.route import Route

PIVOT_S: Final = 0.1
"""Time that speeding up to turn in place costs against the full turn rate, seconds, from an angle of PIVOT_WAY on."""
PIVOT_WAY: Final = 0.3
"""Angle from which a turn in place reaches its full rate, radians; smaller ones cost in proportion."""
LATE_S: Final = 0.07
"""Time by which a robot may be at the commit line after its slot has begun, seconds: it enters within a window."""
AFTER_S: Final = 0.1
"""Time by which a robot plans to be early at its goal, seconds."""
AT_ENTER_M: Final = 0.04
"""A robot no farther than this from a place is at it."""


class Estimate(NamedTuple):
    """Durations of a drive."""

    approach: Duration
    """Until the robot is at the commit line at full speed (at the goal, when there is no gate)."""
    inside: Duration
    """From there, at full speed, until it is clear of the narrow section; 0 without a gate."""
    way: int
    """Direction through the gate."""
    after: Duration
    """From clear, at full speed, until it counts as being at the goal."""
    within: bool = False
    """Whether the robot is in the narrow section already."""
    passage: str | None = None
    """Name of the passage behind the gate."""


def drive_time(shape: RobotShape, way_m: float, turn: float, v: float = 0.0) -> Duration:
    """Return what `way_m` metres take from `v` m/s on, for a robot whose way leads off by `turn` radians.

    It turns in place until it is hardly off any more, and does the rest on the way.
    """
    angle = max(0.0, turn - PIVOT_END)
    pivot = angle / shape.turn + PIVOT_S * min(1.0, angle / PIVOT_WAY)
    return seconds(pivot + way_m / shape.speed + scale_of(shape).start_s * max(0.0, 1.0 - v / shape.speed))


def time_left(shape: RobotShape, follower: Follower, pose: Pose, way_m: float, v: float) -> Duration:
    """Return what the next `way_m` metres take a robot under way at `v` m/s, which turns as it drives."""
    return drive_time(shape, way_m, abs(follower.heading_error(pose)) if follower.pivoting else 0.0, v)


def estimate_of(shape: RobotShape, route: Route, line_m: float, turn: float) -> Estimate:
    """Return what driving along `route` would take, with the gate's line at `line_m`, after turning by `turn`.

    Slots mean the line at full speed, so speeding up belongs to the approach alone.
    """
    if route.gate_m is None:
        return Estimate(drive_time(shape, route.length_m, turn), 0, 0, 0)
    inside = seconds((route.clear_m - line_m) / shape.speed)
    after = seconds(max(0.0, route.length_m - route.clear_m - AT_ENTER_M) / shape.speed + AFTER_S)
    approach = max(0, drive_time(shape, line_m, turn) - seconds(LATE_S))
    return Estimate(approach, inside, route.way, after, route.within, route.passage)
