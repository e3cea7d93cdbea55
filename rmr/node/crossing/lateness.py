"""The late policies: what the leader hears of a robot that cannot keep, or cannot get, its slot.

The order of slots and the order in which robots stand before an entrance may disagree: then the first by the one order
cannot get past the last by the other. So a robot that is late tells the leader one of three things:

* *postponed*: a later release;
* *demoted*: its deadline is now, and its release comes after a back-off, so that all that are due before go first;
* *committed*: it has set out, or stands where others must pass, so it goes before all that are not; nearest first.

`POLICIES` is the whole table. A crossing is diagnosed at most once per poll, and once per missed entry; all that the
diagnosis remembers is in `Lateness`.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from rmr.base.geometry import Point, Pose, distance
from rmr.base.time import Duration, Instant, milliseconds, seconds
from rmr.node.crossing.situation import Situation
from rmr.node.motion.gate import PUT_OFF_S

READY: Final[Duration] = milliseconds(200)
"""A robot is ready to enter when it will be at its commit line within this; less than the entry window."""
REVISE_FROM: Final[Duration] = milliseconds(250)
"""A later slot is asked for when the robot's own estimate has moved by more than this."""
BACK_OFF: Final[Duration] = seconds(3)
"""Back-off of a demoted robot, added to its release: time for another one to pass. Doubles after the first."""
BACK_OFF_MAX: Final[Duration] = seconds(6)
APPROACH_CHANGE: Final[Duration] = milliseconds(500)
"""A committed robot reports its approach anew when it has changed by this."""
APPROACH_MIN: Final[Duration] = milliseconds(20)
"""Shortest approach that is reported: a release that is past when it arrives says nothing new."""
NEAR_ENTRANCE: Final[Duration] = seconds(1)
"""A robot of a crowd with a shorter approach than this cannot be passed: it is committed instead of demoted."""
PROGRESS_M: Final = 0.1
"""Nearer to where it was a robot has made no progress: reversing a little and returning does not count."""
SLOT_IS_NEAR: Final[Duration] = seconds(2)
"""A robot whose slot begins within this blocks no entrance: it is about to go."""


class Symptom(Enum):
    """How a robot is late."""

    SLOT_WASTED = "slot wasted"
    RETRY_NEXT = "slot wasted near the entrance"
    DEFERRED = "deferred under way"
    BLOCKING_ENTRANCE = "blocking an entrance"
    POSTPONING = "postponing"
    STUCK = "postponing without progress"
    ENTRY_UNUSED = "entry not used"


class Remedy(Enum):
    """What the leader hears."""

    POSTPONED = "postponed"
    DEMOTED = "demoted"
    COMMITTED = "committed"


class LatePolicy(NamedTuple):
    """One row of the table."""

    evidence: str
    remedy: Remedy
    after: Duration = 0
    """How long the evidence must have lasted."""
    in_a_row: int = 1
    """How often in a row it must have been found."""


POLICIES: Final[dict[Symptom, LatePolicy]] = {
    Symptom.SLOT_WASTED: LatePolicy("not at the commit line in its entry window", Remedy.DEMOTED, in_a_row=2),
    Symptom.RETRY_NEXT: LatePolicy("the same in a crowd, under way and within 1 s of the line", Remedy.COMMITTED),
    Symptom.DEFERRED: LatePolicy(
        "under way, and the slot is 5 s later than it can be there; again when 0.5 s nearer or farther",
        Remedy.COMMITTED,
    ),
    Symptom.BLOCKING_ENTRANCE: LatePolicy(
        "stands in a one-way entrance, and its slot does not begin within 2 s", Remedy.COMMITTED, after=seconds(2)
    ),
    Symptom.POSTPONING: LatePolicy("its release is 0.25 s later than the leader has heard", Remedy.POSTPONED),
    Symptom.STUCK: LatePolicy(
        "the same again and again within 10 cm; counts as a wasted slot", Remedy.DEMOTED, seconds(4)
    ),
    Symptom.ENTRY_UNUSED: LatePolicy(
        "inside, but stands before the hold line, or drives away at once; asks anew", Remedy.DEMOTED, seconds(4)
    ),
}
"""Symptom -> evidence, after how long, what the leader hears."""


