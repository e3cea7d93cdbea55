"""Path following with a differential drive: pure pursuit.

The robot steers along the arc that leads from its pose to the look-ahead point of the path. When that point is far off
its heading it turns in place first. Wheels brake with PLANNED_BRAKE and TURN_BRAKE at most, so speed falls before the
end of the path as the square root of the remaining length.
"""

import math
from typing import Final

from rmr.base.arena import RobotShape
from rmr.base.geometry import STILL, Pose, Twist, distance, hypot, wrap
from rmr.base.motion_scale import PLANNED_BRAKE, scale_of
from rmr.node.motion.route import Route

LOOK_AHEAD_M: Final = 0.11
"""Least distance of the look-ahead point. Measured best between 0.10 and 0.12: shorter swings, longer cuts corners."""
LOOK_AHEAD_S: Final = 0.25
"""A robot looks ahead as far as it drives in this, at least: what it has turned by is seen two frames later."""
TURN_BRAKE: Final = 8.0
"""Deceleration of planned turns, rad/s^2; the wheels can do 12."""
TURN_PER_S: Final = 8.0
"""Turn rate per radian of heading error, 1/s: a small error is removed without a jerk."""
PIVOT_BEGIN: Final = 1.0
"""Heading error beyond which the robot turns in place, radians."""
PIVOT_END: Final = 0.35
"""Heading error below which a robot that turns in place drives on, radians."""
FACED: Final = 0.03
"""Heading error that counts as facing, radians."""
TURNED: Final = 0.05
"""Heading error that is left as it is while the robot may not drive, radians."""
NEARS_M: Final = 0.05
"""Remaining length from which arrival is tested."""
END_M: Final = 0.002
"""Remaining length that counts as none: the robot brakes for this place."""
ARRIVED_M: Final = 0.008
"""Distance from the goal that counts as there."""
ARRIVED_BESIDE_M: Final = 0.02
"""Distance from the goal that counts as there when no length remains: turning back would cost more than it gains."""
CREEP: Final = 0.02
"""Least speed on the last centimetres, m/s."""
WINDOW_M: Final = 0.25
"""How far ahead of its last progress the robot is searched for on the path, times the pace."""
BACK_M: Final = 0.02
"""How far behind its last progress the robot is searched for: braking undoes no more."""
CLOSE_AHEAD_M: Final[tuple[float, ...]] = (0.055, 0.03)
"""Look-ahead points that are tried where the arc to the usual one leads too near to a wall."""
AIM_M: Final = 0.03
"""Least distance of the look-ahead point in the curvature: at the path's end the point comes close."""


def turn_towards(error: float, shape: RobotShape) -> float:
    """Return the turn rate that removes a heading error and stops there, rad/s."""
    rate = min(shape.turn, math.sqrt(2.0 * TURN_BRAKE * abs(error)), TURN_PER_S * abs(error))
    return math.copysign(rate, error)


def braking_speed(way_m: float) -> float:
    """Return the speed from which the robot can stop within `way_m`, m/s."""
    return math.sqrt(2.0 * PLANNED_BRAKE * max(0.0, way_m))


class Follower:
    """Progress along one route."""

    __slots__ = ("_aim", "_seen", "_seen_s", "_v", "_window_m", "arrived", "pivoting", "route", "s", "shape")

    def __init__(self, route: Route, shape: RobotShape) -> None:
        self.route = route
        self.shape = shape
        self.s = 0.0
        self.pivoting = True
        self.arrived = False
        self._seen: Pose | None = None
        self._seen_s = 0.0
        self._v = 0.0
        """The speed of the last command, m/s."""
        self._window_m: Final = WINDOW_M * scale_of(shape).pace
        self._aim = 0.0, 0.0, 0.0
        """The look-ahead point as seen from the pose `_seen`, at the progress `_seen_s`: dx, dy and heading error."""

    def locate(self, pose: Pose) -> None:
        """Bring progress up to `pose`; it never goes back by more than `BACK_M`."""
        route = self.route
        x = pose.x
        y = pose.y
        self.s = route.project(x, y, max(0.0, self.s - BACK_M), self.s + self._window_m)
        left = route.at_m[-1] - self.s
        if left < NEARS_M:
            away = distance(*route.points[-1], x, y)
            if away < ARRIVED_M or (left < END_M and away < ARRIVED_BESIDE_M):
                self.arrived = True

    def heading_error(self, pose: Pose) -> float:
        """Return how far the look-ahead point is off the robot's heading, radians."""
        return self._look_ahead(pose)[2]

    def _look_ahead(self, pose: Pose) -> tuple[float, float, float]:
        """Return how far ahead the look-ahead point is along x and y, and how far off the heading."""
        if self._seen is not pose or self._seen_s != self.s:
            self._seen = pose
            self._seen_s = self.s
            self._aim = self._aim_at(pose, max(LOOK_AHEAD_M, LOOK_AHEAD_S * self._v))
        return self._aim

    def _aim_at(self, pose: Pose, ahead_m: float) -> tuple[float, float, float]:
        """Return the point of the path `ahead_m` ahead as seen from `pose`: dx, dy and heading error."""
        x, y = self.route.place(self.s + ahead_m)
        dx = x - pose.x
        dy = y - pose.y
        return dx, dy, wrap(math.atan2(dy, dx) - pose.theta)

    def steer_closely(self, pose: Pose, v: float, ahead_m: float) -> Twist:
        """Return the wheel command at `v` m/s to a point only `ahead_m` ahead, so that no corner is cut.

        The robot turns on the spot to a point that is far off its heading.
        """
        dx, dy, error = self._aim_at(pose, ahead_m)
        if abs(error) > PIVOT_END:
            return Twist(0.0, turn_towards(error, self.shape))
        return self._arc(v, dx, dy, error)

    def _arc(self, v: float, dx: float, dy: float, error: float) -> Twist:
        """Return the command along the circle through the pose, tangent to the heading, and the point (dx, dy)."""
        curvature = 2.0 * math.sin(error) / max(AIM_M, hypot(dx, dy))
        turn = self.shape.turn
        if abs(v * curvature) > turn:  # the wheels cannot turn so fast: slower, on the same arc
            v = turn / abs(curvature)
        return Twist(v, v * curvature)

    def steer(self, pose: Pose, limit: float) -> Twist:
        """Return the wheel command at a speed of at most `limit` m/s; call `locate` before."""
        if self.arrived:
            return STILL
        dx, dy, error = self._look_ahead(pose)
        if abs(error) > (PIVOT_END if self.pivoting else PIVOT_BEGIN):
            self.pivoting = True
            self._v = 0.0
            return Twist(0.0, turn_towards(error, self.shape))
        self.pivoting = False
        shape = self.shape
        v = min(shape.speed, limit)
        if v <= 0.0:
            self._v = 0.0
            return Twist(0.0, turn_towards(error, shape) if abs(error) > TURNED else 0.0)
        left = self.route.at_m[-1] - self.s - END_M
        if 2.0 * PLANNED_BRAKE * left < v * v:
            v = min(v, max(CREEP, braking_speed(left)))
        twist = self._arc(v, dx, dy, error)
        self._v = twist.v
        return twist
