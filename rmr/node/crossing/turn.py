"""One turn: a job's part in its event, as a value.

A turn goes ``asking -> slotted -> inside -> left``; a slot that is lost goes back to asking, and so does a
turn of which the job starts anew, or that an action has used up in vain. `rmr.node.crossing.turns` moves it.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Final, TypeVar

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point, Pose, distance
from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.base.values import Symbol, Value
from rmr.bytecode.program import Anything, Constant, Serving, Slot
from rmr.coord.values import EXCLUSIVE_WAY
from rmr.node.actions.dispatcher import RunningAction
from rmr.node.config import UNKNOWN_INSIDE
from rmr.node.driver import Driver
from rmr.node.motion.gate import PUT_OFF_S
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.route import Route, leader_route
from rmr.node.parts import CrossingHost
from rmr.vm.job import Job

REVISE_EVERY: Final[Duration] = milliseconds(500)
"""How often a robot that waits looks whether its estimate still fits its slot."""
EXTEND_BEFORE: Final[Duration] = milliseconds(200)
"""An end that comes nearer than this while the action goes on is moved."""
LEAVE_EARLY: Final[Duration] = milliseconds(300)
"""An action is released this much before it must be under way to reach the gate on time."""
EVENTS_KEPT: Final = 32
"""Events of which turns that are over, schedules and paths are kept; the oldest go first."""
GIVE_BACK: Final[Duration] = seconds(4)
"""A robot that has entered but gets no farther than the gate gives its turn back: somebody stands there who waits for
his own, and would wait for ever behind one that counts as inside."""
HINDERED_MAX: Final = 2
"""A robot that could not get to the gate for so many slots goes behind all others that are due: who stands in its way
may be one of them. One slot is missed by chance, as by a stall."""
HINDERED_WAIT: Final[Duration] = seconds(3)
"""So much later it says it will be at the gate then, and twice as much from then on: time for another to pass."""
HINDERED_WAIT_MAX: Final[Duration] = seconds(6)
SLIDES_MAX: Final[Duration] = seconds(4)
"""A robot that puts off its release again and again for so long without getting anywhere is hindered, too: it lets no
slot pass, but never gets one that stands."""
APPROACHES: Final[Duration] = milliseconds(500)
"""A robot under way that was put off tells the leader when it has come nearer to the gate, or gone farther, by this."""
APPROACH_MIN: Final[Duration] = milliseconds(20)
"""... and is farther away than this even at the gate: a time that is past when it is told says nothing new."""
GOES_ON: Final[Duration] = seconds(1)
"""So near to the gate a robot of a crowd that misses its slot is not hindered."""
SLIDES_M: Final = 0.1
"""Nearer to where it was it has got nowhere: a little way back and the return from it do not count."""
PRESS_AFTER: Final[Duration] = seconds(2)
"""A robot that has stood so long in the mouth, where nobody gets past it, is put off, too, ..."""
PRESS_NEAR: Final[Duration] = seconds(2)
"""... unless its slot is as near as this."""
IN_MOUTH_M: Final = 0.02
"""Nearer to the mouth than two radii and this a robot keeps others out."""
OFF_ROUTE_M: Final = 0.15
"""A robot farther than this from the way through the bottleneck is not on it."""


class Phase(Enum):
    """Where a turn stands."""

    ASKING = "asking"
    SLOTTED = "slotted"
    INSIDE = "inside"
    LEFT = "left"


@dataclass(slots=True)
class Turn:
    """One job's part in its event."""

    job: Job
    event: bytes
    trigger: Instant
    goal: Area | None
    """Where the serving action leads; None when it does not move the robot to a place."""
    phase: Phase = Phase.ASKING
    requested: bool = False
    gated: bool = False
    """Whether the way passes the bottleneck, so that the gate is a place and not the action's beginning."""
    way: int = EXCLUSIVE_WAY
    """Direction through the bottleneck; a turn that is no passage of it excludes all others."""
    approach: Duration = 0
    inside: Duration = UNKNOWN_INSIDE
    within: bool = False
    """Whether the robot was inside the bottleneck when it asked."""
    beyond: bool = False
    """Whether it had the bottleneck behind it then (`is_beyond`)."""
    in_way: bool = False
    """Whether it stood then where others come out: it begins to drive at once, so that it can make room."""
    after: Duration = 0
    """From leaving to the goal: the robot must be out of the bottleneck so much before its deadline."""
    headway: Duration = UNKNOWN_INSIDE
    release: Instant = 0
    rank: int = 0
    place: int = 0
    """The robot is the place-th of those that go its way; 0: not known."""
    start: Instant = 0
    end: Instant = 0
    entered_at: Instant = 0
    revised_at: Instant = 0
    notice: Duration = EXTEND_BEFORE
    """How long before its end the turn is extended; none where its length is known, as it is without a drive."""
    passage: Route | None = None
    """The way by which the robot entered the bottleneck."""
    serving: list[RunningAction] = field(default_factory=list)
    """The actions that go by this turn and have not ended; rarely more than one."""
    hindered: int = 0
    """Slots in a row that were of no use, for the robot could not get to the gate."""
    bound: Point | None = None
    """The place that the robot has taken while under way, until it has planned its way there."""
    planned_at: Instant = 0
    """When it planned its way last."""
    stood: Point | None = None
    """Where the robot was when it first put off its release without having got anywhere since ..."""
    stood_since: Instant = 0
    """... and when; later, if a slot has been of no use since."""
    mouth_since: Instant | None = None
    """Since when the robot has stood in the mouth without its turn."""
    underway: bool = False
    """The robot has set out and was put off then: others would have to pass it, so it goes first, the nearest first."""
    told: Duration = 0
    """The approach that the leader was told by one that is under way."""
    behind: Instant | None = None
    """Since when it goes behind those that are due by then, for it has been hindered too often."""

    @property
    def action(self) -> RunningAction | None:
        """The action that serves the job, the one under way before those that wait."""
        for running in self.serving:
            if running.started is not None:
                return running
        return self.serving[0] if self.serving else None

    @property
    def waits(self) -> bool:
        """Whether the robot may not enter yet."""
        return self.phase in (Phase.ASKING, Phase.SLOTTED)

    @property
    def deadline(self) -> Instant:
        """By when the robot wants to be out of the bottleneck, as the leader is told."""
        return self.job.deadline - self.after if self.behind is None else self.behind

    def hinder(self, now: Instant) -> bool:
        """Note a slot that was of no use; return whether the leader must be told that the robot goes behind others."""
        self.hindered, self.stood_since, self.mouth_since = self.hindered + 1, now, None
        often = self.hindered - HINDERED_MAX
        if often < 0:
            return False
        self.behind, self.underway = now, False
        self.release = now + self.approach + min(HINDERED_WAIT << min(often, 1), HINDERED_WAIT_MAX)
        return True

    def go_on(self, now: Instant) -> bool:
        """Note that one of a crowd has come too late for its slot; return whether the leader must be told.

        Near the gate it is not hindered but late, and the others have to pass it: it goes next.
        """
        running = self.action
        if running is None or running.started is None or self.approach > GOES_ON:
            return self.hinder(now)
        self.underway, self.told, self.release = True, self.approach, now + max(self.approach, APPROACH_MIN)
        return True

    def put_off(self, now: Instant) -> bool:
        """Note that the robot has set out and its slot has been put off; return whether the leader must be told."""
        running, ready = self.action, now + self.approach
        if running is None or running.started is None:
            return False
        if self.underway:
            told = abs(self.approach - self.told) < APPROACHES
        else:
            told = self.start - ready < seconds(PUT_OFF_S) or ready < self.release  # hindered: it lets others go first
        if not told:
            self.underway, self.told, self.release = True, self.approach, max(ready, now + APPROACH_MIN)
        return not told

    def press(self, now: Instant, in_mouth: bool) -> bool:
        """Note whether the robot stands `in_mouth`; return whether the leader must be told that it has for too long.

        Those that go first by the order would wait for it to leave, and it for them.
        """
        if not in_mouth:
            self.mouth_since = None
            return False
        self.mouth_since = now if self.mouth_since is None else self.mouth_since
        is_next = self.phase is Phase.SLOTTED and self.start < now + PRESS_NEAR
        if self.underway or is_next or now - self.mouth_since < PRESS_AFTER:
            return False
        self.underway, self.told = True, self.approach
        self.release = now + max(self.approach, APPROACH_MIN)
        return True

    def slide(self, now: Instant, release: Instant, pose: Pose | None) -> bool:
        """Note that the robot will be at the gate later than it has said; return whether it gets nowhere."""
        self.release = release
        if pose is not None and (self.stood is None or distance(*self.stood, pose.x, pose.y) > SLIDES_M):
            self.stood, self.stood_since = Point(pose.x, pose.y), now
        return now - self.stood_since > SLIDES_MAX

    def released(self, now: Instant) -> bool:
        """Return whether the action that serves the job may begin."""
        if self.phase in (Phase.INSIDE, Phase.LEFT) or self.job.finish is not None:
            return True
        return self.gated and self.phase is Phase.SLOTTED and (self.in_way or now >= self._leaves_at)

    def leaves_after(self, instant: Instant) -> bool:
        """Return whether the robot, which stands, has a slot for which it need not set out before `instant`."""
        running = self.action
        stands = running is None or running.started is None
        return self.gated and self.phase is Phase.SLOTTED and stands and not self.in_way and self._leaves_at > instant

    @property
    def _leaves_at(self) -> Instant:
        return self.start - self.approach - LEAVE_EARLY

    @property
    def next_wake(self) -> Instant:
        """When the turn must be looked at again even if nothing happens."""
        if self.phase is Phase.LEFT:
            return NEVER
        if self.phase is Phase.INSIDE:
            return self.end - self.notice
        look = self.revised_at + REVISE_EVERY
        return min(look, self._leaves_at) if self.phase is Phase.SLOTTED and self._leaves_at > self.revised_at else look


