"""What a robot knows of itself and of the others: the areas it stands in, the peers it has heard.

Peers are known by their hellos alone.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from rmr.base.arena import Area, RobotShape
from rmr.base.geometry import Point, Pose, hypot
from rmr.base.motion_scale import scale_of
from rmr.base.time import NEVER, Duration, Instant, in_seconds, seconds
from rmr.node.motion.estimate import AT_ENTER_M
from rmr.node.motion.hearing import DEAD, SILENT_MOVING, SILENT_PARKED, ReportedState
from rmr.node.motion.priority import Heard
from rmr.node.payloads import Hello
from rmr.node.peers.hello import STAYS
from rmr.node.peers.link_sensing import CUT_OFF_MAX, LinkSensing
from rmr.node.ports import SeenBody

AT_LEAVE_M: Final = 0.08
"""Distance at which a robot leaves a place; larger than `AT_ENTER_M`, so that localisation noise causes no flicker."""

HEARD: Final[Duration] = seconds(3)
"""Age of a peer's last frame up to which it is a neighbor; hellos come every 0.2 to 1 s."""
CLAIM_KNOWN: Final[Duration] = seconds(15)
"""Time for which a silent robot keeps the place that it has claimed; as an obstacle it stays without limit."""

MOVED_M: Final = 0.015
"""Distance between two hellos below which the sender may have stood: positions in hellos are rounded to centimetres."""
SETTLES: Final[Duration] = seconds(1)
"""After this time at one place the estimate of a robot has settled (docs/safety.md, the shield)."""
CLOSE_M: Final = 0.01
"""Gap between two hulls below which they count as touching."""


class Percept(NamedTuple):
    """What `robot.sense()` gives to an action."""

    pose: Pose | None
    bodies: tuple[SeenBody, ...]
    bumped: bool


class LostRobot(NamedTuple):
    """A robot that counts as dead."""

    place: Point
    """Where it said last that it was."""
    silent_since: Instant
    """When it said so."""


@dataclass(slots=True)
class Peer:
    """Another robot, as last heard."""

    heard: Instant
    rssi_dbm: float
    hello: Hello | None = None
    hello_at: Instant = 0
    stays_until: Instant = 0
    """It stands until then; counted from when it said so, however late that was read."""
    stands_since: Instant = NEVER
    """When it was first heard to stand, parked, where it is parked now; NEVER: it drives."""
    sets_out: bool = False
    """It is where it was when it said hello before: if it says that it drives, it has only set out."""
    driving: Heard | None = None
    """The state that a hello reports of a driving robot; None for others, and before it is decoded."""


def driving_of(robot: int, hello: Hello, at: Instant) -> Heard | None:
    """Return the state of `robot` that `hello`, heard at `at`, reports, if it drives."""
    if hello.parked:
        return None
    goal = None if hello.goal is None else Point(*hello.goal)
    return Heard(robot, Pose(hello.x, hello.y, hello.theta), goal, hello.rank, at)


