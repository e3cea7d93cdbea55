"""Hellos of other robots keep robots apart where their narrow field of view does not.

- *Cooperative perception.* Robots report several times a second where they are and how fast they drive. A robot that is
  near, heard and not in view is a body for the speed law all the same, at its reported place and with its reported
  velocity: so robots that come together from the side stop for each other.
- *Silence.* A robot that has not been heard for a while is somewhere in a disc around its last reported place, which
  grows at full speed. A driving robot which that disc can reach before it stands, stands until the other is heard;
  two that do not hear each other both stand. A body that is seen in the disc is taken for the silent robot, unless
  another one has reported to be there: what is seen is left to the rules for bodies.
- *Overdue hellos.* Of a robot that is near, unseen and not behind (there its own eyes keep it off), two overdue hellos
  are a silence. A robot that sets out waits for a single one of a parked robot near it, which may have set out unheard.
- *Promise to stay* (`rmr.node.peers.hello`). In a crowd most robots stand and speak seldom: one that has promised to
  stay is not silent meanwhile.
- *Listening.* A robot that has never been heard may be anywhere. A robot that begins stands until each of the roster
  has said where it is, or has had long enough to (`rmr.node.config`).
- *Order.* Hellos tell the rank in the schedule, so a robot knows which of two goes first.
- *Death.* A robot that has been silent for longer than any stall is an obstacle like a parked robot.
"""

import math
from collections.abc import Sequence
from typing import Final, final

from rmr.base.arena import BRAKE, RobotShape
from rmr.base.geometry import Point, Pose, hypot
from rmr.base.motion_scale import scale_of
from rmr.base.time import NEVER, NS_PER_S, Duration, Instant, in_seconds, milliseconds, seconds
from rmr.node.motion.priority import order_key
from rmr.node.ports import SeenBody
from rmr.node.profile import profile_of

SILENT_MOVING: Final[Duration] = milliseconds(1200)
"""A driving robot that has not been heard for so long is silent: five hellos are lost."""
SILENT_PARKED: Final[Duration] = milliseconds(2400)
"""A parked robot that has not been heard for so long is silent: it may have set out."""
DEAD: Final[Duration] = seconds(15)
"""After so long a silence a robot does not move any more: longer than any stall or loss of radio."""
OVERDUE: Final[Duration] = milliseconds(150)
"""A hello that comes so much later than it may is lost: what hellos wait for the air, and are read later."""
BEHIND: Final = math.cos(math.radians(120))
"""Cosine of the bearing beyond which another robot that comes nearer does so ahead of itself."""
POSITION_ERROR_M: Final = 0.03
"""Error of the estimated positions of two robots together."""
PARKED_SPARE_M: Final = 0.02
"""A parked robot is taken to be this much farther away: routes and goals keep clear of it by no more."""
SPARE_BEGIN_M: Final = 0.005
"""A parked robot is not taken to be farther away if no more than this is left between the hulls. Else a robot would
creep on until it touches."""
SPARE_FULL_M: Final = 0.02
"""The spare grows to its full size over this much of the gap."""
SPARE_FROM_M: Final = 0.05
"""A parked robot nearer than this is shifted by less: its direction is hardly more than noise."""
BESIDE_M: Final = 0.1
"""A robot that turns takes in also those heard abeam, at most this far behind its axle: they may be ahead before it
stands."""
JUMP_M: Final = 0.1
"""An estimated position is not corrected by more than this between two updates."""

LISTENS: Final = 1
SILENT: Final = 2
OVERDUE_HELLOS: Final = 4
CUT_OFF: Final = 8
"""Flags of the reasons for which `Hearing.forbids` driving on."""


