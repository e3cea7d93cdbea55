"""The wheels as one robot knows them: how fast they still turn, and along which arc they brake.

Wheels brake with `BRAKE` at most, so a fast robot drives on for longer than a tick after it was commanded to be slower.
They turn much faster than they brake: commanded to half of the speed and half of the turn rate, the robot would leave
its arc for a straighter one, which no rule has judged. So a fast robot is steered by curvature: it is turned as its way
takes at the speed which it has, whether it brakes or not. One that is to stand, or to turn on the spot, brakes on the
way that was judged last.

Another turn rate takes time (`TURN_ACCELERATION`): from a left turn to a right one of 2 rad/s a third of a second, in
which a robot of 1 m/s drives 33 cm. So a new arc begins with a `LeadIn`, along which the curvature changes evenly (a
clothoid). It is as long as the wheels need at the commanded speed. A command that the shield slows would have a shorter
one, which leads elsewhere: it keeps the one that was judged, unless the shorter one is clear as well.

Up to the speed of the reference robot a command is left as it is: the way to stand is 5 cm, which margins cover.
"""

from typing import Final, NamedTuple

from rmr.base.arena import BRAKE, REFERENCE, TURN_ACCELERATION, RobotShape
from rmr.base.geometry import Twist
from rmr.base.time import TICK_S, Instant, in_seconds


class LeadIn(NamedTuple):
    """The way on which a robot comes from its present arc to another one: the curvature changes evenly along it."""

    bend: float
    """The curvature at its beginning, 1/m."""
    way: float
    """Its length, metres."""


class Wheels:
    """The wheels of one robot."""

    __slots__ = ("_at", "_bend", "_command", "_driven", "_fast", "_lead", "_slowed", "_turn", "_v")

    def __init__(self, shape: RobotShape) -> None:
        self._turn: Final = shape.turn
        self._fast: Final = shape.speed > REFERENCE.speed
        self._at: Instant = 0
        self._v = 0.0
        """The speed at `_at`, m/s."""
        self._command = 0.0
        """The speed that was commanded then."""
        self._bend = 0.0
        """Curvature of the arc to which the robot was commanded, 1/m."""
        self._lead = _ON_ARC
        """The way to that arc."""
        self._driven = 0.0
        """How much of it was driven at `_at`, metres."""
        self._slowed: dict[Twist, LeadIn | None] = {}
        """The commands that were slowed in this tick; of each the way to its arc that was judged."""

    def speed(self, now: Instant) -> float:
        """Return how fast the robot drives, m/s."""
        change = BRAKE * in_seconds(now - self._at)
        return min(max(self._command, self._v - change), self._v + change)

    def lead(self, now: Instant, twist: Twist) -> LeadIn | None:
        """Return the way of a fast robot to the arc of `twist`, m/s and rad/s; None: of one that is not fast."""
        if not self._fast or twist.v <= 0.0 or self.speed(now) <= REFERENCE.speed:
            return None
        bend = self._curvature(self._way(now))
        # At the speed v the turn rate changes by v^2 times the curvature's change a metre.
        return LeadIn(bend, abs(twist.w / twist.v - bend) * twist.v * twist.v / TURN_ACCELERATION)

    def slow(self, twist: Twist, lead: LeadIn | None) -> Twist:
        """Return `twist`, a command that was judged at a higher speed; its way to its arc stays `lead`."""
        self._slowed[twist] = lead
        return twist

    def braking(self, now: Instant, twist: Twist) -> Twist | None:
        """Return the motion along the arc of `twist` at the present speed of a robot that brakes; None: it does not."""
        if not self._fast:
            return None
        v = self.speed(now)
        if v <= REFERENCE.speed or twist.v >= v:
            return None
        bend = twist.w / twist.v if twist.v > 0.0 else self._bend
        return Twist(v, max(-self._turn, min(self._turn, bend * v)))

    def command(self, now: Instant, twist: Twist) -> Twist:
        """Take in the last command of a tick; return it, with the turn rate that the way of a fast robot takes."""
        if not self._fast:
            return twist
        v = self.speed(now)
        driven = self._way(now)
        arc = self.braking(now, twist) or twist
        if twist.v > 0.0:
            lead = self._slowed[twist] if twist in self._slowed else self.lead(now, arc)
            self._lead = lead or _ON_ARC
            self._bend = arc.w / arc.v
            driven = 0.0
        self._slowed.clear()
        self._v = v
        self._at = now
        self._driven = driven
        self._command = twist.v
        if v <= REFERENCE.speed:
            return twist
        rate = v * self._curvature(driven + v * TICK_S)
        return Twist(max(0.0, twist.v), max(-self._turn, min(self._turn, rate)))

    def _way(self, now: Instant) -> float:
        """Return how much of the way to its arc the robot has driven, metres."""
        return self._driven + 0.5 * (self._v + self.speed(now)) * in_seconds(now - self._at)

    def _curvature(self, driven: float) -> float:
        """Return the curvature of the way after so many metres, 1/m."""
        lead = self._lead
        if driven >= lead.way:
            return self._bend
        return lead.bend + (self._bend - lead.bend) * driven / lead.way


_ON_ARC: Final = LeadIn(0.0, 0.0)
"""The way to an arc on which the robot is."""
