"""The law between two robots that drive: each keeps its own way to stand clear of the other one's.

The way to stand of a robot is where it is until it stands, should it brake within the lag of its wheels. Of the other
one it is on the line on which it drives: no farther than one that goes on for the lag, and at each instant at least as
far as one that has braked at once, or right after its hello if it is heard and not seen. So who follows may be as near
as both ways to stand differ, and who passes behind another one need not wait until that is gone.

Of two, the earlier in the order keeps clear of what the other one needs to stand. The later brakes early, with
PLANNED_BRAKE, and keeps clear of what the earlier one drives in `AHEAD_S`, too, unless it is within that already: then
it goes on out of the way. The argument is in docs/safety.md. Pure, like the shield, which applies it.
"""

import math
from typing import Final, final

from rmr.base.arena import BRAKE
from rmr.base.geometry import Twist, hypot, point_segment_distance
from rmr.base.motion_scale import LAG_S, PLANNED_BRAKE, MotionScale, blur_m
from rmr.node.motion.avoid import CREEPING_MPS, STILL_MPS
from rmr.node.motion.braking import LeadIn
from rmr.node.motion.shield import SLOPE, STEP_M, along, aside, on_the_way
from rmr.node.ports import SeenBody

GAP_M: Final = 0.012
"""What is left between two hulls when both stand, metres."""
HEARD_GAP_M: Final = 0.016
"""The same of a robot that is heard and not seen, or HEARD_SIGMAS of the own estimate if that is more."""
HEARD_SIGMAS: Final = 3.0
BEFORE_M: Final = 0.008
"""How much more is left before one that stands or manoeuvres, times the size: there has to be room to turn past it."""
PAST_M: Final = 0.08
"""Where so much of the arc, times the size, keeps the least gap, it leads past the other one and not before it."""
PAST_MPS: Final = 0.04
"""Speed with which one that stands is passed where the gap is least."""
AHEAD_S: Final = 0.25
"""How much of the earlier one's way the later one leaves to it, beyond that to stand, seconds."""
TURNS_RADPS: Final = 1.0
"""How fast one that is heard and not seen may turn off its line, radians a second..."""
TURNED_M: Final = 0.01
"""... until it would come to stand this far beside it, times its pace: then it says so (`rmr.node.peers.presence`)."""
EXACT_M: Final = 1e-4
"""A way along another one comes nearer by this much in rounding."""


@final
class WaysToStand:
    """The law for robots of one shape."""

    __slots__ = ("_before", "_past", "_speed", "_touch", "_turned")

    def __init__(self, scale: MotionScale) -> None:
        self._speed: Final = scale.speed
        self._before: Final = BEFORE_M * scale.size
        self._past: Final = PAST_M * scale.size
        self._turned: Final = TURNED_M * scale.pace
        self._touch: Final = 2.0 * scale.radius

    def clear(
        self, twist: Twist, body: SeenBody, gap_m: float, age_s: float, *, first: bool, lead: LeadIn | None = None
    ) -> float:
        """Return the greatest share of `twist` whose way to stand is clear of that of `body`; 0 to 1.

        `gap_m`: least gap between the hulls, metres. `age_s`: how long ago `body` was heard, seconds; 0: it is seen.
        `first`: this robot is the earlier one. `lead` leads to the arc of `twist`; None: the robot is on it.
        """
        v = abs(twist.v)
        if v == 0.0:
            return 1.0
        brake = BRAKE if first else PLANNED_BRAKE
        way = v * LAG_S + v * v / (2.0 * brake)
        u = hypot(body.vx, body.vy)
        stands = u <= STILL_MPS
        keep = self._touch + gap_m + blur_m(min(self._speed, u))
        if age_s > 0.0:
            turned = (0.5 * u * age_s + u * LAG_S + u * u / (2.0 * BRAKE)) * TURNS_RADPS * age_s
            keep += turned if turned < self._turned else self._turned
        reach = 0.0 if stands else u * (LAG_S + age_s) + u * u / (2.0 * BRAKE)
        ahead_m = 0.0 if stands or first else AHEAD_S * u
        if hypot(body.x, body.y) - reach - ahead_m - keep - self._before >= way * (1.0 + SLOPE):
            return 1.0
        other = _Course(body, age_s, ahead_m)
        away = other.distance(0.0, 0.0, 0.0)
        if away < keep and ahead_m > 0.0:
            other = _Course(body, age_s, 0.0)
            away = other.distance(0.0, 0.0, 0.0)
        past = u >= CREEPING_MPS or _free(twist, lead, other, self._past, keep, 0.0, brake) >= self._past
        if not past:
            keep += self._before
        free = _free(twist, lead, other, way, keep, SLOPE, brake)
        if free >= way:
            return 1.0
        share = brake * (math.sqrt(LAG_S * LAG_S + 2.0 * free / brake) - LAG_S) / v
        return max(share, min(1.0, PAST_MPS / v)) if past and stands else share