@final
class ReportedState:
    """What another robot last said about itself. It is never changed."""

    __slots__ = ("at", "parked", "rank", "robot", "settled", "silent", "vx", "vy", "x", "y")

    def __init__(
        self,
        robot: int,
        x: float,
        y: float,
        vx: float,
        vy: float,
        at: Instant,
        parked: bool,
        silent: bool,
        rank: int = 0,
        *,
        settled: bool = False,
    ) -> None:
        self.robot: Final = robot
        self.x: Final = x
        self.y: Final = y
        self.vx: Final = vx
        """m/s over the floor."""
        self.vy: Final = vy
        self.at: Final = at
        self.parked: Final = parked
        """It stands and does not intend to drive."""
        self.silent: Final = silent
        """It has not been heard for longer than chance explains."""
        self.rank: Final = rank
        """Its place in the order, from 1; 0: none."""
        self.settled: Final = settled
        """It has stood for so long that it knows its place better than a robot that drives."""


class Hearing:
    """The others, as one robot has heard of them."""

    __slots__ = (
        "_moving",
        "_parked",
        "_scale",
        "_shape",
        "_silent",
        "_silent_from",
        "ages_s",
        "by_sight",
        "cut_off",
        "fresh",
        "heeds",
        "hides_remembered",
        "listens",
        "order",
        "overdue_at",
        "stands",
    )

    def __init__(self, shape: RobotShape, robots: int = 1) -> None:
        """`robots`: how many there are, by which the time between two hellos goes."""
        self._shape = shape
        self._scale: Final = scale_of(shape)
        profile = profile_of(robots, self._scale.pace)
        self._moving = profile.moving_max
        self._parked = profile.parked_max
        self._silent: list[ReportedState] = []
        self._silent_from: Instant = 0
        """Before this none of those can be near; 0: to be looked at."""
        self.ages_s: list[float] = []
        """How long ago each of those was heard that `around` has returned last, seconds."""
        self.fresh: list[ReportedState] = []
        """Those near that are not silent."""
        self.order = order_key(0, 0)
        """The key of this robot's right of way."""
        self.listens = False
        """A robot that has never been heard may be anywhere."""
        self.cut_off = False
        """Others may presume this robot dead (`rmr.node.peers.link_sensing`)."""
        self.by_sight = False
        """A dead robot may stand near, nobody knows where."""
        self.heeds = LISTENS | SILENT | OVERDUE_HELLOS | CUT_OFF
        """The reasons in force, as flags."""
        self.hides_remembered = False
        """Whether `around` has left out a robot for one that is no longer in view but remembered."""
        self.stands = True
        """The robot does not drive on but would set out."""
        self.overdue_at: Instant = NEVER
        """When one of those near will have been silent for too long; not looked at again before the next update."""

    def update(self, pose: Pose, known: Sequence[ReportedState]) -> None:
        """Take in what is known of the others; a few times a second, by a robot at `pose`."""
        self._silent = [other for other in known if other.silent]
        self._silent_from = 0
        near_m = self._scale.near_m
        self.fresh = [
            other for other in known if not other.silent and hypot(other.x - pose.x, other.y - pose.y) < near_m
        ]
        self.overdue_at = min((self._overdue_at(other) for other in self.fresh), default=NEVER)

    def _overdue_at(self, other: ReportedState) -> Instant:
        """Return from when on one that is near counts as silent."""
        # A robot that is about to set out waits for the very next hello of a parked one: that may set out as well.
        hellos = (1 if self.stands else 2) * self._parked if other.parked else 2 * self._moving
        return other.at + hellos + OVERDUE

    def around(
        self, now: Instant, pose: Pose, seen: Sequence[SeenBody], beyond_m: float = -math.inf, in_view: int = 0
    ) -> list[SeenBody]:
        """Return those heard near a robot at `pose` that are none of the bodies `seen`, in its frame.

        The first `in_view` bodies are in view now; the others are remembered.

        Only those farther ahead than `beyond_m`: one behind does not stop a robot that drives on. One that drives off
        behind is taken to be where it was heard: backing up after it is done blind.
        """
        heard: list[SeenBody] = []
        self.ages_s = []
        self.hides_remembered = False
        if not self.fresh:
            return heard
        own_x = pose.x
        own_y = pose.y
        radius = self._shape.radius
        cos = math.cos(pose.theta)
        sin = math.sin(pose.theta)
        for other in self.fresh:
            parked = other.parked
            vx = other.vx
            vy = other.vy
            age = (now - other.at) / NS_PER_S
            # Dead reckoning since the hello, then into the robot's frame.
            dx = other.x + vx * age - own_x
            dy = other.y + vy * age - own_y
            if parked:
                farther = _farther(hypot(dx, dy), radius)
                dx = dx * farther
                dy = dy * farther
            x = dx * cos + dy * sin
            y = dy * cos - dx * sin
            if x <= beyond_m:
                continue
            # Behind: a robot that drives away may have stopped since, unseen. The nearer place counts.
            if x < 0.0 and not parked:
                was_x = other.x - own_x
                was_y = other.y - own_y
                if hypot(was_x, was_y) < hypot(x, y):
                    x = was_x * cos + was_y * sin
                    y = was_y * cos - was_x * sin
            for index, body in enumerate(seen):
                if hypot(body.x - x, body.y - y) <= radius:
                    self.hides_remembered = self.hides_remembered or index >= in_view
                    break
            else:
                heard.append(SeenBody(x, y, vx * cos + vy * sin, vy * cos - vx * sin))
                self.ages_s.append(age)
        return heard

    def goes_before(self, now: Instant, pose: Pose, bodies: Sequence[SeenBody]) -> dict[SeenBody, bool]:
        """Return for those of `bodies` that drive by the order whether a robot at `pose` goes before them."""
        ranked: dict[SeenBody, bool] = {}
        if not bodies:
            return ranked
        cos = math.cos(pose.theta)
        sin = math.sin(pose.theta)
        radius = self._shape.radius
        for other in self.fresh:
            if other.parked or not other.rank:
                continue
            age = (now - other.at) / NS_PER_S
            dx = other.x + other.vx * age - pose.x
            dy = other.y + other.vy * age - pose.y
            ahead = dx * cos + dy * sin
            left = dy * cos - dx * sin
            for body in bodies:
                if hypot(body.x - ahead, body.y - left) <= radius:
                    ranked[body] = self.order < order_key(other.rank, other.robot)
        return ranked

    @property
    def misses_some(self) -> bool:
        """Whether a robot is silent, or a dead one may be near: then a body may be none of those that are heard."""
        return self.by_sight or bool(self._silent)

    def may_reach(self, now: Instant, pose: Pose, back_m: float, within_m: float) -> bool:
        """Return whether one that drives may have come within `within_m` of the place `back_m` behind a robot's `pose`.

        Only those heard behind the axle are looked at: a robot that backs up leaves the others behind.
        """
        cos = math.cos(pose.theta)
        sin = math.sin(pose.theta)
        for other in self.fresh:
            dx = other.x - pose.x
            dy = other.y - pose.y
            if other.parked or dx * cos + dy * sin > 0.0:
                continue
            age = in_seconds(now - other.at)
            # At full acceleration from the reported speed, towards this robot at worst.
            begins = (self._shape.speed - min(self._shape.speed, hypot(other.vx, other.vy))) / BRAKE
            way = self._shape.speed * age - 0.5 * BRAKE * begins * begins
            if age < begins:
                way = age * (hypot(other.vx, other.vy) + 0.5 * BRAKE * age)
            if hypot(dx + back_m * cos, dy + back_m * sin) - way <= within_m:
                return True
        return False

    def forbids(self, now: Instant, pose: Pose, seen: Sequence[SeenBody]) -> int:
        """Return why a robot at `pose` that sees the bodies `seen` must not drive on, as flags; 0: it may.

        A robot has never been heard (LISTENS), or is silent, or overdue, and neither far away nor in view.
        """
        if self.listens and self.heeds & LISTENS:
            return LISTENS
        if self.cut_off and self.heeds & CUT_OFF:
            return CUT_OFF
        overdue = now > self.overdue_at and self.heeds & OVERDUE_HELLOS != 0
        if not overdue and not self._silent:
            return 0
        why = 0
        near: list[ReportedState] = []
        if now >= self._silent_from and self._silent and self.heeds & SILENT:
            near = [other for other in self._silent if self._reaches(now, other, pose)]
            if near:
                why = SILENT
            else:
                self._silent_from = self._reach_from(now, pose)
        if overdue:
            late = [other for other in self.fresh if self._is_overdue(now, other, pose)]
            if late:
                near += late
                why |= OVERDUE_HELLOS
        return why if near and not self._in_view(now, pose, seen, near) else 0

    def unheard(self, now: Instant, pose: Pose) -> list[int]:
        """Return the robots that a robot at `pose` stands for since they are not heard: the silent, the overdue."""
        silent = [other.robot for other in self._silent if self._reaches(now, other, pose)]
        return silent + [other.robot for other in self.fresh if self._is_overdue(now, other, pose)]

    def _is_overdue(self, now: Instant, other: ReportedState, pose: Pose) -> bool:
        """Return whether one that is near has not been heard when it should have been, and is not behind."""
        if now <= self._overdue_at(other) or not self._reaches(now, other, pose):
            return False
        dx = other.x - pose.x
        dy = other.y - pose.y
        return dx * math.cos(pose.theta) + dy * math.sin(pose.theta) > BEHIND * hypot(dx, dy)

    def _reaches(self, now: Instant, other: ReportedState, pose: Pose) -> bool:
        """Return whether `other` may touch the robot before it stands."""
        # The silent robot's disc grows at full speed. This robot, which brakes evenly, covers half of the way that it
        # would at full speed, and the disc has grown once more by when it stands.
        speed = self._shape.speed
        touch = 2.0 * self._shape.radius + POSITION_ERROR_M + speed * in_seconds(now - other.at)
        if hypot(other.x - pose.x, other.y - pose.y) < touch:
            return True
        stop_s = self._scale.stop_s
        way = 0.5 * speed * stop_s
        x = pose.x + way * math.cos(pose.theta)
        y = pose.y + way * math.sin(pose.theta)
        return hypot(other.x - x, other.y - y) < touch + speed * stop_s

    def _reach_from(self, now: Instant, pose: Pose) -> Instant:
        """Return before when no silent robot can reach this one, wherever both drive: most of a crowd are far away."""
        speed = self._shape.speed
        x = pose.x
        y = pose.y
        touch = 2.0 * self._shape.radius + POSITION_ERROR_M + 1.5 * speed * self._scale.stop_s + JUMP_M
        # Both drive towards each other at full speed at worst, so the gap closes at twice that.
        gap = min(hypot(other.x - x, other.y - y) - speed * in_seconds(now - other.at) for other in self._silent)
        return now + seconds(max(0.0, gap - touch) / (2.0 * speed))

    def _in_view(self, now: Instant, pose: Pose, seen: Sequence[SeenBody], near: Sequence[ReportedState]) -> bool:
        """Return whether each of `near` is a separate body among those seen, for which no other robot accounts."""
        cos = math.cos(pose.theta)
        sin = math.sin(pose.theta)
        places = [Point(pose.x + b.x * cos - b.y * sin, pose.y + b.x * sin + b.y * cos) for b in seen]
        heard = [other for other in self.fresh if other not in near]
        free = [place for place in places if not any(self._may_be(now, other, place) for other in heard)]
        for other in near:
            found = next((place for place in free if self._may_be(now, other, place)), None)
            if found is None:
                return False
            free.remove(found)
        return True

    def _may_be(self, now: Instant, other: ReportedState, place: Point) -> bool:
        """Return whether `other` can have got to `place` since it was heard."""
        reach = self._shape.speed * in_seconds(now - other.at) + 2.0 * POSITION_ERROR_M
        return hypot(other.x - place.x, other.y - place.y) <= reach


def _farther(away_m: float, radius: float) -> float:
    """Return by which factor a parked robot at the distance `away_m` is taken to be farther away."""
    share = min(1.0, max(0.0, (away_m - 2.0 * radius - SPARE_BEGIN_M) / SPARE_FULL_M))
    return 1.0 + share * PARKED_SPARE_M / max(SPARE_FROM_M, away_m)
