"""The speed law: the ordered table of all hazard rules, and its application to one robot each tick.

Rules of the stage CAP limit the speed with which the path may be followed. The path follower then steers, and rules of
the stage WHEELS slow its command along the same arc. docs/motion.md shows the table.
"""

from typing import Final

from rmr.node.motion.hazards import (
    GateRule,
    GoalRule,
    Hazard,
    HazardScene,
    HazardStage,
    QueueRule,
    RightOfWay,
    SilenceRule,
)
from rmr.node.motion.hearing import CUT_OFF, LISTENS, OVERDUE_HELLOS, SILENT
from rmr.node.motion.rule_switches import RuleSwitches

HAZARDS: Final[tuple[Hazard, ...]] = (
    GateRule(
        "gate",
        HazardStage.CAP,
        "the bottleneck, before the robot's slot",
        "the robot reaches the commit line as its slot opens, and stops at the hold line while the gate is closed",
        "gate.py",
    ),
    RightOfWay(
        "right_of_way",
        HazardStage.CAP,
        "paths that cross",
        "the earlier in the order goes first; the later takes the largest share of its speed that keeps clear; between "
        "drives to one place the queue decides",
        "priority.py",
    ),
    SilenceRule(
        LISTENS,
        "listen",
        "a robot that has never been heard",
        "a robot that starts or restarts stands until it has heard a position of each robot of the roster, 10 s at "
        "most, or 60 s if others hear the one that it misses; on a floor wider than the radio reaches a restarted "
        "robot listens for 1.2 s",
        "hearing.py",
    ),
    SilenceRule(
        CUT_OFF,
        "majority",
        "a robot that the others do not hear, or hardly any, and presume dead",
        "the robot stands without [a majority](safety.md#the-rules); after 60 s without one it drives by sight",
        "link_sensing.py",
    ),
    SilenceRule(
        SILENT,
        "silence",
        "radio that is cut, a process that is stopped, a robot that has died",
        "a robot stands while one that has not been heard for 1.2 s (2.4 s if it was parked) [may come "
        "there](safety.md#the-rules)",
        "hearing.py",
    ),
    SilenceRule(
        OVERDUE_HELLOS,
        "overdue",
        "a near robot that misses a hello or two",
        "of one that is not in view and not behind, two overdue hellos are a silence (0.6 s if it drives, 1.3 s if it "
        "is parked); for a robot that sets out a single one of a parked robot is (0.7 s)",
        "hearing.py",
    ),
    QueueRule(
        "queue",
        HazardStage.CAP,
        "robots that go first and still stand before the gate",
        "a robot waits for those in the places of the queue before its own to leave, and leaves one that comes from "
        "beside it the way to the gate, from eight radii on",
        "queueing.py",
    ),
    GoalRule(
        "goal",
        HazardStage.CAP,
        "several robots that drive to one place",
        "a robot whose goal is taken waits six radii before it; each that goes later (farther off by six radii, else "
        "later in the order) waits three radii farther away, up to five of them; robots on each other's goals go",
        "goal_queue.py",
    ),
    Hazard(
        "memory",
        HazardStage.PERCEPTION,
        "a body that has left the narrow view",
        "it is remembered for 0.8 s, or until its robot is heard, at its extrapolated place; a slow one also where it "
        "was seen",
        "body_memory.py",
    ),
    Hazard(
        "cooperation",
        HazardStage.PERCEPTION,
        "a robot that approaches from the side, unseen",
        "a robot that is near and heard counts as a body, at the place and with the velocity of its last hello",
        "hearing.py",
    ),
    Hazard(
        "order",
        HazardStage.PERCEPTION,
        "paths that converge, as before the gate",
        "[the later in the order](safety.md#robots-that-drive) slows down early for the other",
        "ways.py",
    ),
    Hazard(
        "ways",
        HazardStage.WHEELS,
        "a body around",
        "the command is slowed, so that the way on which the robot comes to stand is clear of [that of each other "
        "one](safety.md#robots-that-drive)",
        "ways.py",
    ),
    Hazard(
        "sight",
        HazardStage.WHEELS,
        "a dead robot that has driven on since it was heard last",
        "a robot drives [only where it has just looked](safety.md#the-rules)",
        "speed_control.py",
    ),
    Hazard(
        "reverse_guard",
        HazardStage.WHEELS,
        "a body or a wall behind a robot that reverses",
        "a reverse manoeuvre stops 3 cm short of a wall and of every known body; one behind that drives away is taken "
        "to be where it was heard last, and one that does not is taken to have driven here at full speed since. "
        "Before a wall alone the robot turns on the spot until it can back up beside it",
        "navigator.py",
    ),
    Hazard(
        "shield",
        HazardStage.WHEELS,
        "a robot or a wall that is nearer than estimated",
        "the command is slowed, so that the robot [can always stand](safety.md#the-shield) short of each wall and "
        "standing robot; nearer it only drives away",
        "shield.py",
    ),
    Hazard(
        "promise",
        HazardStage.WHEELS,
        "lost hellos of robots that stand in a crowd",
        "a robot that has promised to stay does not move for 3 s, and does not count as silent meanwhile",
        "driver.py",
    ),
    Hazard(
        "unwatched",
        HazardStage.WHEELS,
        "a host that is too slow, so that samples wait to be read",
        "a robot whose newest sample is more than 50 ms old moves at most 1 cm unseen; with one older than 100 ms it "
        "stands",
        "driver.py",
    ),
)
"""All hazard rules, in the order in which they are applied."""


class SpeedLaw:
    """The rules of `HAZARDS` that are in force, applied in order."""

    __slots__ = ("_caps", "_switches", "limited_by")

    def __init__(self, switches: RuleSwitches) -> None:
        self._switches = switches
        self.limited_by = ""
        """The rule that has lowered the speed of this tick last; empty: none has."""
        in_force = [rule for rule in HAZARDS if not switches.off(rule.name)]
        self._caps: Final = [rule for rule in in_force if rule.stage is HazardStage.CAP]

    def cap(self, around: HazardScene) -> float:
        """Return the greatest speed with which the path may be followed now, m/s."""
        v = around.arena.shape.speed
        self.limited_by = ""
        for rule in self._caps:
            if (allowed := rule.limit(around, v)) < v:
                self._switches.count(rule.name)
                self.limited_by = rule.name
                v = allowed
        return v