@dataclass(slots=True)
class Lateness:
    """What one crossing remembers of being late."""

    slots_wasted: int = 0
    """Slots in a row of no use, since the robot could not get to the entrance."""
    demoted_at: Instant | None = None
    """The deadline that the leader hears since the robot was demoted."""
    committed: bool = False
    """Whether the leader has heard that the robot is committed."""
    reported_approach: Duration = 0
    """The approach that a committed robot has reported."""
    stuck_at: Point | None = None
    """Where the robot was when it first postponed without progress since."""
    stuck_since: Instant = 0
    """When that was; later, if a slot has been wasted since."""
    blocking_since: Instant | None = None
    """Since when the robot has stood in an entrance."""

    def diagnose(
        self, now: Instant, found: Situation, approach: Duration, release: Instant, slot: Instant | None
    ) -> Symptom | None:
        """Return how the robot is late by what a poll has found, and remember that; None: it is in time.

        It can be at its commit line after `approach`; the leader has heard `release`, and has given it `slot`.
        """
        if self._blocks_entrance(now, slot, in_entrance=found.in_entrance):
            return Symptom.BLOCKING_ENTRANCE
        expected = now + approach
        if slot is None or expected > slot + READY:
            if expected <= release + REVISE_FROM:
                return None
            return Symptom.STUCK if self._is_stuck(now, found.pose) else Symptom.POSTPONING
        if not found.set_out:
            return None
        if self.committed:
            deferred = abs(approach - self.reported_approach) >= APPROACH_CHANGE
        else:  # a demoted robot has reported a later release than it could keep: until then it lets others go first
            deferred = slot - expected >= seconds(PUT_OFF_S) and expected >= release
        return Symptom.DEFERRED if deferred else None

    def treat(self, now: Instant, symptom: Symptom, approach: Duration, *, alone: bool = False) -> Instant | None:
        """Return the release that the leader hears; None where it hears nothing yet.

        A robot that is `alone` in the schedule need not let others go first.
        """
        ready = now + max(approach, APPROACH_MIN)
        match POLICIES[symptom].remedy:
            case Remedy.POSTPONED:
                return ready
            case Remedy.COMMITTED:
                self.committed = True
                self.reported_approach = approach
                return ready
            case Remedy.DEMOTED:
                pass
        in_a_row = POLICIES[Symptom.SLOT_WASTED].in_a_row
        # An entry of no use is worse than a slot of no use: it demotes at once, and by the longer back-off.
        self.slots_wasted = 1 + (in_a_row if symptom is Symptom.ENTRY_UNUSED else self.slots_wasted)
        self.stuck_since = now
        self.blocking_since = None
        further = self.slots_wasted - in_a_row
        if alone:
            return ready
        if further < 0:
            return ready if symptom is Symptom.STUCK else None
        self.demoted_at = now
        self.committed = False
        return ready + min(BACK_OFF << min(further, 1), BACK_OFF_MAX)

    def forget(self) -> None:
        """Begin anew with a job that is started anew, or at another resource."""
        self.slots_wasted = 0
        self.demoted_at = None
        self.committed = False
        self.stuck_at = None
        self.blocking_since = None

    def _blocks_entrance(self, now: Instant, slot: Instant | None, *, in_entrance: bool) -> bool:
        """Return whether the robot has stood in an entrance for too long.

        Those that go first by the order would wait for it to leave, and it for them.
        """
        if not in_entrance:
            self.blocking_since = None
            return False
        if self.blocking_since is None:
            self.blocking_since = now
        is_next = slot is not None and slot < now + SLOT_IS_NEAR
        if self.committed or is_next:
            return False
        return now - self.blocking_since >= POLICIES[Symptom.BLOCKING_ENTRANCE].after

    def _is_stuck(self, now: Instant, pose: Pose | None) -> bool:
        if pose is not None and (self.stuck_at is None or distance(*self.stuck_at, pose.x, pose.y) > PROGRESS_M):
            self.stuck_at = Point(pose.x, pose.y)
            self.stuck_since = now
        return now - self.stuck_since > POLICIES[Symptom.STUCK].after
