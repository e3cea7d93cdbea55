"""Straight drives in common time: how robots change places together and keep apart.

All robots leave at one instant and arrive at another, each on a straight line, and at any time all have covered the
same share of their lines. Then the vector between two of them goes evenly from its start, x, to its end, g. If
x . g >= 0 for each two (no two could exchange their goals and lessen the sum of the squared lengths), robots that start
and end at least D apart are never nearer than D / sqrt 2 (Turpin, Michael, Kumar: CAPT, 2014).

A robot turns before it leaves. It tracks the share that is due, so one that is late catches up as far as its speed
allows. Other robots are not considered here: the speed law comes after.
"""

import math
from typing import Final

from rmr.base.arena import RobotShape
from rmr.base.geometry import STILL, Point, Pose, Twist, hypot, wrap
from rmr.base.motion_scale import scale_of
from rmr.base.time import Instant, in_seconds
from rmr.node.motion.follow import ARRIVED_M, CREEP, FACED, PIVOT_END, braking_speed, turn_towards

CATCH_UP_PER_S: Final = 4.0
"""Speed per metre behind what is due, 1/s; twice as much makes the noise of localisation felt at the wheels."""
SWING_M: Final = 0.15
"""How far ahead a robot beside its line aims at it, times the pace."""
ASTRAY_M: Final = 0.04
"""Beside the goal by more than this at the end of its line, a robot is not there."""


class Straight:
    """One robot's straight drive from `start` to `goal`, leaving at `begins` and arriving at `ends`."""

    __slots__ = ("_begins", "_cos", "_heading", "_scale", "_shape", "_sin", "_start", "_took", "length_m")

    def __init__(self, start: Point, goal: Point, begins: Instant, ends: Instant, shape: RobotShape) -> None:
        self._start = start
        self._shape = shape
        self._scale: Final = scale_of(shape)
        self._begins = begins
        self._took = max(1, ends - begins)
        self.length_m = hypot(goal.x - start.x, goal.y - start.y)
        self._heading = math.atan2(goal.y - start.y, goal.x - start.x)
        self._cos = math.cos(self._heading)
        self._sin = math.sin(self._heading)

    def share(self, now: Instant) -> tuple[float, float]:
        """Return the share of the way that is due at `now`, and its growth per second.

        It depends on `begins` and `ends` alone: even speed between two ramps.
        """
        ramp = min(self._scale.ramp, self._took / 2)
        even = 1.0 / (self._took - ramp)
        gone = min(max(0, now - self._begins), self._took)
        left = self._took - gone
        if gone < ramp:
            done = 0.5 * even * gone * gone / ramp
            rate = even * gone / ramp
        elif left < ramp:
            done = 1.0 - 0.5 * even * left * left / ramp
            rate = even * left / ramp
        else:
            done = even * (gone - ramp / 2)
            rate = even
        return done, rate / in_seconds(1)

    def along(self, pose: Pose) -> tuple[float, float]:
        """Return how far along the line a robot at `pose` is, and how far to the left of it, metres."""
        x = pose.x - self._start.x
        y = pose.y - self._start.y
        return x * self._cos + y * self._sin, y * self._cos - x * self._sin

    def ended(self, pose: Pose) -> bool:
        """Return whether the line is behind the robot."""
        return self.along(pose)[0] >= self.length_m - ARRIVED_M

    def astray(self, pose: Pose) -> bool:
        """Return whether a robot at the end of its line is too far beside it to be there."""
        return abs(self.along(pose)[1]) > ASTRAY_M

    def steer(self, now: Instant, pose: Pose) -> Twist:
        """Return the wheel command of this tick."""
        done, left_of = self.along(pose)
        if self.ended(pose):
            return STILL
        error = wrap(self._heading - math.atan2(left_of, SWING_M * self._scale.pace) - pose.theta)
        turn = turn_towards(error, self._shape)
        if now < self._begins:
            return STILL if abs(error) < FACED else Twist(0.0, turn)
        if abs(error) > PIVOT_END:
            return Twist(0.0, turn)
        due, rate = self.share(now)
        wish = rate * self.length_m + CATCH_UP_PER_S * (due * self.length_m - done)
        least = CREEP if due >= 1.0 else 0.0
        return Twist(max(least, min(wish, self._shape.speed, braking_speed(self.length_m - done))), turn)
