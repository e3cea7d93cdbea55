"""The hazard rules: one ordered table of what slows or stops a robot, and the speed law that applies it.

Rules of the stage CAP limit the speed with which the path may be followed. The path follower then steers, and rules of
the stage BODY slow its wheel command along the same arc for each body around. Rules of the stage PERCEPTION decide
which bodies there are and who goes first; rules of the stage WHEELS are applied by the driver to the final command.

Each rule of CAP and BODY takes the speed that the rules before it have allowed and returns one that is no greater. So
a rule that leaves the speed as it is has no effect on the run, which the counts of `RuleSwitches` rest on.
"""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point, Pose, Twist
from rmr.base.time import Instant
from rmr.node.motion.avoid import chord_angle, closing_limit, gives_way_late, turned
from rmr.node.motion.follow import Follower
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.hearing import LISTENS, OVERDUE_HELLOS, SILENT
from rmr.node.motion.queueing import Queueing
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.stopping import stopping_speed
from rmr.node.ports import SeenBody

LOST_SIGMA_M: Final = 0.1
"""A robot whose position has a greater standard deviation than this drives at half speed."""
STRAIGHT_RAD: Final = 0.1
"""A robot whose direction changes by less than this while it brakes counts as driving straight."""
UNRANKED: Final[Mapping[SeenBody, bool]] = MappingProxyType({})
"""No body has a place in the order."""


class Stage(Enum):
    """Where a rule is applied."""

    CAP = "cap"
    PERCEPTION = "perception"
    BODY = "body"
    WHEELS = "wheels"


class Surroundings:
    """What the rules go by. One object per robot, written anew each tick."""

    __slots__ = (
        "arena",
        "bodies",
        "cap",
        "follower",
        "gate",
        "heard_from",
        "now",
        "parked",
        "pose",
        "queue",
        "ranked",
        "remembered_from",
        "right_of_way",
        "sigma_m",
        "silence",
        "switches",
        "twist",
    )  # fmt: skip

    def __init__(self, arena: Arena, switches: RuleSwitches) -> None:
        self.arena = arena
        self.switches = switches
        self.now: Instant = 0
        self.pose = Pose(0.0, 0.0, 0.0)
        self.sigma_m = 0.0
        self.silence = 0
        """Why somebody unheard forbids driving on: flags of `hearing`; 0: nobody does."""
        self.gate = EntryGate(arena.shape, holding=False)
        self.follower: Follower | None = None
        self.right_of_way = 1.0
        """The share of full speed that keeps clear of those that go first."""
        self.queue = Queueing()
        self.parked: tuple[Point, ...] = ()
        self.twist = Twist(0.0, 0.0)
        """The wheel command that the rules for bodies judge."""
        self.cap = 0.0
        """The speed, m/s, at which each body is judged: the command's, or what is left of it on the arc."""
        self.bodies: list[SeenBody] = []
        """Those in view, then those remembered, then those heard."""
        self.remembered_from = 0
        self.heard_from = 0
        self.ranked: Mapping[SeenBody, bool] = UNRANKED
        """For bodies that have a place in the order, whether this robot goes before them."""

    def count_body(self, index: int) -> None:
        """Note that body `index` has lowered the speed: to the credit of the rule by which it is known."""
        if index >= self.heard_from:
            self.switches.count("cooperation")
        elif index >= self.remembered_from:
            self.switches.count("memory")

    def count_silence(self) -> None:
        """Note that a silence has had an effect."""
        for flag, name in ((LISTENS, "listen"), (SILENT, "silence"), (OVERDUE_HELLOS, "overdue")):
            if self.silence & flag:
                self.switches.count(name)


class Hazard:
    """One rule. Rules of the stages PERCEPTION and WHEELS are asked for by name where they are applied."""

    def __init__(self, name: str, stage: Stage, hazard: str, rule: str, where: str) -> None:
        """`hazard` and `rule` are the columns of docs/motion.md; `where` is the module of the rule."""
        self.name: Final = name
        self.stage: Final = stage
        self.hazard: Final = hazard
        self.rule: Final = rule
        self.where: Final = where

    def limit(self, around: Surroundings, v: float) -> float:
        """Return the greatest speed up to `v`, m/s, that the rule allows."""
        raise NotImplementedError


class GateRule(Hazard):
    """The hold line of the bottleneck."""

    def limit(self, around: Surroundings, v: float) -> float:
        """Return `v`, or less: not before the slot, and not while the gate is closed."""
        follower = around.follower
        if follower is None:
            return v
        return min(v, around.gate.limit(around.now, follower.route, follower.s))


class RightOfWay(Hazard):
    """Predicted conflicts with robots that go first."""

    def limit(self, around: Surroundings, v: float) -> float:
        """Return `v`, or the speed that keeps clear of those that go first (worked out when hellos are taken in)."""
        return min(v, around.right_of_way * around.arena.shape.speed)


