"""The robot as a body: where it is, what it sees, where it drives and which place it takes.

The driver owns localisation and navigator. It takes one of an area's places by the robot's rank in the schedule, and
another one where a different robot has been faster: hellos tell the places, and the earlier rank keeps its own.

A body moves on while its samples wait for a processor. So the speed depends on the age of the newest sample: the longer
the wheels have turned since, the slower (`watched`), and without a sample of the last 0.1 s the robot stands.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import Final

from rmr.base.arena import Area, Arena
from rmr.base.geometry import STILL, Point, Pose, Twist, distance
from rmr.base.grid_path import GridPath
from rmr.base.motion_scale import scale_of
from rmr.base.time import Duration, Instant, in_seconds, milliseconds
from rmr.base.values import Symbol, Value
from rmr.node.config import NodeConfig
from rmr.node.crossing.approach import Approach, is_divided, side_of
from rmr.node.logic.sensed_facts import SensedFacts
from rmr.node.motion.grid import TIGHT_MARGIN_M
from rmr.node.motion.hearing import DEAD
from rmr.node.motion.localiser import Localiser
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.payloads import Hello
from rmr.node.peers.link_sensing import CUT_OFF_MAX
from rmr.node.peers.perception import AT_LEAVE_M, Peers, Percept, extent, standing_at
from rmr.node.ports import NAVIGATED, BodyPort, SeenBody

ACT_REFRESH: Final[Duration] = milliseconds(33)
"""Greatest time between two wheel commands of a moving robot, two frames: the body brakes 0.1 s after the last one."""
STALE: Final[Duration] = milliseconds(100)
"""With an older sample the robot stands: it describes another situation. A body that stands is sampled at least this
often, one that drives in each frame."""
SPOTS_MAX: Final = 64
"""Spots of one box that are considered, from its middle outwards."""
NO_RANK: Final = 1 << 16
"""Rank of a robot that has none: it comes after all others."""


class OwnDriver:
    """The driver of the body itself, Nav2 for example: it is given places, and tells how each order ended."""

    def __init__(self, body: BodyPort) -> None:
        self._body = body
        self.heading: tuple[int, Pose] | None = None
        """Where it is to drive, and the number of this order; None: nowhere."""
        self._said_at: Instant = 0
        self._over = False
        """Whether the order has ended."""
        self.failure = ""
        """Why it could not drive there; empty if it could."""
        self.speed = 0.0
        """How fast the wheels turn while it drives, m/s, from samples 0.1 s apart."""
        self._rolled: tuple[Instant, float] = (0, 0.0)

    def rolled(self, stamp: Instant, way_m: float) -> None:
        """Take in how far the wheels have come."""
        passed = stamp - self._rolled[0]
        if passed >= STALE:
            self.speed = (way_m - self._rolled[1]) / in_seconds(passed)
            self._rolled = stamp, way_m

    def reached(self, ends: Iterable[tuple[Value, ...]]) -> Pose | None:
        """Take in how orders ended (number, why it failed); return where the newest one has led to, if it just did."""
        if self.heading is None or self._over:
            return None
        serial, target = self.heading
        why = [str(end[1]) for end in ends if end[0] == serial]
        if why:
            self._over = True
            self.failure = why[-1]
        return target if why and not self.failure else None

    def head(self, now: Instant, target: Pose | None) -> None:
        """Order it to drive to `target` (None: to stand) if that is news; else repeat the order twice a second."""
        heading = self.heading
        if target is None:
            self.heading = None
            if heading is not None and not self._over:
                self._body.head(heading[0], None, now)
            return
        if heading is None or distance(target.x, target.y, heading[1].x, heading[1].y) > AT_LEAVE_M:
            self.heading = heading = now, target
            self._over = False
        elif self._over or now - self._said_at < milliseconds(500):
            return
        self._said_at = now
        self._body.head(heading[0], heading[1], now)


class Driver:
    """One robot's wheels and senses."""

    def __init__(self, config: NodeConfig, body: BodyPort) -> None:
        self.arena = arena = config.arena
        self._scale: Final = scale_of(arena.shape)
        self.localiser = Localiser(arena)
        self._switches = switches = RuleSwitches(config.without, config.firings)
        self.navigator = Navigator(arena, config.robot, len(config.roster), switches)
        self._listens: Duration = 0 if switches.off("listen") else config.listens
        """How long it stands at most until it has heard of all others of the roster."""
        self.navigator.hearing.listens = self._listens > 0
        self.approach = Approach(self.navigator, config.profile.finishes_in_order)
        self.place: Point | None = None
        """The slot that the robot has taken."""
        self._home: Point | None = None
        """The slot in which it has arrived, until it drives elsewhere: pushed out, it goes back."""
        self._chosen: tuple[Area, int, int] | None = None
        """The area, the rank and the place among those that go the same way, by which the place was chosen."""
        self._robot = config.robot
        self._roster = tuple(config.roster)
        self._body = body
        self._bodies: tuple[SeenBody, ...] = ()
        self._bumped = False
        self._told: list[tuple[tuple[str, tuple[Value, ...]], ...]] = []
        """Facts from outside that are to be stated."""
        self.own = OwnDriver(body)
        self._areas = [(area, (Symbol(area.name),), extent(area)) for area in arena.areas]
        self._stated_pose: Pose | None = None
        self._stated_place: Point | None = None
        """The pose and the place that the facts hold."""
        self._twist = STILL
        self._acted_at: Instant = -ACT_REFRESH
        self._sensed_at: Instant = 0
        """When the newest sample was taken."""
        self._set_out_at: Instant = 0
        """When the wheels were commanded to turn, if they are."""
        self._apply_hellos_at: Instant = 0
        self.stays_until: Instant = 0
        """It has promised the others not to move before."""
        self._began: Instant | None = None
        self._known: Pose | None = None
        """The newest estimate of the pose, also while there is none: a drive is ordered from there."""
        self._located = 0
        """How often it had been located when the wheels were commanded last."""
        self.held_by = ""
        """The rule of the stage WHEELS that holds the wheels, or slows them down, in this tick; empty: none does."""

    def follow(self, other: "Driver") -> None:
        """Go on from where `other` has brought the robot: its position, its place and its promise, but no drive."""
        self.localiser = other.localiser
        self.place = other.place
        self._home = other._home
        self._chosen = other._chosen
        self._bodies = other._bodies
        self._bumped = other._bumped
        self._twist = other._twist
        self._acted_at = other._acted_at
        self._sensed_at = other._sensed_at
        self._told = other._told
        self.own = other.own
        self._set_out_at = other._set_out_at
        self.stays_until = other.stays_until
        self._began = other._began
        self._known = other._known
        self._located = other._located
        self.navigator.hearing.listens = other.navigator.hearing.listens
        self.navigator.control.wheels = other.navigator.control.wheels

    @property
    def moving(self) -> bool:
        """Whether the wheels are commanded to turn."""
        return self._twist != STILL

    @property
    def speed(self) -> float:
        """The commanded speed, m/s; by odometry where the body's own driver drives."""
        return self._twist.v if self.own.heading is None else self.own.speed

    def driven(self, now: Instant) -> float:
        """Return how fast the wheels drive, m/s: a fast robot drives on for a while when it is to stand still."""
        return self.speed if self.speed < 0.0 else max(self.speed, self.navigator.control.wheels.speed(now))

    def _drives(self, now: Instant) -> bool:
        """Return whether the wheels turn, also those of a robot that was commanded to stand and brakes."""
        return self.moving or self.driven(now) > 0.0

    @property
    def percept(self) -> Percept:
        """What the robot senses now."""
        return Percept(self.localiser.pose, self._bodies, self._bumped)

    # -- each frame -------------------------------------------------------------------------------------------

    def step(self, now: Instant, rank: Callable[[], int], peers: Peers) -> None:
        """Take in the new samples and command the wheels; `rank` tells the robot's own place in the schedule."""
        sensed = self._body.sense()
        samples = [sample for sample in sensed if self.localiser.feed(now, sample)]
        self._told += [sample.facts for sample in sensed if sample.facts is not None]
        if samples:
            self._bodies = samples[-1].bodies
            self._bumped = any(sample.bumped for sample in samples)
            self._sensed_at = samples[-1].stamp
            self.own.rolled(self._sensed_at, 0.5 * (samples[-1].left_m + samples[-1].right_m))
        pose = self.localiser.pose
        navigator = self.navigator
        if self._began is None:
            self._began = now
        if pose is None:
            if self.moving:
                self._act(now, STILL)
            self.own.head(now, None)
            return
        self._known = pose
        if self._located != self.localiser.located:
            if self._located:
                navigator.relocate(now, pose)
            self._located = self.localiser.located
        if navigator.status in ("moving", "blocked"):
            self._apply_hellos(now, pose, rank, peers)
        self._keep_home(now, pose, peers)
        twist = STILL
        self.held_by = ""
        if self._may_move(now):
            navigator.control.sigma_m = self.localiser.sigma_m
            twist = navigator.step(now, pose, self._bodies, self._bumped)
            unwatched = now - max(self._sensed_at, self._set_out_at)
            if unwatched > self._scale.unwatched and self._drives(now) and not self._switches.off("unwatched"):
                twist = watched(twist, unwatched, self._scale.unwatched)
                self.held_by = "unwatched"
                self._switches.count("unwatched")
        twist = navigator.control.wheels.command(now, twist)
        if twist != self._twist or (twist != STILL and now - self._acted_at >= ACT_REFRESH):
            self._act(now, twist)
        self._navigate(now)

    def _navigate(self, now: Instant) -> None:
        """Tell the body's own driver where to drive, in pieces: to the hold line of a passage, then on."""
        own = self.own
        if not self.navigator.outside and own.heading is None:
            return
        reached = own.reached(args for told in self._told for name, args in told if name == NAVIGATED)
        if reached is not None:
            self.navigator.reached(reached)
        if self.held_by != "unwatched":  # that driver has samples of its own
            own.head(now, None if self.held_by == "promise" else self.navigator.heads_for())

    def let_navigate(self) -> None:
        """Let the body's own driver drive from here on, until the navigator is stopped."""
        self.navigator.outside = True
        self.own.failure = ""

    def _may_move(self, now: Instant) -> bool:
        """Return whether the robot has not promised to stay, and its newest sample still describes the situation."""
        if now < self.stays_until and not self._switches.off("promise"):
            self._switches.count("promise")
            self.held_by = "promise"
            return False
        if now - self._sensed_at > STALE and not self._switches.off("unwatched"):
            self._switches.count("unwatched")
            self.held_by = "unwatched"
            return False
        return True

    def _apply_hellos(self, now: Instant, pose: Pose, rank: Callable[[], int], peers: Peers) -> None:
        """Hand the others' hellos to the navigator: periodically, and at once when one is overdue."""
        navigator = self.navigator
        hearing = self.navigator.hearing
        hearing.stands = self._twist.v == 0.0
        listened = hearing.listens and not self.listens(now, peers)
        if now < self._apply_hellos_at and now <= hearing.overdue_at and not listened:
            return
        if now >= self._apply_hellos_at:
            self._apply_hellos_at = now + self._scale.update
            navigator.update_moving(now, rank(), peers.driving(now))
        hearing.update(pose, peers.heard_of(now, pose, navigator.arena.shape))
        if peers.links is not None:
            hearing.cut_off = peers.links.cut_off(now)
            hearing.by_sight = peers.hides(now, pose, navigator.arena.shape, self._roster, self._robot)

    def listens(self, now: Instant, peers: Peers) -> bool:
        """Return whether the robot stands until it has heard where all others are, or has had long enough to."""
        hearing = self.navigator.hearing
        if hearing.listens and self._began is not None:
            hearing.listens = not peers.placed(self._robot, self._roster) and (
                now - self._began < self._listens or self._awaits(now, peers, now - self._began)
            )
        return hearing.listens

    def _awaits(self, now: Instant, peers: Peers, listened: Duration) -> bool:
        """Return whether another robot lists one that this robot has never heard: it lives, and may be anywhere."""
        links = peers.links
        if links is None or listened > CUT_OFF_MAX:
            return False
        unplaced = [one for one in self._roster if one != self._robot and not peers.is_placed(one)]
        return any(now - links.listed(one) <= DEAD for one in unplaced)

    def _keep_home(self, now: Instant, pose: Pose, peers: Peers) -> None:
        """Go back to the slot in which the robot had arrived, if it stands outside of it and nothing else drives."""
        navigator = self.navigator
        home = self._home
        if home is None or navigator.status == "moving":
            if navigator.goal != home:
                self._home = None
        elif navigator.status in ("idle", "arrived") and distance(*home, pose.x, pose.y) > AT_LEAVE_M:
            navigator.go(now, pose, home, parked=peers.parked(now))

    def _act(self, now: Instant, twist: Twist) -> None:
        if not self._drives(now):
            self._set_out_at = now
        self._twist = twist
        self._acted_at = now
        self._body.act(twist, now)

    def state(self, now: Instant, senses: SensedFacts) -> list[Area]:
        """State `at`, `pose`, `obstacle` and what came from outside; return the areas at which it has just arrived."""
        while self._told:
            senses.tell(now, self._told.pop(0))
        pose = self.localiser.pose
        place = self.place
        if senses.used("obstacle"):
            senses.replace(now, "obstacle", [()] if self._bodies or self._bumped else [])
        if pose is None or (pose is self._stated_pose and place is self._stated_place):
            if pose is None and self._stated_pose is not None:
                self._retract(now, senses)
            return []
        self._stated_pose = pose
        self._stated_place = place
        if senses.used("pose"):
            senses.replace(now, "pose", [(round(pose.x, 2), round(pose.y, 2), round(pose.theta, 2))])
        arrived = []
        for area, args, (x0, y0, x1, y1) in self._areas:
            was = senses.holds("at", args)
            if not was and not (x0 <= pose.x <= x1 and y0 <= pose.y <= y1):
                continue
            if standing_at(area, pose, self.place if self.place in area.places else None, was):
                if self.place in area.places:
                    self._home = self.place
                if not was:
                    senses.add(now, "at", args)
                    arrived.append(area)
            elif was:
                senses.drop(now, "at", args)
        return arrived

    def _retract(self, now: Instant, senses: SensedFacts) -> None:
        """Withdraw the facts of an estimate that has been dropped: what a wrong pose has stated may not hold."""
        self._stated_pose = None
        for predicate in ("pose", "at"):
            if senses.used(predicate):
                senses.replace(now, predicate, [])

    # -- places -----------------------------------------------------------------------------------------------

    def place_of(self, now: Instant, area: Area, rank: int, place: int, peers: Peers) -> Point:
        """Return the robot's place in `area`.

        Of slots the K-th if it is the K-th, `place`, of those that go its way; without a rank (0) the one where it
        stands or by the roster; of a box the spot nearest to its middle that is free. Who has the smaller `rank` goes
        first. Of slots that passages divide, one to which the way leads through none comes before all others; of these
        the least id goes first, for who takes one has no turn, and would else lose it to one that still has.
        """
        places = spots(self.arena, area)
        index = (place - 1 if rank else self._unranked(area)) if area.slotted else 0
        claims = [(robot, hello, Point(*hello.goal)) for robot, hello in peers.claims(now) if hello.goal is not None]
        radius = self.arena.shape.radius
        parked = peers.parked(now)
        near = self.near_side(area)
        beyond = [place for place in places if place not in near]
        for some in (near, beyond):
            taken = [goal for robot, hello, goal in claims if self._goes_first(robot, hello, rank, near=some is near)]
            found = nearest_free(some, index, taken, radius, parked, 2.0 * radius + TIGHT_MARGIN_M)
            if found is not None:
                return found
        return places[index % len(places)]

    def near_side(self, area: Area) -> tuple[Point, ...]:
        """Return the slots of `area`, if passages divide them, to which the own way leads through none."""
        pose = self.localiser.pose
        return side_of(self.arena, area, pose) if pose is not None and is_divided(self.arena, area) else ()

    def _goes_first(self, source: int, hello: Hello, rank: int, *, near: bool) -> bool:
        """Return whether robot `source` takes a place, perhaps on the `near` side, before this one of `rank`."""
        if hello.parked or near:
            return hello.parked or source < self._robot
        return (hello.rank or NO_RANK, source) < (rank or NO_RANK, self._robot)

    def _unranked(self, area: Area) -> int:
        """Return which slot a robot without a rank tries first: the one where it stands, or by the roster."""
        pose = self.localiser.pose
        for i, at in enumerate(area.places):
            if pose is not None and distance(*at, pose.x, pose.y) < AT_LEAVE_M:
                return i
        return self._roster.index(self._robot)

    def take_place(self, now: Instant, area: Area, rank: int, place: int, peers: Peers) -> Point:
        """Choose the robot's place in `area` and keep it.

        Invariant: a robot that has a place has known where it is, so that it can set out for another one at any time.
        """
        assert self._known is not None
        point = self.place_of(now, area, rank, place, peers)
        self.place = point if area.slotted or area.box is not None else None
        self._chosen = (area, rank, place)
        return point

    def disputes(self, source: int, hello: Hello, *, outside: bool) -> bool:
        """Return whether the place of robot `source`, or where it stands, is a reason to look for another one.

        It is, if `source` goes first and has taken this robot's place, or stands in its way. A robot that is still
        `outside` the bottleneck also goes back to the place that its rank gives it when that has become free, so
        that places come out in order whatever the order in which the robots have heard of each other.
        """
        place = self.place
        if place is None or self._chosen is None:
            return False
        area, rank, which = self._chosen
        first = self._goes_first(source, hello, rank, near=place in self.near_side(area))
        radius = self.arena.shape.radius
        if first and hello.goal is not None and distance(*place, *hello.goal) <= radius:
            return True
        if hello.parked and distance(*place, hello.x, hello.y) <= 2.0 * radius + TIGHT_MARGIN_M:
            return True
        return outside and area.slotted and rank > 0 and place != area.places[(which - 1) % len(area.places)]

    def choose_again(self, now: Instant, peers: Peers) -> Point | None:
        """Return another place, as what has been heard of others has it; None: keep this one, or it leads back."""
        assert self._chosen is not None
        other = self.place_of(now, *self._chosen, peers)
        if other == self.place or self.navigator.leads_back(other):
            return None
        self.place = other
        return other

    def depart(
        self, now: Instant, goal: Point, peers: Peers, *, heading: float | None, gated: bool, shared: GridPath | None
    ) -> None:
        """Set out for `goal`, facing `heading` in the end; `gated`: through the bottleneck's gate.

        A robot that sets out for anywhere else gives up its slot. It must have had a pose; one whose estimate has been
        dropped stands, and plans anew when it has another one.
        """
        pose = self._known
        assert pose is not None
        if goal != self.place:
            self.place = None
        self.navigator.go(
            now,
            pose,
            goal,
            final_heading=heading,
            parked=peers.parked(now),
            lost=peers.lost_places(now),
            shared=shared,
            through_gate=gated,
        )


