"""The kinds of hazard rules: what slows or stops a robot. `speed_law` has their table and applies it.

Each rule of the stage CAP takes the speed that the rules before it have allowed and returns one that is no
greater. So a rule that leaves the speed as it is has no effect on the run: the counts of `RuleSwitches` rest on that.
"""

from collections.abc import Mapping
from enum import Enum
from math import inf
from types import MappingProxyType
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point, Pose
from rmr.base.motion_scale import scale_of
from rmr.base.time import Instant
from rmr.node.motion.follow import Follower, braking_speed
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.goal_queue import SLACK_RADII, hold_m
from rmr.node.motion.hearing import CUT_OFF, LISTENS, OVERDUE_HELLOS, SILENT
from rmr.node.motion.queueing import waits_in_queue
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.ports import SeenBody

UNRANKED: Final[Mapping[SeenBody, bool]] = MappingProxyType({})
"""No body has a place in the order."""


SILENCE_RULES: Final = (
    (LISTENS, "listen"),
    (CUT_OFF, "majority"),
    (SILENT, "silence"),
    (OVERDUE_HELLOS, "overdue"),
)
"""The rules that forbid driving on since robots are not heard, by their flags."""


class HazardStage(Enum):
    """Where a rule is applied."""

    CAP = "cap"
    """To the speed with which the path may be followed, before the path follower steers."""
    PERCEPTION = "perception"
    """To which bodies there are, and who of two goes first."""
    WHEELS = "wheels"
    """To the final command, or to that of a reverse manoeuvre."""


class HazardScene:
    """The input of the rules. One object per robot, updated each tick."""

    __slots__ = (
        "ahead",
        "arena",
        "bodies",
        "first_m",
        "follower",
        "gate",
        "heard_from",
        "held_by",
        "now",
        "parked",
        "pose",
        "ranked",
        "remembered_from",
        "right_of_way",
        "scale",
        "silence",
        "switches",
    )  # fmt: skip

    def __init__(self, arena: Arena, switches: RuleSwitches) -> None:
        self.arena = arena
        self.switches = switches
        self.scale: Final = scale_of(arena.shape)
        self.now: Instant = 0
        self.pose = Pose(0.0, 0.0, 0.0)
        self.silence = 0
        """The reasons of silence that forbid driving on, flags of `hearing`; 0: none."""
        self.gate = EntryGate(arena.shape, holding=False)
        self.follower: Follower | None = None
        self.right_of_way = 1.0
        """The share of full speed that keeps clear of those that go first."""
        self.parked: tuple[Point, ...] = ()
        self.ahead = 0
        """How many robots have the goal first."""
        self.first_m = inf
        """Where on its route the robot waits for those that come to the gate first from beside it, metres."""
        self.held_by: SeenBody | None = None
        """The body that slows the wheel command of this tick most."""
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
        for flag, name in SILENCE_RULES:
            if self.silence & flag:
                self.switches.count(name)


class Hazard:
    """One rule. Rules of the stages PERCEPTION and WHEELS are asked for by name where they are applied."""

    def __init__(self, name: str, stage: HazardStage, hazard: str, rule: str, where: str) -> None:
        """`hazard` and `rule` stand in docs/motion.md; `where` is the module of the rule."""
        self.name: Final = name
        self.stage: Final = stage
        self.hazard: Final = hazard
        self.rule: Final = rule
        self.where: Final = where

    def limit(self, around: HazardScene, v: float) -> float:
        """Return the greatest speed up to `v`, m/s, that the rule allows."""
        raise NotImplementedError


class GateRule(Hazard):
    """The hold line of the bottleneck."""

    def limit(self, around: HazardScene, v: float) -> float:
        """Return `v`, or less: not before the slot, and not while the gate is closed."""
        follower = around.follower
        if follower is None:
            return v
        return min(v, around.gate.limit(around.now, follower.route, follower.s))


class RightOfWay(Hazard):
    """Predicted conflicts with robots that go first."""

    def limit(self, around: HazardScene, v: float) -> float:
        """Return `v`, or the speed that keeps clear of those that go first (computed when hellos arrive)."""
        return min(v, around.right_of_way * around.arena.shape.speed)


class SilenceRule(Hazard):
    """One reason of `Hearing.forbids`."""

    def __init__(self, flag: int, name: str, hazard: str, rule: str, where: str) -> None:
        """`flag` is the bit of the reason."""
        super().__init__(name, HazardStage.CAP, hazard, rule, where)
        self.flag: Final = flag

    def limit(self, around: HazardScene, v: float) -> float:
        """Return 0 if a robot that is not heard may be near, for this rule's reason."""
        return 0.0 if around.silence & self.flag else v


class QueueRule(Hazard):
    """Order of the queue before the gate."""

    def limit(self, around: HazardScene, v: float) -> float:
        """Return 0 while a robot that goes first still stands on the route before the gate, else `v`, or less.

        So that the robot does not stand in the way of one that comes to the gate first from beside it.
        """
        follower = around.follower
        gate = around.gate
        if follower is None:
            return v
        if around.first_m < inf and not gate.open_to(follower.route):
            v = min(v, braking_speed(around.first_m - follower.s))
        if not around.parked:
            return v
        # If the gate is nearer than a radius, no robot has room before it.
        if (follower.route.gate_m or 0.0) < around.arena.shape.radius or gate.passed:
            return v
        at = Point(around.pose.x, around.pose.y)
        return 0.0 if waits_in_queue(around.arena, at, around.parked) else v


class GoalRule(Hazard):
    """The queue for a goal."""

    def limit(self, around: HazardScene, v: float) -> float:
        """Return `v`, or less: a robot whose goal is taken waits before it."""
        follower = around.follower
        if not around.ahead or follower is None:
            return v
        shape = around.arena.shape
        room = hold_m(follower.route, shape, around.ahead) - follower.s
        return v if room < -SLACK_RADII * shape.radius else min(v, braking_speed(room))
