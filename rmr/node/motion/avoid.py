"""Stop if dangerous (paper IV.E), by the closest point of approach rather than by mere sight.

For each body the closest point of approach (CPA) under the relative velocity is computed. A body is dangerous when the
distance at the CPA is below two radii and 25 mm and this robot itself closes in. Then the speed falls in proportion
to the gap that is left, down to a stop. A body that comes from behind, or that this robot does not close in on, never
stops it, and past one that stands abeam it creeps. Of two that cross or converge, the later in the order gives way
early, the other late, so that one of them goes first; without an order, the one that has the other on its right.

The speed law (`hazards`) applies this to every body, straight ahead and along the chord of the arc. All functions are
pure: a body is in the robot's own frame, x ahead and y to the left, with its velocity over the ground in that frame.
"""

import math
from typing import Final

from rmr.base.arena import REFERENCE
from rmr.base.geometry import Twist, hypot
from rmr.base.motion_scale import LAG_S, PLANNED_BRAKE, REACTION_BRAKE, MotionScale, blur_m
from rmr.node.ports import SeenBody

CPA_MARGIN_M: Final = 0.025
"""A closest point of approach nearer than two radii and this is dangerous."""
STOP_GAP_M: Final = 0.02
"""Gap between hulls at which the robot stands."""
FOLLOW_GAP_M: Final = 0.03
"""A robot that follows another keeps at least this gap."""
TOUCHING_M: Final = 0.005
"""Gap at which nothing but standing still is safe."""
ABEAM_NEARER_M: Final = 0.005
"""A standing body that driving on brings nearer by less than this is abeam."""
ABEAM_GAP_M: Final = 0.02
"""A body abeam is passed slowly if the CPA leaves at least this gap: what is heard of a parked robot is taken to be
farther away than it is."""
ABEAM_MPS: Final = 0.04
"""Speed with which a body abeam is passed."""
SLOPE_PER_S: Final = 2.5
"""Speed allowed per metre of gap, 1/s, up to the speed of the reference robot. Beyond it the robot brakes evenly, with
PLANNED_BRAKE: a slope would ask of the wheels more than they can."""
LATE_SLOPE_PER_S: Final = 6.0
"""Speed allowed per metre of gap towards a body that gives way, 1/s; beyond it the robot brakes with REACTION_BRAKE."""
EVEN_FROM_MPS: Final = REFERENCE.speed
"""Speed beyond which it is braked evenly; at PLANNED_BRAKE / SLOPE_PER_S both laws have the same slope."""
CPA_HORIZON_S: Final = 3.0
"""A gap that closes later than this is no danger yet."""
STILL_MPS: Final = 0.03
"""A body slower than this stands."""
CREEPING_MPS: Final = 0.1
"""A body slower than this may stop at any moment: it manoeuvres."""


def closing_limit(v: float, body: SeenBody, scale: MotionScale, late: bool) -> float:
    """Return the greatest forward speed up to `v`, m/s, that `body` does not make dangerous.

    `late`: this robot goes first, and slows down only if the other does not give way in time.
    """
    x = body.x
    y = body.y
    body_vx = body.vx
    body_vy = body.vy
    if x <= 0.0:
        return v  # behind the axle: driving on leads away from it
    distance = hypot(x, y)
    touch = 2.0 * scale.radius
    gap = distance - touch
    blur = blur_m(min(scale.speed, hypot(body_vx, body_vy)))
    relative_vx = body_vx - v
    # Closing speed along the line of centres, times the distance; > 0: the gap shrinks.
    closing = -(x * relative_vx + y * body_vy)
    if closing <= 0.0:
        alongside = x < 0.5 * distance  # more than 60 degrees off the bow: it cannot be run into
        if gap > FOLLOW_GAP_M + blur or alongside:
            return v
    else:
        # The gap closes at `closing / distance`, so this compares its time with the horizon without a division.
        if gap * distance > CPA_HORIZON_S * closing:
            return v
        # At the time of the CPA the line of centres is square to the relative velocity.
        tcpa = closing / (relative_vx * relative_vx + body_vy * body_vy)
        cpa = hypot(x + relative_vx * tcpa, y + body_vy * tcpa)
        if cpa >= touch + CPA_MARGIN_M + blur:
            return v
        if _better_gone(body, cpa, touch + TOUCHING_M + blur):
            return v
        # A standing body right beside: stopping would not help, for turning away needs some way.
        abeam = distance - cpa < ABEAM_NEARER_M and cpa >= touch + ABEAM_GAP_M
        if abeam and hypot(body_vx, body_vy) < STILL_MPS:
            return min(v, ABEAM_MPS)
    if gap <= TOUCHING_M:
        return 0.0
    # A body that drives off ahead may be followed at the speed with which it recedes.
    receding = max(0.0, (x * body_vx + y * body_vy) / distance)
    return min(v, max(0.0, _approach_speed(gap - STOP_GAP_M - blur, late) + receding))


def _approach_speed(room: float, late: bool) -> float:
    """Return the speed allowed towards a body from which `room` metres are left; negative: too near already."""
    slope = LATE_SLOPE_PER_S if late else SLOPE_PER_S
    speed = slope * room
    if speed <= EVEN_FROM_MPS:
        return speed
    brake = REACTION_BRAKE if late else PLANNED_BRAKE
    return math.sqrt(EVEN_FROM_MPS * EVEN_FROM_MPS + 2.0 * brake * (room - EVEN_FROM_MPS / slope))


def gives_way_late(body: SeenBody) -> bool:
    """Return whether a robot without a place in the order goes before `body`: it comes from the left."""
    return body.y > 0.0 and body.vy < -STILL_MPS


def _better_gone(body: SeenBody, cpa: float, least: float) -> bool:
    """Return whether driving on clears a moving body, by `least` and by more than standing still would.

    One that creeps may stop: driving on must clear it where it is, too.
    """
    speed = hypot(body.vx, body.vy)
    if speed < STILL_MPS or cpa < least or (speed < CREEPING_MPS and abs(body.y) < least):
        return False
    # Were this robot to stand, the body would pass it at the distance of its line of travel from the origin.
    passes_at = abs(body.x * body.vy - body.y * body.vx) / speed
    return passes_at < cpa


def chord_angle(twist: Twist) -> float:
    """Return the angle from the robot's heading to the chord of the arc on which it brakes to a stop, radians."""
    # The chord is off by half of the turn; the turn lasts for the lag and, at constant deceleration, as long as
    # driving on at half of the speed does.
    return 0.5 * twist.w * (LAG_S + twist.v / (2.0 * REACTION_BRAKE))


def turned(body: SeenBody, angle: float) -> SeenBody:
    """Return `body` in the frame of the robot turned by `angle`, radians to the left."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    return SeenBody(
        body.x * cos + body.y * sin,
        body.y * cos - body.x * sin,
        body.vx * cos + body.vy * sin,
        body.vy * cos - body.vx * sin,
    )
