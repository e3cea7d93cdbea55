"""A small world for motion tests: unicycle robots with limited acceleration, noisy poses and a view cone.

No radio and no schedule: the benches hand out ideal slots, and robots of a stream hear each other without
loss. Poses reach the robots with an error that drifts as an EKF's does (a first-order process), wheels turn a
little more or less than commanded, bodies are seen by their hulls, with a little noise. Contacts are overlaps
of discs or of a disc and an obstacle.
"""

import math
from collections.abc import Mapping, Sequence
from random import Random

from rmr.base.arena import BOTTLENECK, Area, Arena, FloorPassage, Polygon
from rmr.base.geometry import Point, Pose, Twist, wrap
from rmr.base.motion_scale import scale_of
from rmr.base.time import Instant, in_seconds, tick_start
from rmr.node.motion import forecast
from rmr.node.motion.avoid import gives_way_late
from rmr.node.motion.hazards import UNRANKED
from rmr.node.motion.hearing import ReportedState
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.priority import Heard
from rmr.node.motion.ways import GAP_M, TURNED_M, WaysToStand
from rmr.node.payloads import Hello
from rmr.node.peers.hello import ExpectedStand
from rmr.node.ports import SeenBody

ACCEL = 0.8
TURN_ACCEL = 12.0
TICK = 1.0 / 60.0
POSITION_SIGMA = 0.004
HEADING_SIGMA = 0.012
DRIFT_S = 1.0
SAID_TICKS = 12


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    return Polygon((Point(x0, y0), Point(x1, y0), Point(x1, y1), Point(x0, y1)))


def bottleneck(*entrances: Area) -> tuple[FloorPassage, ...]:
    """Return the passages of an arena whose only one is a bottleneck."""
    return (FloorPassage(BOTTLENECK, entrances),)


def testbed() -> Arena:
    entry = Area("entry", (Point(0.5, 0.75),))
    slots = ((1.38, 1.38), (1.38, 0.12), (1.38, 1.14), (1.38, 0.36), (1.38, 0.90), (1.38, 0.60))
    return Arena(
        1.5,
        1.5,
        0.05,
        (box(0.6, 0.0, 0.9, 0.6), box(0.6, 0.9, 0.9, 1.5)),
        (
            entry,
            Area("exit", tuple(Point(*s) for s in slots), slotted=True),
        ),
        passages=bottleneck(entry),
    )


TESTBED_STARTS = tuple(Pose(0.10, y, 0.0) for y in (0.15, 0.37, 0.59, 0.91, 1.13, 1.35))


def limit_twist(twist: Twist, bodies: Sequence[SeenBody], first: Mapping[SeenBody, bool] = UNRANKED) -> Twist:
    """Return `twist` as the law of ways allows it; `first`: whether the robot goes before a body that has a rank."""
    ways = WaysToStand(scale_of(testbed().shape))
    share = 1.0
    for body in bodies if twist.v > 0.0 else ():
        goes = first.get(body, gives_way_late(body))
        share = min(share, ways.clear(twist, body, GAP_M, 0.0, first=goes))
    return Twist(share * twist.v, share * twist.w) if share < 1.0 else twist


def safe_speed(v: float, bodies: Sequence[SeenBody], first: Mapping[SeenBody, bool] = UNRANKED) -> float:
    return limit_twist(Twist(v, 0.0), bodies, first).v


def corridor() -> Arena:
    entry = Area("entry", (Point(1.1, 0.75),), queue=tuple(Point(1.1 - 0.2 * k, 0.75) for k in range(6)))
    slots = ((2.6, 1.35), (2.6, 0.15), (2.6, 1.11), (2.6, 0.39), (2.6, 0.87), (2.6, 0.63))
    return Arena(
        3.0,
        1.5,
        0.05,
        (box(1.2, 0.0, 1.8, 0.6), box(1.2, 0.9, 1.8, 1.5)),
        (
            entry,
            Area("exit", tuple(Point(*s) for s in slots), slotted=True),
        ),
        passages=bottleneck(entry),
    )


