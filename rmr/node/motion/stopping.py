"""Invariant: a robot can always stop short of any body that it knows, even if that body brakes now.

Whether two robots that both drive on will meet is the question of stop-if-dangerous (`avoid`). This rule covers the
case that the other does not drive on: it brakes now, and stands a little farther on. The speed is limited so that this
robot stands before that place, even if its own process stops in this very moment: wheels without commands go on for
`LAG_S` before they brake.

It matters within two ways to stand only, some centimetres for the reference robot, so robots that follow each other or
pass with room are not slowed.
"""

import math
from typing import Final

from rmr.base.geometry import hypot
from rmr.base.motion_scale import LAG_S, REACTION_BRAKE, MotionScale, blur_m
from rmr.node.ports import SeenBody

STOPPING_GAP_M: Final = 0.005
"""Gap between hulls that is left when both robots stand."""


def stopping_speed(v: float, body: SeenBody, scale: MotionScale) -> float:
    """Return the greatest speed up to `v` (m/s) from which a robot stops before `body`, should that brake now."""
    x = body.x
    y = body.y
    vx = body.vx
    vy = body.vy
    speed = hypot(vx, vy)
    touch = 2.0 * scale.radius + STOPPING_GAP_M + blur_m(min(scale.speed, speed))
    reach = touch + scale.stop_range_m
    if x <= 0.0 or x * x + y * y > reach * reach:
        return v
    # The other one brakes evenly: it moves on for v^2 / (2 a) in its direction, that is for v * (|v| / (2 a)).
    on = speed / (2.0 * REACTION_BRAKE)
    x = x + vx * on
    y = y + vy * on
    if x <= 0.0 or abs(y) >= touch:
        return v
    # Driving straight on, the hulls touch where the other's centre is on the circle of radius `touch`.
    room = x - math.sqrt(touch * touch - y * y)
    if room <= 0.0:
        return 0.0
    # room = v LAG + v^2 / (2 a), solved for v.
    return min(v, REACTION_BRAKE * (math.sqrt(LAG_S * LAG_S + 2.0 * room / REACTION_BRAKE) - LAG_S))