class SilenceRule(Hazard):
    """One reason of `Hearing.forbids`."""

    def __init__(self, flag: int, name: str, hazard: str, rule: str, where: str) -> None:
        """`flag` is the bit of the reason."""
        super().__init__(name, Stage.CAP, hazard, rule, where)
        self.flag: Final = flag

    def limit(self, around: Surroundings, v: float) -> float:
        """Return 0 if somebody who is not heard may be near, for this rule's reason."""
        return 0.0 if around.silence & self.flag else v


class QueueRule(Hazard):
    """Order of the queue before the gate."""

    def limit(self, around: Surroundings, v: float) -> float:
        """Return 0 while a robot that goes first still stands on the route before the gate."""
        follower, gate, queue = around.follower, around.gate, around.queue
        if not around.parked or follower is None:
            return v
        if around.silence:  # the queue is not watched meanwhile: patience does not begin
            around.count_silence()
            return v
        # Where the gate is nearer than a radius nobody has room before it.
        if (follower.route.gate_m or 0.0) < around.arena.shape.radius or gate.passed or queue.overtakes:
            return v
        opens_at = around.now - 1 if gate.opened else gate.opens_at
        at = Point(around.pose.x, around.pose.y)
        return 0.0 if queue.waits(around.now, around.arena, at, around.parked, opens_at) else v


class LostRule(Hazard):
    """Uncertain localisation."""

    def limit(self, around: Surroundings, v: float) -> float:
        """Return at most half of the full speed while the robot's own position is uncertain."""
        return min(v, 0.5 * around.arena.shape.speed) if around.sigma_m > LOST_SIGMA_M else v


class DangerRule(Hazard):
    """Stop if dangerous (paper IV.E)."""

    def limit(self, around: Surroundings, v: float) -> float:
        """Return the least of what the bodies ahead allow by their closest point of approach."""
        radius, ranked, cap = around.arena.shape.radius, around.ranked, around.cap
        for index, body in enumerate(around.bodies):
            if body.x <= 0.0:
                continue
            by_side = gives_way_late(body)
            late = ranked.get(body, by_side) if ranked else by_side
            allowed = closing_limit(cap, body, radius, late)
            if late != by_side and closing_limit(cap, body, radius, by_side) != allowed:
                around.switches.count("order")
            if allowed < v:
                v = allowed
                around.count_body(index)
        return v


class StoppingRule(Hazard):
    """Able to stop short of a body that brakes now."""

    def limit(self, around: Surroundings, v: float) -> float:
        """Return the least speed from which the robot stops before each body ahead, should that brake now."""
        radius, cap = around.arena.shape.radius, around.cap
        for index, body in enumerate(around.bodies):
            if body.x > 0.0 and (allowed := stopping_speed(cap, body, radius)) < v:
                v = allowed
                around.count_body(index)
        return v


class ArcRule(Hazard):
    """The two rules before it, along the chord of the arc on which the robot would brake."""

    def limit(self, around: Surroundings, v: float) -> float:
        """Return `v`, or less, for bodies abeam on the inner side of a turn: out of view until just before contact."""
        turn = chord_angle(around.twist)
        if abs(turn) <= STRAIGHT_RAD:
            return v
        bodies, ranked, cap = around.bodies, around.ranked, around.cap
        around.bodies = [turned(body, turn) for body in bodies]
        if ranked:
            pairs = zip(around.bodies, bodies, strict=True)
            around.ranked = {new: ranked[old] for new, old in pairs if old in ranked}
        around.cap = v  # the arc is judged at the speed that driving straight on has left
        for rule in STRAIGHT_ON:
            if not around.switches.off(rule.name) and (allowed := rule.limit(around, v)) < v:
                around.switches.count(rule.name)
                v = allowed
        around.bodies = bodies
        around.ranked = ranked
        around.cap = cap
        return v


STRAIGHT_ON: Final[tuple[Hazard, ...]] = (
    DangerRule(
        "danger",
        Stage.BODY,
        "somebody ahead",
        "*stop if dangerous* (paper IV.E): the speed falls with the gap to a body whose closest point of approach is "
        "nearer than two radii and 25 mm",
        "avoid.py",
    ),
    StoppingRule(
        "stopping",
        Stage.BODY,
        "somebody ahead who stops",
        "*able to stop*: never faster than lets the robot stand before the place where the other would stand if it "
        "braked now, even if this robot's own process stops in this very moment",
        "stopping.py",
    ),
)
"""The rules that judge a body on the straight way ahead."""