def watched(twist: Twist, unwatched: Duration, within: Duration) -> Twist:
    """Return `twist`, so slow that in a time `unwatched` it leads no farther than at full speed in `within`."""
    if unwatched <= within:
        return twist
    share = within / unwatched
    return Twist(share * twist.v, share * twist.w)


def nearest_free(
    places: Sequence[Point], first: int, claimed: Sequence[Point], reach_m: float, stood: Sequence[Point], room_m: float
) -> Point | None:
    """Return place `first` or the next one (cyclically) that is free; None if none is.

    It is not, if it is within `reach_m` of one that is `claimed`, or within `room_m` of where a robot has `stood`.
    """
    for offset in range(len(places)):
        place = places[(first + offset) % len(places)]
        free = all(distance(*place, *at) > reach_m for at in claimed)
        if free and all(distance(*place, *at) > room_m for at in stood):
            return place
    return None


@lru_cache(maxsize=64)
def spots(arena: Arena, area: Area) -> tuple[Point, ...]:
    """Return where robots may stand in `area`: its places, or the spots that fit a box, from its middle outwards."""
    if area.box is None:
        return area.places
    x0, y0, x1, y1 = area.box
    middle = area.places[0]
    across = _row(x1 - x0, arena.shape.radius)
    up = _row(y1 - y0, arena.shape.radius)
    offsets = sorted((dx * dx + dy * dy, dx, dy) for dx in across for dy in up)[:SPOTS_MAX]
    points = (Point(middle.x + dx, middle.y + dy) for _, dx, dy in offsets)
    return tuple(point for point in points if arena.clearance(*point) > arena.shape.radius) or area.places


def _row(length_m: float, radius_m: float) -> list[float]:
    """Return the offsets from the middle of as many robots as stand side by side with their centres in `length_m`."""
    step = 2 * radius_m + 0.06  # gap between the hulls of two robots that stand in one box
    # Distance of a spot from the box's edge, so that localisation noise does not put the robot outside.
    count = 1 + max(0, int((length_m - 2 * 0.03) / step))
    return [(i - (count - 1) / 2) * step for i in range(min(count, SPOTS_MAX))]