def gets_nowhere(now: Instant, turn: Turn, navigator: Navigator) -> bool:
    """Return whether the robot, though it may enter, has stood before the gate for `GIVE_BACK` or drives away."""
    route = navigator.route
    if navigator.aside and not navigator.passed_gate:
        return not turn.within
    stands = route is not None and route.gate_m is not None and not route.within and not navigator.passed_gate
    return stands and not turn.within and now - turn.entered_at > GIVE_BACK


def in_mouth(turn: Turn, navigator: Navigator, pose: Pose | None) -> bool:
    """Return whether the robot is so near to the mouth, out of which nobody comes, that it keeps others from it."""
    route, near = navigator.route, 2.0 * navigator.arena.shape.radius + IN_MOUTH_M
    if route is None:  # it stands and waits
        way = None if turn.goal is None else passage_to(navigator.arena, turn.goal.places[0])
        one_sided = way is not None and way.room_m <= 0.0 and turn.gated
        return one_sided and pose is not None and distance(*navigator.arena.mouths[0], pose.x, pose.y) < near
    if route.gate_m is None or route.within or route.room_m > 0.0 or navigator.aside:
        return False
    return route.gate_m - near < route.length_m - navigator.remaining_m < route.clear_m


def clear_of_bottleneck(turn: Turn, navigator: Navigator, pose: Pose | None) -> bool:
    """Return whether the robot is out of the bottleneck, even if its drive has been broken off inside."""
    route = navigator.route
    if route is not None and route.gate_m is not None:
        return navigator.cleared
    route = turn.passage
    if pose is None or route is None or route.gate_m is None:
        return True
    s = route.project(pose.x, pose.y, 0.0, route.length_m)
    away = distance(*route.point(s), pose.x, pose.y)
    return away > OFF_ROUTE_M or not route.gate_m - OFF_ROUTE_M < s < route.clear_m


