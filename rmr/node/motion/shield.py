"""The shield: of a wheel command, the greatest share from which the robot can brake before any place that may be taken.

Pure: what it is given are the command, the own pose, the walls, and for each other robot the disc where it may be. The
invariant and its proof are in docs/safety.md. It has no aims of its own and gives no other command than the one that it
is asked about, slower along the same arc.

A robot that is nearer than the margin already, since an estimate has jumped, may only lead away from what stands there:
at more than `SLOPE`, for the error of the estimates turns the direction in which the other one is.
"""

import math
from collections.abc import Iterable
from typing import Final, final

from rmr.base.arena import BRAKE, REFERENCE, Arena
from rmr.base.geometry import Pose, Twist, hypot
from rmr.base.motion_scale import HEADING_ERROR, LAG_S, blur_m
from rmr.base.time import Duration, in_seconds
from rmr.node.motion.avoid import STILL_MPS
from rmr.node.motion.braking import LeadIn
from rmr.node.ports import SeenBody

SIGMAS: Final = 3.0
"""The margin between two hulls, or a hull and a wall, in standard deviations of their distance."""
SLOPE: Final = 0.1
"""How much the true way may be off the estimated one, as a share of it: 0.03 of the heading, and 1 cm of the place,
seen from 14 cm. A way that leads away from something must do so by that much."""
SLOPE_WAY_M: Final = 0.05
"""On a way to a place that keeps the margin, the error of the place is in the margin already, and has no part in the
slope from here on: HEADING_ERROR is left. The reference robot stands within this."""
APART_MPS: Final = 0.4
"""Robots of up to this speed are kept apart by the speed law alone while they drive: the way to stand is 15 cm."""
STEP_M: Final = 0.002
"""Least step along a way. Between two points that are farther than D from another one, the way is nearer by at most
STEP_M^2 / (8 D): 4 micrometres at 14 cm."""
LEAD_STEPS: Final = 6
"""Pieces in which the way to another arc is judged."""


@final
class TakenDisc:
    """Where the hull of another robot may be until this robot stands. It is never changed."""

    __slots__ = ("keep", "stands", "x", "y")

    def __init__(self, x: float, y: float, keep: float, *, stands: bool) -> None:
        self.x: Final = x
        """Where its centre was, in the robot's frame, metres."""
        self.y: Final = y
        self.keep: Final = keep
        """Least distance between this place and the own centre, metres."""
        self.stands: Final = stands
        """It does not move before this robot stands."""


