"""Stop if dangerous (paper IV.E), by closing speed rather than by mere sight.

For each body in the field of view the closest approach under the relative velocity is computed. A body is
dangerous when that miss distance is below two radii and 25 mm and this robot itself closes in. Then the speed
falls in proportion to the gap that is left, down to a stop. A body that comes from behind, or that this robot
does not close in on, never stops it.
"""

import math
from collections.abc import Sequence

from rmr.base.geometry import Twist
from rmr.node.ports import SeenBody

MISS_MARGIN_M = 0.025
"""Closest approach nearer than two radii and this is dangerous."""
STOP_GAP_M = 0.012
"""Gap between hulls at which the robot stands."""
SLOPE_PER_S = 2.5
"""Speed allowed per metre of gap, 1/s."""
HORIZON_S = 3.0
"""Approaches later than this are no danger yet."""


def safe_speed(v: float, bodies: Sequence[SeenBody], radius: float) -> float:
    """Return the greatest forward speed up to `v` (m/s) that no body in view makes dangerous."""
    limit = v
    for body in bodies:
        if limit <= 0.0:
            break
        limit = min(limit, _limit(v, body, radius))
    return max(0.0, limit)


def _limit(v: float, body: SeenBody, radius: float) -> float:
    x, y, bvx, bvy = body
    away = math.hypot(x, y)
    if x <= 0.0 or away <= 0.0:
        return v
    rvx = bvx - v
    closing = -(x * rvx + y * bvy)
    if closing <= 0.0:
        return v
    speed2 = rvx * rvx + bvy * bvy
    t = closing / speed2
    miss = math.hypot(x + rvx * t, y + bvy * t)
    if t > HORIZON_S or miss >= 2.0 * radius + MISS_MARGIN_M:
        return v
    gap = away - 2.0 * radius - STOP_GAP_M
    if gap <= 0.0:
        return 0.0
    recede = max(0.0, (x * bvx + y * bvy) / away)
    return min(v, SLOPE_PER_S * gap + recede)


def limit_twist(twist: Twist, bodies: Sequence[SeenBody], radius: float) -> Twist:
    """Return `twist`, slowed along its arc as the bodies in view demand."""
    if twist.v <= 0.0 or not bodies:
        return twist
    v = safe_speed(twist.v, bodies, radius)
    return twist if v >= twist.v else Twist(v, twist.w * v / twist.v)
