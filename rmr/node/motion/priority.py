"""Right of way between robots that hear but do not see each other.

A field of view of 60 degrees is blind to a robot that comes from the side at the same speed. Hellos (position, heading,
goal) fill the gap: of two whose paths cross, the one later in the order keeps clear. It predicts the other as going
straight to its goal at full speed, itself along its route, and takes the greatest share of its speed that keeps the two
apart over the horizon. This only spaces robots out; the rules for bodies come after it and have the last word.

A robot that has not made progress for a while (`Standing`) has no right of way, else two robots could wait for each
other endlessly; detours go around it, seen or not.
"""

import math
from collections.abc import Sequence
from typing import Final, final

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, Pose, hypot, point_segment_distance
from rmr.base.motion_scale import MotionScale, scale_of
from rmr.base.time import Duration, Instant, in_seconds, milliseconds, seconds
from rmr.node.motion.route import Route

ROUNDING_M: Final = 1e-6
"""For rounding."""
SHARES: Final[tuple[float, ...]] = (1.0, 0.6, 0.3, 0.0)
"""Speeds that are tried, as shares of the greatest."""
BETTER_M: Final = 0.005
"""Where none is enough, a lower speed is taken if it keeps the two farther apart by more than this."""
AGE_MAX: Final[Duration] = seconds(2)
"""A hello older than this is not used for prediction."""
STOOD: Final[Duration] = milliseconds(1500)
"""A robot that has stayed near one place for this long, times the tempo, stands, whatever it intends."""
STOOD_M: Final = 0.1
"""Radius of the place that a standing robot has stayed near, times the size: a reverse manoeuvre and the return get it
nowhere."""


@final
class Heard:
    """What another robot that drives said about itself. It is never changed."""

    __slots__ = ("at", "goal", "pose", "rank", "robot")

    def __init__(self, robot: int, pose: Pose, goal: Point | None, rank: int, at: Instant) -> None:
        self.robot: Final = robot
        self.pose: Final = pose
        self.goal: Final = goal
        """Where it drives; None: straight on."""
        self.rank: Final = rank
        """Its place in the order, from 1; 0: none, after all ranks."""
        self.at: Final = at


class Standing:
    """Notices which of the robots that drive do not get anywhere."""

    __slots__ = ("_since", "_stood", "_stood_m", "points")

    def __init__(self, shape: RobotShape) -> None:
        scale = scale_of(shape)
        self._stood: Final = round(STOOD * scale.tempo)
        self._stood_m: Final = STOOD_M * scale.size
        self._since: dict[int, tuple[float, float, Instant]] = {}
        """By robot where it came to stay, and when."""
        self.points: dict[int, Point] = {}
        """Where those that stand are, by robot."""

    def update(self, now: Instant, others: Sequence[Heard]) -> None:
        """Take in what was heard; robots that are not among `others` are forgotten."""
        known = self._since
        since: dict[int, tuple[float, float, Instant]] = {}
        points: dict[int, Point] = {}
        for other in others:
            robot = other.robot
            x = other.pose.x
            y = other.pose.y
            heard_at = other.at
            held = known.get(robot)
            if held is None or hypot(x - held[0], y - held[1]) > self._stood_m:
                held = x, y, now
            elif now - held[2] >= self._stood and now - heard_at <= AGE_MAX:
                points[robot] = Point(x, y)
            since[robot] = held
        self._since = since
        self.points = points


def order_key(rank: int, robot: int) -> int:
    """Return the key of the right of way, rank before robot in one number: smaller goes first."""
    return ((rank or 1 << 16) << 16) + robot


def share_of_speed(now: Instant, route: Route, s: float, shape: RobotShape, others: Sequence[Heard]) -> float:
    """Return the share of the greatest speed that keeps clear of `others`, all of whom go first.

    When none does, the one that keeps the greatest distance.
    """
    here = route.point(s)
    speed = shape.speed
    scale = scale_of(shape)
    # Robots that cannot come within `keep` in the horizon, even if both drive towards each other, are left out first.
    keep = 2.0 * shape.radius + scale.conflict_gap_m
    reach = keep + (2.0 * scale.horizon_s + in_seconds(AGE_MAX)) * speed
    near = [other for other in others if abs(other.pose.x - here.x) <= reach and abs(other.pose.y - here.y) <= reach]
    tracks = [_track(now, other, scale) for other in near if _may_meet(now, other, here, scale, keep)]
    if not tracks:
        return 1.0
    best = -math.inf
    best_share = 1.0
    for share in SHARES:
        least = math.inf  # the least distance of centres at this share of the speed
        for i in range(scale.steps):
            x, y = route.place(s + share * speed * scale.step_s * i)
            for track in tracks:
                other_x, other_y = track[i]
                away = hypot(other_x - x, other_y - y)
                least = away if away < least else least
        if least >= keep:
            return share
        if least > best + BETTER_M:
            best = least
            best_share = share
    return best_share


def _may_meet(now: Instant, other: Heard, here: Point, scale: MotionScale, keep: float) -> bool:
    """Return whether what was heard of `other` still holds and it may come nearer than `keep` to a robot at `here`.

    Most robots of a crowd cannot, and cost no more than this.
    """
    if now - other.at > AGE_MAX:
        return False
    age = in_seconds(now - other.at)
    speed = scale.speed
    horizon_s = scale.horizon_s
    # This robot stays within a disc of radius `near`; the other one covers a segment of its course.
    near = keep + horizon_s * speed
    x = other.pose.x
    y = other.pose.y
    far = near + speed * (age + horizon_s)
    if abs(x - here.x) > far or abs(y - here.y) > far:
        return False
    cos, sin, way = _course(other)
    gone = min(way, speed * (age + horizon_s))
    return point_segment_distance(here.x, here.y, x, y, x + gone * cos, y + gone * sin) <= near + ROUNDING_M


def _track(now: Instant, other: Heard, scale: MotionScale) -> list[tuple[float, float]]:
    """Return where `other` will be, step by step, as bare numbers."""
    x = other.pose.x
    y = other.pose.y
    (cos, sin, way) = _course(other)
    age = in_seconds(now - other.at)
    gone = [min(way, scale.speed * (age + scale.step_s * i)) for i in range(scale.steps)]
    return [(x + g * cos, y + g * sin) for g in gone]


def _course(other: Heard) -> tuple[float, float, float]:
    """Return the direction in which `other` drives, as cosine and sine, and how far, metres."""
    x = other.pose.x
    y = other.pose.y
    theta = other.pose.theta
    if other.goal is None:
        return math.cos(theta), math.sin(theta), math.inf
    goal_x = other.goal.x
    goal_y = other.goal.y
    way = hypot(goal_x - x, goal_y - y)
    if way > 1e-6:
        return (goal_x - x) / way, (goal_y - y) / way, way
    return math.cos(theta), math.sin(theta), way