class Shield:
    """The shield of robots of one shape."""

    __slots__ = ("_brake", "_lag_s", "_speed", "_stop_s", "_touch", "apart_from")

    def __init__(self, radius: float, speed: float, lag_s: float = LAG_S, brake: float = BRAKE) -> None:
        """`radius` of a hull, metres; greatest `speed`, m/s."""
        self._touch: Final = 2.0 * radius
        self._speed: Final = speed
        self._lag_s: Final = lag_s
        self._brake: Final = brake
        self._stop_s: Final = lag_s + speed / brake
        self.apart_from: Final = math.inf if speed <= APART_MPS else REFERENCE.speed
        """The speed that `apart` leaves to the robot, m/s."""

    def taken(self, x: float, y: float, sigma_m: float, unknown: Duration) -> TakenDisc:
        """Return the disc of a robot that was heard at (x, y) in the own frame, metres.

        `sigma_m`: standard deviation of the distance to it. `unknown`: how long it may have been driving, that is the
        time since its last report or since the end of its promise to stay; negative before that.
        """
        drives = max(0.0, in_seconds(unknown) + self._stop_s)
        return TakenDisc(x, y, self._touch + SIGMAS * sigma_m + self._speed * drives, stands=drives == 0.0)

    def parked(self, x: float, y: float, sigma_m: float) -> TakenDisc:
        """Return the disc of a robot that stays at (x, y) in the own frame, metres."""
        return TakenDisc(x, y, self._touch + SIGMAS * sigma_m, stands=True)

    def past(self, twist: Twist, others: list[TakenDisc], lead: LeadIn | None = None) -> float:
        """Return the greatest share of `twist` from which the robot stands before each of `others`; 0 to 1.

        `lead` leads to the arc of `twist`; None: the robot is on it.
        """
        speed = abs(twist.v)
        if speed == 0.0 or not others:
            return 1.0
        way = self._way(speed)
        free = way
        for other in others:
            free = _way_past(twist, lead, other, free)
        return 1.0 if free >= way else self._speed_on(free) / speed

    def apart(self, twist: Twist, bodies: Iterable[SeenBody], sigma_m: float, lead: LeadIn | None = None) -> float:
        """Return the share of `twist` from which the robot stands nearer to its own place than to those of `bodies`.

        Those that drive count, in the robot's frame, where they are now; `sigma_m`: standard deviation of their
        distance. A robot is left the speed `apart_from`. `lead` as in `past`.
        """
        speed = abs(twist.v)
        if speed <= self.apart_from:
            return 1.0
        way = self._way(speed)
        free = way
        radius = 0.5 * self._touch
        for body in bodies:
            drives = hypot(body.vx, body.vy)
            if drives <= STILL_MPS:
                continue  # `past` knows it: it does not come
            away = hypot(body.x, body.y)
            half = 0.5 * (away - SIGMAS * sigma_m - blur_m(min(self._speed, drives))) - radius
            if half < free * (1.0 + SLOPE) and away > 0.0:
                free = _way_before(twist, lead, body.x / away, body.y / away, half, free)
        return 1.0 if free >= way else max(self.apart_from, self._speed_on(free)) / speed

    def within(self, twist: Twist, pose: Pose, arena: Arena, sigma_m: float, lead: LeadIn | None = None) -> float:
        """Return the greatest share of `twist` from which a robot at `pose` stands before each wall; 0 to 1.

        `sigma_m`: standard deviation of the own position. `lead` as in `past`.
        """
        speed = abs(twist.v)
        if speed == 0.0:
            return 1.0
        way = self._way(speed)
        free = _way_within(twist, lead, pose, arena, 0.5 * self._touch + SIGMAS * sigma_m, way)
        return 1.0 if free >= way else self._speed_on(free) / speed

    def ample(self, twist: Twist, sigma_m: float) -> float:
        """Return the clearance from which on no wall slows `twist`, metres: then `within` is 1."""
        return 0.5 * self._touch + SIGMAS * sigma_m + self._way(abs(twist.v)) * (1.0 + SLOPE)

    def _way(self, speed: float) -> float:
        """Return how far a robot moves on until it stands, metres."""
        return speed * self._lag_s + speed * speed / (2.0 * self._brake)

    def _speed_on(self, way: float) -> float:
        """Return the speed from which a robot stands after `way`, m/s: the inverse of `_way`."""
        brake = self._brake
        return brake * (math.sqrt(self._lag_s * self._lag_s + 2.0 * way / brake) - self._lag_s)


def _way_past(twist: Twist, lead: LeadIn | None, other: TakenDisc, way: float) -> float:
    """Return how much of `way`, metres along `lead` and the arc of `twist`, keeps clear of `other`."""
    away = hypot(other.x, other.y)
    keep = other.keep
    if away - keep >= way * (1.0 + SLOPE):
        return way
    if away < keep and not other.stands:
        return 0.0
    floor = min(keep, away)
    leads_away = away < keep
    forward = 1.0 if twist.v > 0.0 else -1.0
    bend = twist.w / abs(twist.v)
    s = 0.0
    room = away - floor
    while s < way:
        ahead = min(way, s + max(STEP_M, room / (1.0 + SLOPE)))
        if lead is None:
            x = forward * along(bend, ahead)
            y = forward * aside(bend, ahead)
        else:
            x, y = on_the_way(lead, bend, ahead)
        room = hypot(other.x - x, other.y - y) - floor - _astray(ahead, leads_away)
        if room < 0.0:
            return s
        s = ahead
    return way