def passage_of(navigator: Navigator) -> Route | None:
    """Return the way that the robot follows, if that leads through the bottleneck."""
    route = navigator.route
    return None if route is None or route.gate_m is None else route


def stands_within(arena: Arena, goal: Area, pose: Pose, slack_m: float = 0.0) -> bool:
    """Return whether a robot at `pose` stands in the bottleneck on the way to `goal`, or within `slack_m` of that."""
    way = passage_to(arena, goal.places[0])
    if way is None or way.gate_m is None:
        return False
    s = way.project(pose.x, pose.y, 0.0, way.length_m)
    radius = arena.shape.radius
    near = distance(*way.point(s), pose.x, pose.y) < OFF_ROUTE_M
    return near and way.gate_m + radius - slack_m < s < way.clear_m - radius + slack_m


def stands_in_way(arena: Arena, goal: Area, pose: Pose) -> bool:
    """Return whether a robot at `pose` stands at a mouth by which others come out, nearer than where it may wait."""
    way = passage_to(arena, goal.places[0])
    if way is None or way.gate_m is None or way.room_m <= 0.0:
        return False
    radius = arena.shape.radius
    beside = distance(*way.point(way.gate_m), pose.x, pose.y) < way.room_m + radius
    return beside or stands_within(arena, goal, pose, radius)