HAZARDS: Final[tuple[Hazard, ...]] = (
    GateRule(
        "gate",
        Stage.CAP,
        "the bottleneck, before the robot's slot",
        "the speed with which the robot reaches the commit line as its slot opens; a stop at the hold line while the "
        "gate is closed",
        "gate.py",
    ),
    RightOfWay(
        "right_of_way",
        Stage.CAP,
        "paths that cross",
        "the earlier in the order goes first; the later takes the greatest share of its speed that keeps clear",
        "priority.py",
    ),
    SilenceRule(
        LISTENS,
        "listen",
        "somebody who has never been heard",
        "where the radio reaches over the whole floor, a robot that begins, at first or again, stands until each of "
        "the roster has said where it is, 10 s at most; on a wider floor one that is started again listens for 1.2 s",
        "hearing.py",
    ),
    SilenceRule(
        SILENT,
        "silence",
        "radio that is cut, a process that is stopped, a robot that has died",
        "a robot that drives and has not been heard for 1.2 s (2.4 s for one that was parked) is anywhere in a disc "
        "that grows at full speed; a robot which that disc can reach before it stands, stands until the other is "
        "heard again",
        "hearing.py",
    ),
    SilenceRule(
        OVERDUE_HELLOS,
        "overdue",
        "somebody near who misses a hello or two",
        "of a robot near by, unseen and not behind, two overdue hellos are a silence (0.6 s if it drives, 1.3 s if it "
        "is parked); a robot that sets out waits for a single one of a parked robot (0.7 s), which may have set out "
        "unheard as well",
        "hearing.py",
    ),
    QueueRule(
        "queue",
        Stage.CAP,
        "robots that go first and still stand before the gate",
        "a robot waits for those in the places of the queue before its own to leave",
        "queueing.py",
    ),
    LostRule(
        "lost",
        Stage.CAP,
        "an uncertain position",
        "half of the full speed while the standard deviation of the position is above 10 cm",
        "hazards.py",
    ),
    Hazard(
        "memory",
        Stage.PERCEPTION,
        "a body that has left the narrow view",
        "it is remembered for 0.8 s where it would be now, or until its robot says where it is; one that crept, where "
        "it was, too",
        "body_memory.py",
    ),
    Hazard(
        "cooperation",
        Stage.PERCEPTION,
        "somebody from the side, unseen",
        "*cooperative perception*: a robot that is near, not in view and heard is a body all the same, at the place "
        "and with the velocity of its last hello",
        "hearing.py",
    ),
    Hazard(
        "order",
        Stage.PERCEPTION,
        "paths that converge, as before the gate",
        "the later in the order slows down early for the other, at 2.5 (m/s)/m of gap, the earlier late, at "
        "6 (m/s)/m, on whichever side it has it; without an order the one that has the other on its right gives way",
        "avoid.py",
    ),
    *STRAIGHT_ON,
    ArcRule(
        "arc",
        Stage.BODY,
        "somebody abeam, on the inner side of a turn",
        "a robot whose direction changes by more than 0.1 rad while it brakes applies the two rules above a second "
        "time, in the direction of the chord of the arc on which it would brake, also to robots that it hears up to "
        "10 cm behind its axle",
        "hazards.py",
    ),
    Hazard(
        "reverse_guard",
        Stage.WHEELS,
        "somebody or something behind a robot that backs up",
        "a reverse manoeuvre stops 3 cm short of a wall and of every body that is known; one behind that drives off "
        "is taken to be where it was heard last, for it may have stopped since",
        "navigator.py",
    ),
    Hazard(
        "promise",
        Stage.WHEELS,
        "robots that stand in a crowd, of whose hellos some are lost",
        "a robot that has said that it stays does not move for 3 s, and is not silent meanwhile",
        "driver.py",
    ),
    Hazard(
        "unwatched",
        Stage.WHEELS,
        "a machine that is too slow, on which samples wait to be read",
        "a robot whose wheels have turned for more than 50 ms since its newest sample goes so much slower that it "
        "gets no farther than 1 cm unseen, and with a sample of more than 100 ms it stands until a newer one comes",
        "driver.py",
    ),
)
"""All hazard rules, in the order in which they are applied."""


class SpeedLaw:
    """The rules of `HAZARDS` that are in force, applied in order."""

    __slots__ = ("_body_rules", "_caps", "_switches")

    def __init__(self, switches: RuleSwitches) -> None:
        self._switches = switches
        in_force = [rule for rule in HAZARDS if not switches.off(rule.name)]
        self._caps: Final = [rule for rule in in_force if rule.stage is Stage.CAP]
        self._body_rules: Final = [rule for rule in in_force if rule.stage is Stage.BODY]

    def cap(self, around: Surroundings) -> float:
        """Return the greatest speed with which the path may be followed now, m/s."""
        v = around.arena.shape.speed
        for rule in self._caps:
            if (allowed := rule.limit(around, v)) < v:
                self._switches.count(rule.name)
                v = allowed
        return v

    def slowed(self, around: Surroundings, twist: Twist) -> Twist:
        """Return `twist`, slowed along its arc as the bodies of `around` demand; a turn or a reverse stays as it is."""
        if twist.v <= 0.0 or not around.bodies:
            return twist
        v = twist.v
        around.twist = twist
        around.cap = v
        for rule in self._body_rules:
            if (allowed := rule.limit(around, v)) < v:
                self._switches.count(rule.name)
                v = allowed
        # The turn rate falls with the speed: the arc, which the path needs, stays the same.
        return twist if v >= twist.v else Twist(v, twist.w * v / twist.v)