CORRIDOR_STARTS = tuple(Pose(x, y, 0.0) for y in (0.18, 1.32) for x in (0.2, 0.55, 0.9))


class Body:
    """One robot: true state, the error of its estimate, its navigator and its last command."""

    def __init__(self, arena: Arena, robot: int, pose: Pose, rng: Random, noise: float) -> None:
        self.arena = arena
        self.robot = robot
        self.x, self.y, self.theta = pose
        self.v = self.w = 0.0
        self.command = Twist(0.0, 0.0)
        self.rng = rng
        self.noise = noise
        self.error = [rng.gauss(0, POSITION_SIGMA * noise), rng.gauss(0, POSITION_SIGMA * noise), 0.0]
        self.gain_v = 1.0 + rng.gauss(0, 0.01) * noise
        self.gain_w = 1.0 + rng.gauss(0, 0.02) * noise
        self.nav = Navigator(arena, robot)
        self.bumped = False
        self.distance = 0.0

    @property
    def estimate(self) -> Pose:
        ex, ey, et = self.error
        return Pose(self.x + ex, self.y + ey, wrap(self.theta + et))

    def said(self, now: Instant, rank: int = 0) -> ReportedState:
        pose = self.estimate
        vx, vy = self.v * math.cos(pose.theta), self.v * math.sin(pose.theta)
        return ReportedState(self.robot, pose.x, pose.y, vx, vy, now, self.nav.parked, False, rank)

    def move(self) -> None:
        dv = self.command.v * self.gain_v - self.v
        dw = self.command.w * self.gain_w - self.w
        self.v += max(-ACCEL * TICK, min(ACCEL * TICK, dv))
        self.w += max(-TURN_ACCEL * TICK, min(TURN_ACCEL * TICK, dw))
        self.theta = wrap(self.theta + self.w * TICK)
        self.x += self.v * math.cos(self.theta) * TICK
        self.y += self.v * math.sin(self.theta) * TICK
        self.distance += abs(self.v) * TICK
        if self.noise:
            keep = math.exp(-TICK / DRIFT_S)
            kick = math.sqrt(1 - keep * keep) * self.noise
            for i, sigma in enumerate((POSITION_SIGMA, POSITION_SIGMA, HEADING_SIGMA)):
                self.error[i] = self.error[i] * keep + self.rng.gauss(0, sigma) * kick

    def sees(self, others: Sequence["Body"]) -> list[SeenBody]:
        shape = self.arena.shape
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        seen = []
        for other in others:
            if other is self:
                continue
            dx, dy = other.x - self.x, other.y - self.y
            if math.hypot(dx, dy) - shape.radius > shape.view_depth:
                continue
            x, y = dx * cos + dy * sin, dy * cos - dx * sin
            half_width = math.asin(min(1.0, shape.radius / math.hypot(dx, dy)))
            if abs(math.atan2(y, x)) - half_width > shape.view_angle / 2:
                continue
            vx, vy = other.v * math.cos(other.theta), other.v * math.sin(other.theta)
            noise = self.noise
            seen.append(
                SeenBody(
                    x + self.rng.gauss(0, 0.002) * noise,
                    y + self.rng.gauss(0, 0.002) * noise,
                    vx * cos + vy * sin + self.rng.gauss(0, 0.005) * noise,
                    vy * cos - vx * sin + self.rng.gauss(0, 0.005) * noise,
                )
            )
        return seen


