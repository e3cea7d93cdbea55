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
from rmr.node.motion.avoid import STILL_MPS
from rmr.node.motion.braking import LeadIn
from rmr.node.motion.shield import STEP_M, along, aside, on_the_way
from rmr.node.ports import SeenBody

GAP_M: Final = 0.012
"""What is left between two hulls when both stand, metres."""
HEARD_GAP_M: Final = 0.016
"""The same of a robot that is heard and not seen, or HEARD_SIGMAS of the own estimate if that is more."""
HEARD_SIGMAS: Final = 3.0
RISE: Final = 0.2
"""How much more is left for each metre of the own way: its direction is not exact, nor that of the other one."""
AHEAD_S: Final = 0.25
"""How much of the earlier one's way the later one leaves to it, beyond that to stand, seconds."""
EXACT_M: Final = 1e-4
"""A way along another one comes nearer by this much in rounding."""


@final
class WaysToStand:
    """The law for robots of one shape."""

    __slots__ = ("_scale", "_touch")

    def __init__(self, scale: MotionScale) -> None:
        self._scale: Final = scale
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
        x0 = body.x
        y0 = body.y
        u = hypot(body.vx, body.vy)
        keep = self._touch + gap_m + blur_m(min(self._scale.speed, u))
        ux = uy = end = ahead_m = 0.0
        if u > STILL_MPS:
            ux = body.vx / u
            uy = body.vy / u
            end = u * LAG_S + u * u / (2.0 * BRAKE)
            ahead_m = 0.0 if first else AHEAD_S * u
        else:
            u = 0.0
        if hypot(x0, y0) - end - ahead_m - u * age_s - keep >= way * (1.0 + RISE):
            return 1.0
        begin = _least(u, age_s, 0.0)
        bx = x0 + ux * begin
        by = y0 + uy * begin
        far = end + ahead_m
        away = point_segment_distance(0.0, 0.0, bx, by, x0 + ux * far, y0 + uy * far)
        if away < keep and ahead_m > 0.0:
            far = end
            away = point_segment_distance(0.0, 0.0, bx, by, x0 + ux * far, y0 + uy * far)
        ex = x0 + ux * far
        ey = y0 + uy * far
        floor = min(keep, away)
        rise = 0.0 if away < keep else RISE
        forward = 1.0 if twist.v > 0.0 else -1.0
        bend = twist.w / v
        room = away - floor
        s = 0.0
        while s < way:
            ahead = min(way, s + max(STEP_M, room / (1.0 + rise)))
            if lead is None:
                x = forward * along(bend, ahead)
                y = forward * aside(bend, ahead)
            else:
                x, y = on_the_way(lead, bend, ahead)
            if u > 0.0:
                least = _least(u, age_s, _soonest(v, brake, ahead))
                bx = x0 + ux * least
                by = y0 + uy * least
            room = point_segment_distance(x, y, bx, by, ex, ey) - floor - rise * ahead
            if room < -EXACT_M:
                return brake * (math.sqrt(LAG_S * LAG_S + 2.0 * s / brake) - LAG_S) / v
            s = ahead
        return 1.0


def _soonest(v: float, brake: float, s: float) -> float:
    """Return when a robot that brakes from `v` m/s after the lag has driven `s` metres, seconds."""
    rest = s - v * LAG_S
    if rest <= 0.0:
        return s / v
    return LAG_S + (v - math.sqrt(max(0.0, v * v - 2.0 * brake * rest))) / brake


def _least(u: float, age_s: float, after_s: float) -> float:
    """Return how far at least a robot of `u` m/s is `after_s` from now, metres from where it is taken to be now.

    It may have braked `age_s` ago, and is taken to have driven on.
    """
    brakes = min(age_s + after_s, u / BRAKE)
    return u * brakes - 0.5 * BRAKE * brakes * brakes - u * age_s