@lru_cache(maxsize=64)
def passage_to(arena: Arena, goal: Point) -> Route | None:
    """Return the way to `goal` from the mouth behind which it lies; None where no narrow section is on it."""
    for mouth in arena.mouths:
        route = leader_route(arena, mouth, goal, (), through_gate=True)
        if route is not None and route.gate_m is not None and route.clear_m - route.gate_m > 4.0 * arena.shape.radius:
            return route
    return None


def is_beyond(turn: Turn, driver: Driver | None) -> bool:
    """Return whether the robot has the bottleneck behind it on its way to a goal with room for many.

    It has if it is nearer to the far end of the passage that leads there than to its gate. A drive that does not pass
    the bottleneck is no evidence: it may lead through another aisle, or to a goal on this side.
    """
    goal = turn.goal
    if driver is None or goal is None or turn.gated or not (goal.slotted or goal.box is not None):
        return False
    way, pose = passage_to(driver.arena, goal.places[0]), driver.localiser.pose
    if way is None or way.gate_m is None or pose is None:
        return False
    here = Point(pose.x, pose.y)
    gate, clear = (
        leader_route(driver.arena, here, way.point(s), (), through_gate=False) for s in (way.gate_m, way.clear_m)
    )
    return gate is None or (clear is not None and clear.length_m < gate.length_m)


def goal_of(node: CrossingHost, job: Job) -> Area | None:
    """Return the area to which a serving action drives, as far as the job determines its arguments."""
    for serving in node.program.assertions[job.assertion].serving:
        if not node.drives_to_area(serving.action):
            continue
        area = area_among(node, known_arguments(serving, job))
        if area is not None:
            return area
    return None


def area_among(node: CrossingHost, values: Iterable[Value]) -> Area | None:
    """Return the first of `values` that is an area."""
    areas = (node.arena.area(value) for value in values if isinstance(value, Symbol))
    return next((area for area in areas if area is not None), None)


def known_arguments(serving: Serving, job: Job) -> list[Value]:
    """Return the arguments of a serving action that the job determines."""
    known: list[Value] = []
    for pattern in serving.args:
        match pattern:
            case Constant(value=value):
                known.append(value)
            case Slot(index=index):
                bound = job.bindings[index]
                if bound is not None:
                    known.append(bound)
            case Anything():
                pass
    return known


K = TypeVar("K")
V = TypeVar("V")


def keep(table: dict[K, V], key: K, value: V) -> None:
    """Put the newest value last in `table`, of which the `EVENTS_KEPT` newest stay."""
    table.pop(key, None)
    table[key] = value
    while len(table) > EVENTS_KEPT:
        del table[next(iter(table))]