class Bench:
    """All robots of one arena."""

    def __init__(self, arena: Arena, starts: Sequence[Pose], seed: int = 0, noise: float = 1.0) -> None:
        self.arena = arena
        rng = Random(f"{seed}/bench")
        self.rng = rng
        self.bodies = [Body(arena, i + 1, p, Random(f"{seed}/{i}"), noise) for i, p in enumerate(starts)]
        self.tick = 0
        self.contacts: list[tuple[float, int, int]] = []
        self.min_gap = math.inf
        self._touching: list[tuple[int, int]] = []

    @property
    def now(self) -> Instant:
        return tick_start(self.tick)

    @property
    def time(self) -> float:
        return in_seconds(self.now)

    def step(self) -> None:
        """Let every active robot decide on the same instant, then move all."""
        self.tick += 1
        for body in self.bodies:
            body.command = body.nav.step(self.now, body.estimate, body.sees(self.bodies), body.bumped)
        for body in self.bodies:
            body.move()
        self._contacts()

    def _contacts(self) -> None:
        radius = self.arena.shape.radius
        touching = []
        bumped = [False] * len(self.bodies)
        for i, a in enumerate(self.bodies):
            if self.arena.clearance(a.x, a.y) < radius:
                touching.append((a.robot, 0))
                bumped[i] = True
            for j, b in enumerate(self.bodies[:i]):
                gap = math.hypot(a.x - b.x, a.y - b.y) - 2 * radius
                self.min_gap = min(self.min_gap, gap)
                if gap < 0:
                    touching.append((a.robot, b.robot))
                    bumped[i] = bumped[j] = True
        for pair in touching:
            if pair not in self._touching:
                self.contacts.append((self.time, *pair))
        self._touching = touching
        for body, bump in zip(self.bodies, bumped, strict=True):
            body.bumped = bump

    def say(self) -> None:
        """Let each robot hear at once where the others are, how they drive and where to, without an order."""
        for body in self.bodies:
            others = [other for other in self.bodies if other is not body]
            body.nav.hearing.update(body.estimate, [other.said(self.now) for other in others])
            under_way = [other for other in others if not other.nav.parked]
            said = [Heard(other.robot, other.estimate, other.nav.goal, 0, self.now) for other in under_way]
            body.nav.update_moving(self.now, 0, said)

    def run(self, done, until_s: float) -> bool:
        """Step until `done()` or the time is over; return whether it became true."""
        while self.time < until_s:
            self.step()
            if done():
                return True
        return False


