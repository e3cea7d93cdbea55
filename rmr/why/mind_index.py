"""The provenance log of one incarnation, joined and indexed: facts with the time for which they held, and so on.

An item is whatever an explanation can name: a fact, an action, a goal, a message. Items are numbered in the order in
which they came, over all incarnations of a robot, so that a number means the same in every answer.
"""

from collections import defaultdict
from dataclasses import dataclass, field

from rmr.base.time import NEVER, Instant
from rmr.bytecode.program import ANY, Constant, Pattern, Program
from rmr.coord.events import ScheduleChanged, SlotAssigned
from rmr.node.logic.exchange import WHY_GIVEN_UP, DeliveryProgress, Stage
from rmr.vm.derive import Chain, DerivedKind
from rmr.vm.evaluate import same
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import ActionCancelled, GoalAchieved, GoalWithdrawn, JobStarted
from rmr.vm.provenance import (
    SENSED,
    ActionRecord,
    ActionStage,
    Args,
    Cause,
    DeliveredCause,
    FiringRecord,
    GoalRecord,
    InsertionRecord,
    JobRecord,
    ProvenanceRecord,
    RefusedRecord,
    RemovalRecord,
    SendingRecord,
    SendRecord,
    ToldRecord,
)
from rmr.why.mind_history import MindHistory


@dataclass(slots=True, eq=False)
class PastFact:
    """A fact of the robot, from its insertion to its removal."""

    number: int
    serial: int
    predicate: int
    args: Args
    at: Instant
    cause: Cause
    until: Instant = NEVER
    """When it was removed; NEVER: it holds."""
    removal: Cause | None = None
    place: int = 0
    """Of its insertion among the records."""
    removed_place: int = 1 << 62

    def held_at(self, now: Instant) -> bool:
        """Return whether it held after all that happened at `now`."""
        return self.at <= now < self.until


EndedGoal = tuple[int, tuple[object, ...]]
"""Predicate and arguments (values, or ANY) of a goal that is no longer open."""


@dataclass(slots=True, eq=False)
class PastAction:
    """An action that the robot executes, or whose end it awaits."""

    number: int
    serial: int
    predicate: int
    executor: int
    args: Args
    at: Instant
    cause: Cause
    then: Chain
    held: Instant | None = None
    """Since when it waited for its turn; None: it never did."""
    group: str = ""
    begun: Instant | None = None
    ended: Instant | None = None
    failure: str | None = None
    cancelled_with: EndedGoal | None = None
    """The goal whose achievement or withdrawal ended it."""

    def under_way_at(self, now: Instant) -> bool:
        """Return whether it had begun and not ended before `now`."""
        return self.begun is not None and self.begun <= now and (self.ended is None or self.ended >= now)


@dataclass(slots=True, eq=False)
class PastSend:
    """A fact, goal or action that was sent to another robot."""

    number: int
    role: DerivedKind
    destination: int
    predicate: int
    args: Args
    at: Instant
    cause: Cause
    epoch: int
    """The sender's, as in its frames."""
    sequence: int | None = None
    """None: it never left."""
    repeated: list[Instant] = field(default_factory=list)
    acknowledged: Instant | None = None
    given_up: Instant | None = None
    why: str = ""


@dataclass(slots=True, eq=False)
class PastGoal:
    """A goal of the robot."""

    number: int
    predicate: int
    args: tuple[Pattern, ...]
    at: Instant
    cause: Cause
    achieved: Instant | None = None
    withdrawn: Instant | None = None
    served: EndedGoal | None = None
    """Of a sub-goal that ended: the goal whose achievement or withdrawal ended it."""


PastItem = PastFact | PastAction | PastSend | PastGoal


@dataclass(slots=True, eq=False)
class PastJob:
    """A job of a time assertion, as of its last start."""

    job: TimedJob | None = None
    starts: list[tuple[Instant, int]] = field(default_factory=list)
    """Instant and start fact of each start."""


