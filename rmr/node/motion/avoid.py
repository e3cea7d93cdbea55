"""Stop if dangerous (paper IV.E), by closing speed rather than by mere sight, and the way out of stand-offs.

For each body in the field of view the closest approach under the relative velocity is computed. A body is
dangerous when that miss distance is below two radii and 25 mm and this robot itself closes in. Then the speed
falls in proportion to the gap that is left, down to a stop; and it is never so great that the robot could not stop
before a body that brakes (`stopping`). A body that comes from behind, or that this robot does not close in on, never
stops it, and past one that stands abeam it creeps. Of two that cross or converge, the later in the order gives way
early, the other late, so that one of them goes first; without an order, the one that has the other on its right.

A robot that turns is judged twice: as if it drove on straight, and along the chord of the arc on which it would brake.
The second covers a body abeam on the inner side of the turn, which is out of view and not ahead until shortly before
the contact.

The field of view is narrow: a body that has left it is remembered for a moment (`BodyMemory`) where it would be now,
and if it crept, where it was, for it may have stopped; so turning away from a body does not make it vanish. It is
forgotten as soon as its robot says where it is.

Robots that stop each other for longer than their patience are in a stand-off (`DeadlockDetector`). The way out is a
detour around where the others are, biased to the right, so that two robots face to face both pass on the right
hand; where there is no way around, a little way back.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, final

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, Pose, Twist, hypot
from rmr.base.time import Duration, Instant, in_seconds, seconds
from rmr.node.motion.hearing import ReportedState
from rmr.node.motion.stopping import BRAKE, LAG_S, stopping_speed
from rmr.node.ports import SeenBody

MISS_MARGIN_M: Final = 0.025
"""Closest approach nearer than two radii and this is dangerous."""
STOP_GAP_M: Final = 0.02
"""Gap between hulls at which the robot stands."""
FOLLOW_GAP_M: Final = 0.03
"""A robot that follows another keeps at least this gap."""
TOUCHING_M: Final = 0.005
"""Gap at which nothing but standing still is safe."""
ABEAM_M: Final = 0.005
"""A standing body that going on brings nearer by less than this is abeam ..."""
ABEAM_GAP_M: Final = 0.02
"""... and if it comes no nearer than this (what is heard of a parked robot is taken to be farther away) ..."""
ABEAM_MPS: Final = 0.04
"""... is passed at this speed."""
SLOPE_PER_S: Final = 2.5
"""Speed allowed per metre of gap, 1/s."""
LATE_SLOPE_PER_S: Final = 6.0
"""Likewise towards a body that gives way."""
HORIZON_S: Final = 3.0
"""A gap that closes later than this is no danger yet."""
STILL_MPS: Final = 0.03
"""A body slower than this stands."""
CREEPING_MPS: Final = 0.1
"""A body slower than this may stop at any moment: it manoeuvres."""
MEMORY_S: Final = 0.8
"""How long a body that has left the field of view is remembered."""
REMEMBERED_MAX: Final = 8
"""Bodies remembered at once; no more fit around a robot within its view."""
EDGE_M: Final = 0.02
EDGE: Final = 0.05
"""So near to the edge of the field of view, in depth and in radians, a body need not be seen."""
DRIVES_MPS: Final = 0.02
"""A robot no faster than this does not drive."""
KEPT_SHARE: Final = 0.25
"""One that may drive at no more than this share of what it wants is kept standing."""
PATIENCE_S: Final = 0.7
"""Standing before another for longer than this is a stand-off."""
EARLY_PATIENCE: Final[Duration] = seconds(3)
"""More of it before the own slot: then standing is in order, but who gets no nearer never gets a slot in time."""
PATIENCE_STEP_S: Final = 0.2
"""Robots differ in patience by multiples of this, so that not all act at once."""
BIAS_M: Final = 0.05
"""How far the detour takes the other to be to the left of where it is."""
AROUND_RADII: Final = 8.0
"""Others farther away than this have no part in a stand-off."""
ENDURED: Final[Duration] = seconds(8)
"""A stand-off that has lasted for so long is not dissolved by detours and ways back ..."""
ENDURED_M: Final = 0.1
"""... if the robot is no farther than this from where it began."""
GHOST_S: Final = 2.5
"""How long a detour keeps off the place where the other was."""
BACK_S: Final = 0.4
"""Length of the way back that makes room for a detour; twice as long where there is none."""
BACK_TRIES_MAX: Final = 5
"""Of the robot that gives way inside a bottleneck: each time it goes farther back, at most so many times as far."""
BACK_MPS: Final = 0.08
"""Speed of a way back."""
TURNS: Final = 0.1
"""A robot whose direction of travel changes by less than this while it brakes counts as driving straight, radians."""
NOBODY: Final[Mapping[SeenBody, bool]] = MappingProxyType({})
"""No body that has a place in the order."""


def way_back_s(tries: int, found: bool, way: int | None) -> float:
    """Return how long the `tries`-th way back out of a stand-off takes, seconds; `found`: a way around the others.

    Head to head in a bottleneck that is entered from both sides (`way`, by which mouth; None elsewhere) there is no way
    around, and if both went back, both would come back. So those that entered by the second mouth give way, all
    of them and ever farther, until they are out; the others stay and follow up.
    """
    if found or way is None:
        return BACK_S if found and tries % 3 else 2.0 * BACK_S
    return 2.0 * BACK_S * min(tries, BACK_TRIES_MAX) if way else 0.0


def safe_speed(v: float, bodies: Sequence[SeenBody], radius: float, first: Mapping[SeenBody, bool] = NOBODY) -> float:
    """Return the greatest forward speed up to `v` (m/s) that no body makes dangerous.

    `first`: whether this robot goes before a body, of those that have a place in the order.
    """
    least = v
    for body in bodies:
        if body.x > 0.0:
            least = min(least, _limit(v, body, radius, first.get(body) if first else None))
            least = min(least, stopping_speed(v, body, radius))
    return max(0.0, least)


def _limit(v: float, body: SeenBody, radius: float, first: bool | None) -> float:
    x, y, bvx, bvy = body.x, body.y, body.vx, body.vy
    if x <= 0.0:
        return v
    away = hypot(x, y)
    rvx = bvx - v
    closing = -(x * rvx + y * bvy)
    gap = away - 2.0 * radius
    if closing <= 0.0 and (gap > FOLLOW_GAP_M or x < 0.5 * away):
        return v
    if closing > 0.0:
        if gap * away > HORIZON_S * closing:
            return v
        t = closing / (rvx * rvx + bvy * bvy)
        miss = hypot(x + rvx * t, y + bvy * t)
        if miss >= 2.0 * radius + MISS_MARGIN_M:
            return v
        if _better_gone(body, miss, radius):
            return v
        if away - miss < ABEAM_M and miss >= 2.0 * radius + ABEAM_GAP_M and hypot(bvx, bvy) < STILL_MPS:
            return min(v, ABEAM_MPS)
    if gap <= TOUCHING_M:
        return 0.0
    recede = max(0.0, (x * bvx + y * bvy) / away)
    late = y > 0.0 and bvy < -STILL_MPS if first is None else first
    return min(v, max(0.0, (LATE_SLOPE_PER_S if late else SLOPE_PER_S) * (gap - STOP_GAP_M) + recede))


def _better_gone(body: SeenBody, miss: float, radius: float) -> bool:
    """Return whether going on clears a moving body, and by more than standing still would.

    One that creeps may stop: going on must clear it where it is, too.
    """
    speed, least = hypot(body.vx, body.vy), 2.0 * radius + TOUCHING_M
    if speed < STILL_MPS or miss < least or (speed < CREEPING_MPS and abs(body.y) < least):
        return False
    return abs(body.x * body.vy - body.y * body.vx) / speed < miss


def limit_twist(
    twist: Twist, bodies: Sequence[SeenBody], radius: float, first: Mapping[SeenBody, bool] = NOBODY
) -> Twist:
    """Return `twist`, slowed along its arc as the bodies around demand (see `safe_speed`)."""
    if twist.v <= 0.0 or not bodies:
        return twist
    v = safe_speed(twist.v, bodies, radius, first)
    turn = _chord_angle(twist)
    if abs(turn) > TURNS:
        turned = [_turned(body, turn) for body in bodies]
        ranked = {new: first[old] for new, old in zip(turned, bodies, strict=True) if old in first} if first else first
        v = safe_speed(v, turned, radius, ranked)
    return twist if v >= twist.v else Twist(v, twist.w * v / twist.v)


def _chord_angle(twist: Twist) -> float:
    """Return the angle from the robot's heading to the chord of the arc on which it brakes to a stop, radians."""
    return 0.5 * twist.w * (LAG_S + twist.v / (2.0 * BRAKE))