def _way_before(twist: Twist, lead: LeadIn | None, nx: float, ny: float, half: float, way: float) -> float:
    """Return how much of `way`, along `lead` and the arc of `twist`, leads no farther than `half` along (nx, ny)."""
    forward = 1.0 if twist.v > 0.0 else -1.0
    bend = twist.w / abs(twist.v)
    s = 0.0
    ahead = 0.0
    while s < way:
        if lead is None:
            x = forward * along(bend, s)
            y = forward * aside(bend, s)
        else:
            x, y = on_the_way(lead, bend, s)
        room = max(0.0, half) - (x * nx + y * ny) - _astray(s, False)
        if room < 0.0:
            return ahead
        ahead = s
        s = min(way, s + max(STEP_M, room / (1.0 + SLOPE)))
    return way


def _way_within(twist: Twist, lead: LeadIn | None, pose: Pose, arena: Arena, keep: float, way: float) -> float:
    """Return how much of `way` keeps the centre `keep` off walls: along `lead` and the arc of `twist` from `pose`."""
    away = arena.clearance(pose.x, pose.y)
    if away - keep >= way * (1.0 + SLOPE):
        return way
    floor = min(keep, away)
    leads_away = away < keep
    forward = 1.0 if twist.v > 0.0 else -1.0
    bend = twist.w / abs(twist.v)
    cos = forward * math.cos(pose.theta)
    sin = forward * math.sin(pose.theta)
    s = 0.0
    room = away - floor
    while s < way:
        ahead = min(way, s + max(STEP_M, room / (1.0 + SLOPE)))
        if lead is None:
            x = along(bend, ahead)
            y = aside(bend, ahead)
        else:
            x, y = on_the_way(lead, bend, ahead)
        clear = arena.clearance(pose.x + x * cos - y * sin, pose.y + x * sin + y * cos)
        room = clear - floor - _astray(ahead, leads_away)
        if room < 0.0:
            return s
        s = ahead
    return way


def _astray(s: float, leads_away: bool) -> float:
    """Return how far the true way may be off the estimated one after `s` metres, across it."""
    if leads_away or s <= SLOPE_WAY_M:
        return SLOPE * s
    return SLOPE * SLOPE_WAY_M + HEADING_ERROR * (s - SLOPE_WAY_M)


def on_the_way(lead: LeadIn, bend: float, s: float) -> tuple[float, float]:
    """Return the place after `s` metres on `lead`, then on an arc of the curvature `bend`: ahead, to the left, metres.

    The lead is taken in `LEAD_STEPS` pieces: of turns by up to 1 rad the place is off by less than 1/100 of the way.
    """
    part = min(s, lead.way)
    change = (bend - lead.bend) / lead.way if lead.way > 0.0 else 0.0
    step = part / LEAD_STEPS
    x = y = 0.0
    for k in range(LEAD_STEPS):
        at = (k + 0.5) * step
        heading = at * (lead.bend + 0.5 * change * at)
        x += math.cos(heading) * step
        y += math.sin(heading) * step
    heading = part * (lead.bend + 0.5 * change * part)
    ahead = along(bend, s - part)
    left = aside(bend, s - part)
    cos = math.cos(heading)
    sin = math.sin(heading)
    return x + cos * ahead - sin * left, y + sin * ahead + cos * left


def along(bend: float, s: float) -> float:
    """Return the coordinate ahead, metres, after `s` on an arc of the curvature `bend`, 1/m."""
    return s if abs(bend * s) < 1e-6 else math.sin(bend * s) / bend


def aside(bend: float, s: float) -> float:
    """Return the coordinate to the left, metres, after `s` on an arc of the curvature `bend`, 1/m."""
    return 0.5 * bend * s * s if abs(bend * s) < 1e-6 else (1.0 - math.cos(bend * s)) / bend