class MindIndex:
    """One incarnation of a robot."""

    def __init__(self, history: MindHistory, program: Program, first_number: int = 1) -> None:
        self.robot = history.robot
        self.epoch = history.epoch
        self.program = program
        self.items: list[PastItem] = []
        self.first_number = first_number
        self.facts: dict[int, PastFact] = {}
        """By the serial number of the insertion."""
        self.by_predicate: defaultdict[int, list[PastFact]] = defaultdict(list)
        self.firings: dict[int, FiringRecord] = {}
        self.firing_places: dict[int, int] = {}
        """By number of a firing: its place among the records."""
        self.actions: dict[int, PastAction] = {}
        self.sends: list[PastSend] = []
        self.goals: list[PastGoal] = []
        self.jobs: dict[int, PastJob] = {}
        self.schedule_log: list[tuple[Instant, ScheduleChanged]] = []
        self._schedules: dict[bytes, ScheduleChanged] = {}
        self._slot: bytes | None = None
        self.schedules: dict[int, ScheduleChanged] = {}
        """By the serial number of a fact ``turn``: the schedule that it comes from."""
        self.arrived: dict[DeliveredCause, Instant] = {}
        self.begins: Instant = 0
        self._by_event: dict[int, PastSend] = {}
        self._sent: dict[tuple[int, int], PastSend] = {}
        self._sending: PastSend | None = None
        self._open: defaultdict[int, list[PastGoal]] = defaultdict(list)
        for place, record in enumerate(history.records):
            if place == 0:
                self.begins = record.at
            self._take(place, record)

    @property
    def next_number(self) -> int:
        """Number of the first item of the next incarnation."""
        return self.first_number + len(self.items)

    def sent(self, destination: int, sequence: int) -> PastSend | None:
        """Return what was sent to a robot under a sequence number; None if that was no item."""
        return self._sent.get((destination, sequence))

    def held(self, predicate: int, now: Instant) -> list[PastFact]:
        """Return the facts of `predicate` that held after all that happened at `now`, oldest first."""
        return [fact for fact in self.by_predicate[predicate] if fact.held_at(now)]

    def held_before(self, predicate: int, firing: int) -> list[PastFact]:
        """Return the facts of `predicate` that held just before a firing, oldest first."""
        place = self.firing_places[firing]
        return [fact for fact in self.by_predicate[predicate] if fact.place < place < fact.removed_place]

    def _number(self) -> int:
        return self.first_number + len(self.items)

    def _take(self, place: int, record: ProvenanceRecord) -> None:
        match record:
            case InsertionRecord(at, serial, predicate, args, cause):
                fact = PastFact(self._number(), serial, predicate, args, at, cause, place=place)
                self.items.append(fact)
                self.facts[serial] = fact
                self.by_predicate[predicate].append(fact)
                if cause == SENSED and self._slot is not None and self._slot in self._schedules:
                    self.schedules[serial] = self._schedules[self._slot]
            case RemovalRecord(at, serial, cause):
                fact = self.facts[serial]
                fact.until = at
                fact.removal = cause
                fact.removed_place = place
            case FiringRecord():
                self.firings[record.number] = record
                self.firing_places[record.number] = place
            case ActionRecord():
                self._acted(record)
            case ActionStage():
                self._progressed(record)
            case GoalRecord(at, predicate, args, cause):
                goal = PastGoal(self._number(), predicate, args, at, cause)
                self.items.append(goal)
                self.goals.append(goal)
                self._open[predicate].append(goal)
            case SendRecord() | SendingRecord() | RefusedRecord():
                self._send(record)
            case JobRecord(at, job, fact_serial):
                self.jobs[job] = known = self.jobs.get(job) or PastJob()
                known.starts.append((at, fact_serial))
            case ToldRecord(at, event):
                self._told(at, event)

    def _acted(self, record: ActionRecord) -> None:
        action = PastAction(
            self._number(),
            record.serial,
            record.predicate,
            record.executor,
            record.args,
            record.at,
            record.cause,
            record.then,
        )
        self.items.append(action)
        self.actions[record.serial] = action

    def _progressed(self, record: ActionStage) -> None:
        action = self.actions.get(record.serial)
        if action is None:
            return
        if record.stage == "held":
            action.held = record.at
            action.group = record.words or ""
        elif record.stage == "begun":
            action.begun = record.at
            action.group = action.group and (record.words or action.group)
        else:
            action.ended = record.at
            action.failure = record.words

    def _send(self, record: SendRecord | SendingRecord | RefusedRecord) -> None:
        match record:
            case SendRecord(at, event, role, destination, predicate, args, cause):
                number = self._number()
                send = PastSend(number, role, destination, predicate, args, at, cause, self.epoch & 0xFF)
                self.items.append(send)
                self.sends.append(send)
                self._by_event[event] = send
            case SendingRecord(_, event):
                self._sending = self._by_event.get(event)
            case RefusedRecord(at, _, why):
                if self._sending is not None:
                    self._sending.given_up = at
                    self._sending.why = why
                    self._sending = None

    def _told(self, at: Instant, event: object) -> None:
        match event:
            case DeliveryProgress(stage, peer, epoch, sequence):
                self._delivered(at, stage, peer, epoch, sequence)
            case ScheduleChanged():
                self._schedules[event.group_id] = event
                self.schedule_log.append((at, event))
            case SlotAssigned(group_id=group_id):
                self._slot = group_id
            case JobStarted(job):
                if job.serial in self.jobs:
                    self.jobs[job.serial].job = job
            case GoalAchieved(predicate, args, when):
                goal = self._closed(predicate, args)
                if goal is not None:
                    goal.achieved = when
            case GoalWithdrawn(predicate, args, when, served):
                goal = self._closed(predicate, args)
                if goal is not None:
                    goal.withdrawn = when
                    goal.served = served
            case ActionCancelled(serial=serial, served=served):
                if serial in self.actions:
                    self.actions[serial].cancelled_with = served
            case _:  # of many others nothing is explained
                pass

    def _delivered(self, at: Instant, stage: Stage, peer: int, epoch: int, sequence: int) -> None:
        if stage in (Stage.ACCEPTED, Stage.RELEASED):
            self.arrived[DeliveredCause(peer, epoch, sequence)] = at
        elif stage is Stage.BEGUN:
            if self._sending is not None:
                self._sending.sequence = sequence
                self._sent[peer, sequence] = self._sending
            self._sending = None
        elif (send := self._sent.get((peer, sequence))) is not None:
            if stage is Stage.REPEATED:
                send.repeated.append(at)
            elif stage is Stage.ACKNOWLEDGED:
                send.acknowledged = at
            else:
                send.given_up = at
                send.why = WHY_GIVEN_UP[stage]

    def _closed(self, predicate: int, args: tuple[object, ...]) -> PastGoal | None:
        """Return the goal that is no longer open."""
        for goal in self._open[predicate]:
            if _is_goal(goal.args, args):
                self._open[predicate].remove(goal)
                return goal
        return None


def _is_goal(patterns: tuple[Pattern, ...], args: tuple[object, ...]) -> bool:
    """Return whether `args`, values or ANY, are those of a goal."""
    return all(
        same(pattern.value, arg) if isinstance(pattern, Constant) else arg is ANY  # type: ignore[arg-type]
        for pattern, arg in zip(patterns, args, strict=True)
    )