def _turned(body: SeenBody, angle: float) -> SeenBody:
    """Return `body` in the frame of the robot turned by `angle`, radians to the left."""
    cos, sin = math.cos(angle), math.sin(angle)
    return SeenBody(
        body.x * cos + body.y * sin,
        body.y * cos - body.x * sin,
        body.vx * cos + body.vy * sin,
        body.vy * cos - body.vx * sin,
    )


@final
class _Seen:
    """A body on the floor: where it was and how it moved when last seen. It is never changed."""

    __slots__ = ("at", "vx", "vy", "x", "y")

    def __init__(self, x: float, y: float, vx: float, vy: float, at: Instant) -> None:
        self.x: Final = x
        self.y: Final = y
        self.vx: Final = vx
        self.vy: Final = vy
        self.at: Final = at

    def is_told_of(self, other: ReportedState, radius: float) -> bool:
        """Return whether this is `other`, who has said since where it is."""
        age = in_seconds(other.at - self.at)
        away = hypot(self.x + self.vx * age - other.x, self.y + self.vy * age - other.y)
        return age > 0.0 and away < radius


class BodyMemory:
    """The bodies around: those in view and those that have just left it."""

    __slots__ = ("_memory", "_shape")

    def __init__(self, shape: RobotShape) -> None:
        self._shape = shape
        self._memory: list[_Seen] = []

    def update(
        self, now: Instant, pose: Pose, bodies: Sequence[SeenBody], heard: Sequence[ReportedState] = ()
    ) -> Sequence[SeenBody]:
        """Take in what is seen from `pose` and was `heard`; return all bodies seen around in the robot's frame."""
        if not bodies and not self._memory:
            return bodies
        cos, sin = math.cos(pose.theta), math.sin(pose.theta)
        fresh = [
            _Seen(
                pose.x + b.x * cos - b.y * sin,
                pose.y + b.x * sin + b.y * cos,
                b.vx * cos - b.vy * sin,
                b.vx * sin + b.vy * cos,
                now,
            )
            for b in bodies
        ]
        around = list(bodies)
        kept = fresh
        for old in self._memory:
            age = in_seconds(now - old.at)
            x, y = old.x + old.vx * age, old.y + old.vy * age
            if age > MEMORY_S or any(hypot(x - f.x, y - f.y) < self._shape.radius for f in fresh):
                continue
            if any(old.is_told_of(other, self._shape.radius) for other in heard):
                continue
            moving = _in_frame(pose, cos, sin, x, y, old.vx * cos + old.vy * sin, old.vy * cos - old.vx * sin)
            if not self._in_view(moving):
                kept.append(old)
                around.append(moving)
                if 0.0 < hypot(old.vx, old.vy) < CREEPING_MPS:
                    around.append(_in_frame(pose, cos, sin, old.x, old.y, 0.0, 0.0))
        self._memory = kept[:REMEMBERED_MAX]
        return around

    def _in_view(self, body: SeenBody) -> bool:
        """Return whether the body would surely be seen if it were there."""
        away = hypot(body.x, body.y)
        return (
            away < self._shape.view_depth + self._shape.radius - EDGE_M
            and abs(math.atan2(body.y, body.x)) < 0.5 * self._shape.view_angle - EDGE
        )

    def places(self, now: Instant) -> list[Point]:
        """Return where the bodies around are now, on the floor."""
        return [Point(s.x + s.vx * in_seconds(now - s.at), s.y + s.vy * in_seconds(now - s.at)) for s in self._memory]


