"""Who drives into what he knows of can always stop before it, even if that stops as well.

Whether two robots that both go on will meet is what stop-if-dangerous asks (`avoid`). This rule asks what happens if
the other does not go on: it brakes now, and stands a little further on. A robot is never faster than lets it stand
before that place, even if its own mind stops in this very moment: wheels without commands go on for a while before
they brake.

Speeds matter within some centimetres alone, so robots that follow each other or pass with room are not slowed.
"""

import math
from typing import Final

from rmr.base.geometry import hypot
from rmr.node.ports import SeenBody

REACTION_BRAKE: Final = 0.7
"""Deceleration of a robot that stops for another one, m/s^2, its own and the other's; the wheels can do 0.8."""
STOPPING_GAP_M: Final = 0.005
"""Gap between hulls that is kept."""
LAG_S: Final = 0.117
"""Wheels go on for 0.1 s after the last command; with the frame in which it is given."""
STOPPING_RANGE_M: Final = 0.09
"""A gap wider than this is room enough to stop from full speed, whatever the other does."""


def stopping_speed(v: float, body: SeenBody, radius: float) -> float:
    """Return the greatest speed up to `v` (m/s) from which a robot stops before `body`, should that brake now."""
    x, y, vx, vy = body.x, body.y, body.vx, body.vy
    touch = 2.0 * radius + STOPPING_GAP_M
    if x <= 0.0 or x * x + y * y > (touch + STOPPING_RANGE_M) * (touch + STOPPING_RANGE_M):
        return v
    on = hypot(vx, vy) / (2.0 * REACTION_BRAKE)
    x, y = x + vx * on, y + vy * on
    if x <= 0.0 or abs(y) >= touch:
        return v
    room = x - math.sqrt(touch * touch - y * y)
    if room <= 0.0:
        return 0.0
    return min(v, REACTION_BRAKE * (math.sqrt(LAG_S * LAG_S + 2.0 * room / REACTION_BRAKE) - LAG_S))