class Stream:
    """Hands out ideal slots at the gate: rank k enters a headway after rank k - 1; who is late gets a new slot."""

    ENTRY_WINDOW_S = 0.25
    LEAD_S = 0.6

    def __init__(self, bench: Bench, order: Sequence[int], headway_s: float, begin_s: float = 0.6) -> None:
        self.bench = bench
        self.order = [bench.bodies[i] for i in order]
        self.headway_s = headway_s
        self.begin_s = begin_s
        self.missed = 0
        self.slots: dict[int, float] = {}
        self.entered: dict[int, float] = {}
        self.cleared: dict[int, float] = {}
        self.arrived: dict[int, float] = {}
        self.goals: dict[int, Point] = {}
        self.shared = None
        self._said: dict[int, tuple[ReportedState, Heard | None, ExpectedStand]] = {}

    def parked_for(self, body: Body) -> list[Point]:
        """Return where others stand: what their messages say, with the error of their own estimates."""
        return [Point(*o.estimate[:2]) for o in self.bench.bodies if o is not body and o.nav.parked]

    def assign(self, places: Sequence[Point]) -> None:
        """Plan every trip and give every robot its slot, in order."""
        bench = self.bench
        last = -math.inf
        for rank, body in enumerate(self.order):
            goal = self.goals[body.robot] = places[rank]
            parked = self.parked_for(body) + [self.goals[o.robot] for o in self.order[:rank]]
            ok = body.nav.go(bench.now, body.estimate, goal, parked=parked, shared=self.shared, through_gate=True)
            assert ok, f"robot {body.robot} finds no way"
            if self.shared is None:
                self.shared = forecast.shared_path(body.nav.arena, body.estimate, self.goals[body.robot])
            release = max(bench.time + self.LEAD_S, bench.time + in_seconds(body.nav.eta_gate()))
            last = max(release, last + self.headway_s)
            self.slots[body.robot] = last

    def _parked_ahead(self, body: Body) -> list[Point]:
        """Return who stands now and whose place lies ahead: ranks before mine that are through or on their way."""
        mine = self.slots[body.robot]
        ahead = [self.goals[o.robot] for o in self.order if self.slots[o.robot] < mine and not o.nav.parked]
        return self.parked_for(body) + ahead

    def rank(self, body: Body) -> int:
        """Return the robot's place in the order."""
        return 1 + sum(slot < self.slots[body.robot] for slot in self.slots.values())

    def _say(self) -> None:
        """Let every robot hear what the others say: where they believe to be, where they go, and their ranks."""
        for body in self.order:
            self._says(body)
        self._hear()

    def _says(self, body: Body) -> None:
        """Say where `body` is and how it drives: what others know of it until it says so again."""
        now = self.bench.now
        rank = self.rank(body)
        drives = None if body.nav.parked else Heard(body.robot, body.estimate, body.nav.goal, rank, now)
        hello = Hello(*body.estimate, body.v, body.nav.parked, rank, None)
        self._said[body.robot] = body.said(now, rank), drives, ExpectedStand(hello)

    def _strays(self, body: Body) -> bool:
        """Return whether `body` drives elsewhere than it last let others expect: then robots say hello at once."""
        if body.robot not in self._said or body.nav.parked:
            return False
        state, _, expected = self._said[body.robot]
        return expected.astray_m(in_seconds(self.bench.now - state.at), body.estimate, body.v) > TURNED_M

    def _hear(self) -> None:
        bench = self.bench
        known = [state for state, _, _ in self._said.values()]
        driving = [heard for _, heard, _ in self._said.values() if heard is not None]
        for body in self.order:
            others = [heard for heard in driving if heard.robot != body.robot]
            body.nav.update_moving(bench.now, self.rank(body), others)
            body.nav.hearing.update(body.estimate, [other for other in known if other.robot != body.robot])

    def step(self) -> None:
        bench = self.bench
        if bench.tick % SAID_TICKS == 0:
            self._say()
        elif astray := [body for body in self.order if self._strays(body)]:
            for body in astray:
                self._says(body)
            self._hear()
        if bench.tick % 15 == 0:
            for body in self.order:
                body.nav.update_parked(self._parked_ahead(body))
        for body in self.order:
            self._gate(body)
        bench.step()
        for body in self.order:
            if body.nav.cleared and body.robot not in self.cleared:
                self.cleared[body.robot] = bench.time
            if body.nav.status == "arrived" and body.robot not in self.arrived:
                self.arrived[body.robot] = bench.time

    def _gate(self, body: Body) -> None:
        bench, robot = self.bench, body.robot
        if robot in self.entered:
            return
        start = self.slots[robot]
        ready = in_seconds(body.nav.eta_gate()) < self.ENTRY_WINDOW_S
        if start <= bench.time and ready:
            self.entered[robot] = bench.time
        elif bench.time > start + self.ENTRY_WINDOW_S:
            self.missed += 1
            self.slots[robot] = max(bench.time + self.LEAD_S, max(self.slots.values()) + self.headway_s)
        body.nav.gate(round(self.slots[robot] * 1e9), robot in self.entered)

    def run(self, until_s: float) -> bool:
        while self.bench.time < until_s:
            self.step()
            if len(self.arrived) == len(self.order):
                return True
        return False


def stream_testbed(seed: int, headway_s: float = 0.95, robots: int = 6, noise: float = 1.0, watch=None) -> Stream:
    """Run the test-bed: `robots` robots in random order stream to the exit slots."""
    bench = Bench(testbed(), TESTBED_STARTS[:robots], seed, noise)
    order = list(range(robots))
    bench.rng.shuffle(order)
    while bench.time < 0.6:
        bench.step()
    stream = Stream(bench, order, headway_s)
    stream.assign(bench.arena.area("exit").places)
    stream.watch = watch
    stream.run(60.0)
    return stream