def with_heard(seen: Sequence[Point], heard: Iterable[Point], radius: float) -> list[Point]:
    """Return the places `seen` and those `heard` that are none of them: the view is narrow."""
    return [*seen, *(p for p in heard if all(hypot(p.x - q.x, p.y - q.y) > radius for q in seen))]


def _in_frame(pose: Pose, cos: float, sin: float, x: float, y: float, vx: float, vy: float) -> SeenBody:
    """Return a body at floor point (x, y) in the frame of a robot at `pose`; (vx, vy) is in that frame already."""
    dx, dy = x - pose.x, y - pose.y
    return SeenBody(dx * cos + dy * sin, dy * cos - dx * sin, vx, vy)


class DeadlockDetector:
    """Notices that others keep this robot standing."""

    __slots__ = ("_at", "_at_since", "_patience", "_since", "ghosts", "ghosts_until", "tries", "walks")

    def __init__(self, robot: int) -> None:
        self._patience = seconds(PATIENCE_S + PATIENCE_STEP_S * (robot % 4))
        self._since: Instant | None = None
        self.ghosts: tuple[Point, ...] = ()
        self.ghosts_until: Instant = 0
        self.tries = 0
        self._at: Point | None = None
        self._at_since: Instant = 0
        self.walks = 0
        """How often the robot has had to walk away."""

    def reset(self) -> None:
        """Forget everything: a new drive begins."""
        self._since, self._at, self.ghosts = None, None, ()
        self.tries = self.walks = 0

    def blocked(self, now: Instant, wish: Twist, allowed: Twist, more: Duration = 0) -> bool:
        """Note this tick; return whether the patience, and `more`, is over (once per patience)."""
        if wish.v <= DRIVES_MPS or allowed.v > KEPT_SHARE * wish.v:
            if allowed.v > DRIVES_MPS:
                self._since = None
            return False
        if self._since is None:
            self._since = now
        if now - self._since < self._patience + more:
            return False
        self._since = None  # turning to the way out is no standing before another
        self.tries += 1
        return True

    def mark(self, now: Instant, pose: Pose, places: Sequence[Point], radius: float) -> None:
        """Remember `places` of others as obstacles of the detour, made wider on the left of the way to each."""
        ghosts = []
        for x, y in places:
            away = hypot(x - pose.x, y - pose.y)
            if away > AROUND_RADII * radius or away < 1e-6:
                continue
            shift = BIAS_M / away
            ghosts += [Point(x, y), Point(x - (y - pose.y) * shift, y + (x - pose.x) * shift)]
        self.ghosts, self.ghosts_until = tuple(ghosts), now + seconds(GHOST_S)

    def around(self, now: Instant, standing: Iterable[Point]) -> Iterable[Point]:
        """Return what a new way leads around: the ghosts, later in the stand-off the others that are `standing`."""
        if now < self.ghosts_until:
            return self.ghosts
        return standing if self.tries else ()

    def endures(self, now: Instant, pose: Pose, *, walks: bool) -> bool:
        """Note where a way out is sought; return whether the robot must walk away: none has led away from there.

        Whoever `walks` away and gets stuck again does so at once, elsewhere.
        """
        if self._at is None or hypot(self._at.x - pose.x, self._at.y - pose.y) > ENDURED_M:
            self._at, self._at_since = Point(pose.x, pose.y), now
        if now - self._at_since < ENDURED and not (walks and self.walks):
            return False
        self.walks += 1
        return True
