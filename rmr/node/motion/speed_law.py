"""The speed law: the ordered table of all hazard rules, and its application to one robot each tick.

Rules of the stage CAP limit the speed with which the path may be followed. The path follower then steers, and rules of
the stage BODY slow its wheel command along the same arc for each body around. docs/motion.md shows the table.
"""

from typing import Final

from rmr.base.geometry import Twist
from rmr.node.motion.hazards import (
    ArcRule,
    DangerRule,
    GateRule,
    Hazard,
    HazardScene,
    HazardStage,
    QueueRule,
    RightOfWay,
    SilenceRule,
    StoppingRule,
)
from rmr.node.motion.hearing import LISTENS, OVERDUE_HELLOS, SILENT
from rmr.node.motion.rule_switches import RuleSwitches

STRAIGHT_ON: Final[tuple[Hazard, ...]] = (
    DangerRule(
        "danger",
        HazardStage.BODY,
        "somebody ahead",
        "*stop if dangerous* (paper IV.E): the speed falls with the gap to a body whose closest point of approach is "
        "nearer than two radii and 25 mm",
        "avoid.py",
    ),
    StoppingRule(
        "stopping",
        HazardStage.BODY,
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
        HazardStage.CAP,
        "the bottleneck, before the robot's slot",
        "the speed with which the robot reaches the commit line as its slot opens; a stop at the hold line while the "
        "gate is closed",
        "gate.py",
    ),
    RightOfWay(
        "right_of_way",
        HazardStage.CAP,
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
        HazardStage.CAP,
        "robots that go first and still stand before the gate",
        "a robot waits for those in the places of the queue before its own to leave",
        "queueing.py",
    ),
    Hazard(
        "memory",
        HazardStage.PERCEPTION,
        "a body that has left the narrow view",
        "it is remembered for 0.8 s where it would be now, or until its robot says where it is; one that crept, where "
        "it was, too",
        "body_memory.py",
    ),
    Hazard(
        "cooperation",
        HazardStage.PERCEPTION,
        "somebody from the side, unseen",
        "*cooperative perception*: a robot that is near, not in view and heard is a body all the same, at the place "
        "and with the velocity of its last hello",
        "hearing.py",
    ),
    Hazard(
        "order",
        HazardStage.PERCEPTION,
        "paths that converge, as before the gate",
        "the later in the order slows down early for the other, at 2.5 (m/s)/m of gap, the earlier late, at "
        "6 (m/s)/m, on whichever side it has it; without an order the one that has the other on its right gives way",
        "avoid.py",
    ),
    *STRAIGHT_ON,
    ArcRule(
        STRAIGHT_ON,
        "arc",
        "somebody abeam, on the inner side of a turn",
        "a robot whose direction changes by more than 0.1 rad while it brakes applies the two rules above a second "
        "time, in the direction of the chord of the arc on which it would brake, also to robots that it hears up to "
        "10 cm behind its axle",
        "hazards.py",
    ),
    Hazard(
        "reverse_guard",
        HazardStage.WHEELS,
        "somebody or something behind a robot that backs up",
        "a reverse manoeuvre stops 3 cm short of a wall and of every body that is known; one behind that drives off "
        "is taken to be where it was heard last, for it may have stopped since",
        "navigator.py",
    ),
    Hazard(
        "promise",
        HazardStage.WHEELS,
        "robots that stand in a crowd, of whose hellos some are lost",
        "a robot that has said that it stays does not move for 3 s, and is not silent meanwhile",
        "driver.py",
    ),
    Hazard(
        "unwatched",
        HazardStage.WHEELS,
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
        self._caps: Final = [rule for rule in in_force if rule.stage is HazardStage.CAP]
        self._body_rules: Final = [rule for rule in in_force if rule.stage is HazardStage.BODY]

    def cap(self, around: HazardScene) -> float:
        """Return the greatest speed with which the path may be followed now, m/s."""
        v = around.arena.shape.speed
        for rule in self._caps:
            if (allowed := rule.limit(around, v)) < v:
                self._switches.count(rule.name)
                v = allowed
        return v

    def slowed(self, around: HazardScene, twist: Twist) -> Twist:
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