class QueueStream(Stream):
    """Robots line up behind the gate in order, then pass; a slot is given when a robot stands in its place."""

    RELEASE_S = 0.6

    def begin(self, places: Sequence[Point], queue: Sequence[Point]) -> None:
        """Send every robot to its place in the queue."""
        self.places = places
        self.queue = queue
        self.lined: dict[int, float] = {}
        self.approach: dict[int, float] = {}
        self.gone: list[int] = []
        bench = self.bench
        for rank, body in enumerate(self.order):
            self.goals[body.robot] = places[rank]
            body.nav.go(bench.now, body.estimate, queue[rank], final_heading=0.0, parked=self.parked_for(body))

    def step(self) -> None:
        bench = self.bench
        for rank, body in enumerate(self.order):
            if body.robot not in self.lined and body.nav.status == "arrived":
                self.lined[body.robot] = bench.time
            if body.robot in self.lined and body.robot not in self.slots and len(self.slots) == rank:
                self._slot(rank, body)
            if body.robot in self.slots and body.robot not in self.gone:
                self._leave(rank, body)
        super().step()

    def _slot(self, rank: int, body: Body) -> None:
        """Give the slot, from the time that the way to the gate takes."""
        estimate = forecast.estimate(body.nav.arena, body.estimate, self.places[rank])
        assert estimate is not None
        self.approach[body.robot] = in_seconds(estimate.approach)
        release = self.bench.time + max(self.LEAD_S, self.approach[body.robot])
        self.slots[body.robot] = max(release, max(self.slots.values(), default=-math.inf) + self.headway_s)

    def _leave(self, rank: int, body: Body) -> None:
        """Let the robot set out for its exit place just in time, as a node does."""
        bench = self.bench
        if bench.time < self.slots[body.robot] - self.approach[body.robot] - self.RELEASE_S:
            return
        self.gone.append(body.robot)
        parked = self.parked_for(body) + [self.goals[o.robot] for o in self.order[:rank]]
        ok = body.nav.go(
            bench.now, body.estimate, self.places[rank], parked=parked, shared=self.shared, through_gate=True
        )
        assert ok, "no way from the queue"
        if self.shared is None:
            self.shared = forecast.shared_path(body.nav.arena, body.estimate, self.goals[body.robot])

    def rank(self, body: Body) -> int:
        return 1 + self.order.index(body)

    def _parked_ahead(self, body: Body) -> list[Point]:
        rank = self.order.index(body)
        through = [self.goals[o.robot] for o in self.order[:rank] if o.robot in self.entered and not o.nav.parked]
        return self.parked_for(body) + (through if body.robot in self.lined else [])

    def _gate(self, body: Body) -> None:
        if body.robot in self.gone:
            super()._gate(body)

    def run(self, until_s: float) -> bool:
        while self.bench.time < until_s:
            self.step()
            for robot in list(self.arrived):
                if robot not in self.entered:
                    del self.arrived[robot]
            if len(self.arrived) == len(self.order):
                return True
        return False


def pass_corridor(seed: int, headway_s: float = 0.95, robots: int = 6, noise: float = 1.0) -> QueueStream:
    """Run the corridor: `robots` robots line up in random order, then pass to the exit slots."""
    bench = Bench(corridor(), CORRIDOR_STARTS[:robots], seed, noise)
    order = list(range(robots))
    bench.rng.shuffle(order)
    while bench.time < 0.6:
        bench.step()
    stream = QueueStream(bench, order, headway_s)
    stream.begin(bench.arena.area("exit").places, bench.arena.area("entry").queue)
    stream.run(60.0)
    return stream