@final
class _Course:
    """Where another robot can be: on the line on which it drives, until it stands."""

    __slots__ = ("_age_s", "_end_x", "_end_y", "_u", "_ux", "_uy", "_x", "_y")

    def __init__(self, body: SeenBody, age_s: float, ahead_m: float) -> None:
        """`ahead_m`: how much farther than its way to stand it is taken to drive, metres."""
        u = hypot(body.vx, body.vy)
        if u <= STILL_MPS:
            u = 0.0
        self._x: Final = body.x
        self._y: Final = body.y
        self._u: Final = u
        self._ux: Final = body.vx / u if u > 0.0 else 0.0
        self._uy: Final = body.vy / u if u > 0.0 else 0.0
        self._age_s: Final = age_s
        far = u * LAG_S + u * u / (2.0 * BRAKE) + ahead_m
        self._end_x: Final = body.x + self._ux * far
        self._end_y: Final = body.y + self._uy * far

    def distance(self, x: float, y: float, after_s: float) -> float:
        """Return how near it can be to (x, y) from `after_s` on, metres.

        It is no nearer than one that has braked right after its hello, and is taken to have driven on.
        """
        u = self._u
        if u == 0.0:
            return hypot(x - self._x, y - self._y)
        brakes = min(self._age_s + after_s, u / BRAKE)
        least = u * brakes - 0.5 * BRAKE * brakes * brakes - u * self._age_s
        return point_segment_distance(
            x, y, self._x + self._ux * least, self._y + self._uy * least, self._end_x, self._end_y
        )


def _free(
    twist: Twist, lead: LeadIn | None, other: _Course, way: float, keep: float, rise: float, brake: float
) -> float:
    """Return how much of `way`, metres along `lead` and the arc of `twist`, is `keep` off the `other` one.

    `rise`: how much farther off it is after each metre. A way that comes no nearer than the robot is now is free.
    """
    v = abs(twist.v)
    forward = 1.0 if twist.v > 0.0 else -1.0
    bend = twist.w / v
    away = other.distance(0.0, 0.0, 0.0)
    room = away - min(keep, away)
    s = 0.0
    while s < way:
        ahead = min(way, s + max(STEP_M, room / (1.0 + rise)))
        if lead is None:
            x = forward * along(bend, ahead)
            y = forward * aside(bend, ahead)
        else:
            x, y = on_the_way(lead, bend, ahead)
        room = other.distance(x, y, _soonest(v, brake, ahead)) - min(keep + rise * ahead, away)
        if room < -EXACT_M:
            return s
        s = ahead
    return way


def _soonest(v: float, brake: float, s: float) -> float:
    """Return when a robot that brakes from `v` m/s after the lag has driven `s` metres, seconds."""
    rest = s - v * LAG_S
    if rest <= 0.0:
        return s / v
    return LAG_S + (v - math.sqrt(max(0.0, v * v - 2.0 * brake * rest))) / brake
