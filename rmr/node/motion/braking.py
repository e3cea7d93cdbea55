"""The wheels as one robot knows them: how fast they still turn, and along which arc they brake.

Wheels brake with `BRAKE` at most, so a fast robot drives on for longer than a tick after it was commanded to be slower.
They turn much faster than they brake: commanded to half of the speed and half of the turn rate, the robot would leave
its arc for a straighter one, which no rule has judged. So a robot that brakes is turned at the rate that its arc takes
at the speed which it still has. One that is to stand, or to turn on the spot, brakes on the arc on which it is.

Up to the speed of the reference robot a command is left as it is: the way to stand is 5 cm, which margins cover.
"""

from typing import Final

from rmr.base.arena import BRAKE, REFERENCE, RobotShape
from rmr.base.geometry import Twist
from rmr.base.time import Instant, in_seconds


class Wheels:
    """The wheels of one robot."""

    __slots__ = ("_at", "_bend", "_command", "_turn", "_v")

    def __init__(self, shape: RobotShape) -> None:
        self._turn: Final = shape.turn
        self._at: Instant = 0
        self._v = 0.0
        """The speed at `_at`, m/s."""
        self._command = 0.0
        """The speed that was commanded then."""
        self._bend = 0.0
        """Curvature of the arc on which the robot is, 1/m."""

    def speed(self, now: Instant) -> float:
        """Return how fast the robot drives, m/s."""
        change = BRAKE * in_seconds(now - self._at)
        return min(max(self._command, self._v - change), self._v + change)

    def braking(self, now: Instant, twist: Twist) -> Twist | None:
        """Return the motion along the arc of `twist` at the present speed of a robot that brakes; None: it does not."""
        v = self.speed(now)
        if v <= REFERENCE.speed or twist.v >= v:
            return None
        bend = twist.w / twist.v if twist.v > 0.0 else self._bend
        return Twist(v, max(-self._turn, min(self._turn, bend * v)))

    def command(self, now: Instant, twist: Twist) -> Twist:
        """Take in the last command of a tick; return it, with the turn rate of the arc on which the robot brakes."""
        arc = self.braking(now, twist)
        if arc is not None:
            twist = Twist(max(0.0, twist.v), arc.w)
            self._bend = arc.w / arc.v
        elif twist.v > 0.0:
            self._bend = twist.w / twist.v
        self._v = self.speed(now)
        self._at = now
        self._command = twist.v
        return twist