class Peers:
    """The robots that have been heard."""

    def __init__(self, links: LinkSensing | None = None) -> None:
        """`links`: which of them hear this robot; None where majorities have no use."""
        self.links: Final = links
        self.known: dict[int, Peer] = {}
        self._ordered = True
        """Whether those known are in order of their ids."""
        self._standing: dict[int, Point] | None = None
        """Where those stand that do, in order of their ids; None: to be worked out anew."""
        self._standing_until: Instant = 0
        """Not before this instant is one of the others dead."""
        self._parked: tuple[Point, ...] | None = None
        self._lost: dict[int, LostRobot] = {}
        """Of those standing the ones that are dead."""

    def heard(self, now: Instant, robot: int, rssi_dbm: float) -> None:
        """Note that a frame of `robot` arrived."""
        peer = self.known.get(robot)
        if peer is None:
            self.known[robot] = Peer(now, rssi_dbm)
            self._ordered = False
        else:
            peer.heard = now
            peer.rssi_dbm = rssi_dbm

    def in_order(self) -> dict[int, Peer]:
        """Return those known in order of their ids."""
        if not self._ordered:
            self.known, self._ordered = dict(sorted(self.known.items())), True
        return self.known

    def hello(
        self, at: Instant, robot: int, hello: Hello, driving: Heard | None = None, *, said: Instant | None = None
    ) -> None:
        """Note what `robot` said about itself not before `at`; call after `heard`. `driving`: its way, if known.

        `said`: when the frame ended, if that is known; it may have waited to be read.
        """
        peer = self.known[robot]
        old = peer.hello
        dead = at - peer.hello_at > DEAD
        peer.sets_out = old is not None and max(abs(hello.x - old.x), abs(hello.y - old.y)) < MOVED_M
        if not hello.parked:
            peer.stands_since = NEVER
        elif peer.stands_since == NEVER or not peer.sets_out:
            peer.stands_since = at
        peer.hello = hello
        peer.hello_at = at
        if self.links is not None:
            self.links.note(at, robot, hello.listed)
        peer.driving = driving
        if hello.stays:
            peer.stays_until = (at if said is None else min(at, said)) + STAYS
        if robot in self._lost:
            self._standing = None
        elif hello.parked and self._standing is not None and robot in self._standing:
            place = Point(hello.x, hello.y)
            if place != self._standing[robot]:
                self._standing[robot] = place
                self._parked = None
        elif hello.parked or (old is not None and (old.parked or dead)):
            self._standing = None
        else:
            self._standing_until = min(self._standing_until, at + DEAD + 1)

    def placed(self, robot: int, roster: Sequence[int]) -> bool:
        """Return whether all of `roster` but `robot` itself have said where they are."""
        return all(one == robot or self.is_placed(one) for one in roster)

    def is_placed(self, robot: int) -> bool:
        """Return whether `robot` has said where it is."""
        peer = self.known.get(robot)
        return peer is not None and peer.hello is not None

    def neighbors(self, now: Instant) -> list[int]:
        """Return the robots heard within HEARD, in order of their ids."""
        return [robot for robot, peer in self.in_order().items() if now - peer.heard <= HEARD]

    def parked(self, now: Instant) -> tuple[Point, ...]:
        """Return where the others stand: those parked, as they last said, and those dead.

        The same object until that changes: it is asked for at each hello.
        """
        standing = self.standing(now)
        if self._parked is None:
            self._parked = tuple(standing.values())
        return self._parked

    def standing(self, now: Instant) -> dict[int, Point]:
        """Return where the others stand, by robot, in order of their ids: those parked, and those dead."""
        if self._standing is None or now >= self._standing_until:
            self._standing = {}
            self._lost = {}
            self._standing_until = NEVER
            self._parked = None
            for robot, peer in self.in_order().items():
                hello = peer.hello
                if hello is None:
                    continue
                lost = now > self.dead_from(robot, peer)
                if lost:
                    self._lost[robot] = LostRobot(Point(hello.x, hello.y), peer.hello_at)
                else:
                    self._standing_until = min(self._standing_until, self.dead_from(robot, peer) + 1)
                if lost or hello.parked:
                    self._standing[robot] = Point(hello.x, hello.y)
        return self._standing

    def dead_from(self, robot: int, peer: Peer) -> Instant:
        """Return after which instant `robot` is presumed dead: DEAD after it was heard last, here or by others."""
        if self.links is None:
            return peer.hello_at + DEAD
        # Who lists it has heard it within `lasts`.
        heard = max(peer.hello_at, self.links.listed(robot) - self.links.lasts)
        return min(heard + DEAD, peer.hello_at + CUT_OFF_MAX)

    def lost(self, now: Instant) -> dict[int, LostRobot]:
        """Return the robots that have been silent for so long that they count as dead."""
        self.standing(now)
        return self._lost

    def lost_places(self, now: Instant) -> list[Point]:
        """Return where the dead stand."""
        return [body.place for body in self.lost(now).values()]

    def changes(self, now: Instant) -> bool:
        """Return whether what `standing` returns may have changed although nothing was heard: one may be dead now."""
        return self._standing is None or now >= self._standing_until

    def heard_of(self, now: Instant, pose: Pose, shape: RobotShape) -> list[ReportedState]:
        """Return what others last said about where they are: all near a robot at `pose`, and the silent, not dead.

        Who sets out with its hull as good as at the robot's, of that `shape`, may not get away: it stands, until it
        has said that it is elsewhere.
        """
        known = []
        near_m = scale_of(shape).near_m
        touch = 2.0 * shape.radius + CLOSE_M
        for robot, peer in self.in_order().items():
            hello = peer.hello
            if hello is None:
                continue
            if now - peer.hello_at > DEAD and now > self.dead_from(robot, peer):
                continue
            if robot in self._lost:  # others hear it again
                self._standing = None
            at = max(peer.hello_at, min(now, peer.stays_until)) if hello.stays else peer.hello_at
            silent = now - at > (SILENT_PARKED if hello.parked else SILENT_MOVING)
            if silent or (abs(hello.x - pose.x) < near_m and abs(hello.y - pose.y) < near_m):
                stands = peer.sets_out and hypot(hello.x - pose.x, hello.y - pose.y) < touch
                v = 0.0 if stands else hello.v
                vx = v * math.cos(hello.theta)
                vy = v * math.sin(hello.theta)
                settled = now - peer.stands_since >= SETTLES
                state = ReportedState(
                    robot, hello.x, hello.y, vx, vy, at, hello.parked, silent, hello.rank, settled=settled
                )
                known.append(state)
        return known

    def hides(self, now: Instant, pose: Pose, shape: RobotShape, roster: Sequence[int], robot: int) -> bool:
        """Return whether a body that stands may be near a robot at `pose` without being known: a dead robot's.

        One that has been heard has driven on from there while others heard it, and until it knew that none does. One of
        `roster` but `robot` itself that has never been heard may be anywhere.
        """
        if self.links is None:
            return False
        if not self.placed(robot, roster):
            return True
        for other in self.lost(now):
            peer = self.known[other]
            hello = peer.hello
            assert hello is not None
            unheard = max(0, self.links.listed(other) - peer.hello_at) + 2 * self.links.lasts
            reach = shape.speed * in_seconds(unheard) + 2.0 * shape.radius + scale_of(shape).near_m
            if hypot(hello.x - pose.x, hello.y - pose.y) < reach:
                return True
        return False

    def heard_at(self, now: Instant) -> dict[int, Instant]:
        """Return when each robot was heard last; one that has promised to stay counts as heard meanwhile."""
        return {
            robot: max(peer.hello_at, min(now, peer.stays_until))
            for robot, peer in self.known.items()
            if peer.hello is not None
        }

    def driving(self, now: Instant) -> list[Heard]:
        """Return what the others that drive said last."""
        heard = []
        for robot, peer in self.in_order().items():
            if now - peer.hello_at > HEARD:
                continue
            if peer.driving is None and peer.hello is not None:
                peer.driving = driving_of(robot, peer.hello, peer.hello_at)
            if peer.driving is not None:
                heard.append(peer.driving)
        return heard

    def claims(self, now: Instant) -> list[tuple[int, Hello]]:
        """Return (robot, hello) of those that have taken a place."""
        return [
            (robot, peer.hello)
            for robot, peer in self.in_order().items()
            if peer.hello is not None and peer.hello.goal is not None and now - peer.hello_at <= CLAIM_KNOWN
        ]


def extent(area: Area) -> tuple[float, float, float, float]:
    """Return x0, y0, x1, y1 of a rectangle; robots beyond it, which are most, do not stand in `area`."""
    if area.box is not None:
        return area.box
    xs = [x for x, _ in area.places]
    ys = [y for _, y in area.places]
    return min(xs) - AT_LEAVE_M, min(ys) - AT_LEAVE_M, max(xs) + AT_LEAVE_M, max(ys) + AT_LEAVE_M


def standing_at(area: Area, pose: Pose, own_place: Point | None, was: bool) -> bool:
    """Return whether a robot at `pose` stands in `area`.

    At a `box` area: anywhere inside. At places: near one of them; where the robot has taken a place of its own
    (`own_place`) only that one counts, so that driving past other robots' slots is no arrival.
    """
    if area.box is not None:
        x0, y0, x1, y1 = area.box
        return x0 <= pose.x <= x1 and y0 <= pose.y <= y1
    reach = AT_LEAVE_M if was else AT_ENTER_M
    for x, y in area.places if own_place is None else (own_place,):
        if abs(x - pose.x) <= reach and hypot(x - pose.x, y - pose.y) <= reach:
            return True
    return False
