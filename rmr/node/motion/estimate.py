"""What a drive would take: the times that a robot asks for a turn with."""

from typing import NamedTuple

from rmr.base.arena import RobotShape
from rmr.base.time import Duration, seconds
from rmr.node.motion.gate import START_S
from rmr.node.motion.route import Route

PIVOT_FROM = 0.35
"""A robot that is off its way by more than this turns in place first, radians."""
PIVOT_S = 0.2
"""What beginning and ending a turn in place takes."""


class Estimate(NamedTuple):
    """What a drive would take."""

    approach: Duration
    """Until the robot is at the gate's line at full speed (to the goal, when there is no gate)."""
    inside: Duration
    """From there until it is clear of the narrow section; 0 without a gate."""
    way: int
    """Direction through the gate."""
    after: Duration
    """From clear to the goal."""
    within: bool = False
    """Whether the robot is in the narrow section already."""


def drive_time(shape: RobotShape, way_m: float, turn: float) -> Duration:
    """Return what `way_m` metres take at least, after a turn by `turn` radians."""
    pivot = turn / shape.turn + PIVOT_S if turn > PIVOT_FROM else 0.0
    return seconds(pivot + way_m / shape.speed + START_S)


def estimate_of(shape: RobotShape, route: Route, line_m: float, turn: float) -> Estimate:
    """Return what driving along `route` would take, with the gate's line at `line_m`, after turning by `turn`."""
    if route.gate_m is None:
        return Estimate(drive_time(shape, route.length_m, turn), 0, 0, 0)
    inside = seconds((route.clear_m - line_m) / shape.speed + START_S)
    after = seconds((route.length_m - route.clear_m) / shape.speed + START_S)
    return Estimate(drive_time(shape, line_m, turn), inside, route.way, after, route.within)
