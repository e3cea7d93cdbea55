"""What one incarnation of a robot did: its provenance log, joined and indexed.

What a log does not tell (which turn an action waits for, the end of the process) is added by a listener, which looks at
the node of a replay.
"""

from collections import defaultdict

from rmr.base.time import NEVER, Instant
from rmr.bytecode.heads import folds, inner
from rmr.bytecode.program import ANY, Atom, Constant, Duty, Mode, Pattern, Program
from rmr.coord.events import ScheduleChanged, SlotAssigned
from rmr.node import payloads
from rmr.node.actions.action_log import ActionBegun, ActionEnded, ActionHeld
from rmr.node.logic.deliveries import DeliveryRefused, delivery_text
from rmr.node.logic.exchange import WHY_GIVEN_UP, DeliveryProgress, Sent, Stage
from rmr.node.payloads import PayloadKind, WireError
from rmr.node.ports import Spoken
from rmr.vm.evaluate import same
from rmr.vm.machine_events import (
    ActionCancelled,
    ActionDerived,
    FactSent,
    FinishAwaited,
    FinishSeen,
    GoalAchieved,
    GoalSent,
    GoalWithdrawn,
    JobFinished,
    JobMissed,
    JobStarted,
)
from rmr.vm.match import pattern_agrees
from rmr.vm.provenance import (
    OUTSIDE,
    SENSED,
    ActionRecord,
    DeliveredCause,
    FiringCause,
    FiringRecord,
    GoalRecord,
    InsertionRecord,
    JobRecord,
    ProvenanceRecord,
    RemovalRecord,
    SendRecord,
    SentKey,
    ToldRecord,
    UndeliveredCause,
)
from rmr.vm.store import Args
from rmr.why.past_items import (
    PastAction,
    PastArrival,
    PastDelivery,
    PastFact,
    PastGoal,
    PastItem,
    PastJob,
    PastSend,
)


class MindIndex:
    """One incarnation of a robot."""

    def __init__(
        self, robot: int, epoch: int, program: Program, begins: Instant = 0, before: "MindIndex | None" = None
    ) -> None:
        """`before` is the robot's incarnation before this one."""
        self.robot = robot
        self.epoch = epoch
        self.program = program
        self.begins = begins
        self.items: list[PastItem] = []
        self.first_number = 1 if before is None else before.next_number
        self.place: int = 0 if before is None else before.place
        """Of the newest record."""
        self.facts: dict[int, PastFact] = {}
        """By the serial number of the insertion."""
        self.by_predicate: defaultdict[int, list[PastFact]] = defaultdict(list)
        self.firings: dict[int, FiringRecord] = {}
        self.firing_places: dict[int, int] = {}
        """By number of a firing: its place."""
        self.actions: dict[int, PastAction] = {}
        self.begun: list[PastAction] = []
        """Those of the robot's own that have begun, in this order."""
        self.sends: list[PastSend] = []
        self.deliveries: dict[SentKey, PastDelivery] = {}
        self.goals: list[PastGoal] = []
        self.achieved: list[PastGoal] = []
        """In the order in which they were; a goal that was opened more than once stands here once."""
        self.jobs: dict[int, PastJob] = {}
        self.schedule_log: list[tuple[Instant, ScheduleChanged]] = []
        self._schedules: dict[bytes, ScheduleChanged] = {}
        self._slot: bytes | None = None
        self.schedules: dict[int, ScheduleChanged] = {}
        """By the serial number of a fact ``turn``: the schedule that it comes from."""
        self.arrived: dict[DeliveredCause, PastArrival] = {}
        self.died: Instant = NEVER
        """When its process has ended; NEVER: not before the end of the run."""
        self.stopped = False
        """Whether the process was stopped in order."""
        self.wheels: set[int] = set()
        """Actions that need the wheels, by predicate."""
        self._handles = 0
        self._open: defaultdict[int, list[PastGoal]] = defaultdict(list)

    @property
    def next_number(self) -> int:
        """Number of the first item of the next incarnation."""
        return self.first_number + len(self.items)

    @property
    def own_actions(self) -> list[PastAction]:
        """The actions that the robot carries out itself."""
        return [action for action in self.actions.values() if action.executor == self.robot]

    def ended(self, action: PastAction) -> Instant:
        """Return when an action was over, at the latest with the process; NEVER: it goes on."""
        return min(NEVER if action.ended is None else action.ended, self.died)

    def start_of(self, job: int, place: int) -> PastFact | None:
        """Return the fact that has started a job last before a place, by the job's serial number."""
        starts = self.jobs[job].starts if job in self.jobs else []
        return next((start for start in reversed(starts) if start.place < place), None)

    def asked_for(self, turn: PastFact) -> PastFact | None:
        """Return the fact that has started the job which asks for a turn."""
        named = [each for each in self.jobs.values() if each.job is not None and each.job.name == turn.args[0]]
        starts = [start for each in named for start in each.starts if start.place < turn.place]
        return max(starts, key=lambda each: each.place, default=None)

    def undelivered(self, cause: UndeliveredCause, at: Instant) -> PastDelivery | None:
        """Return the message of which a robot knows at an instant that it was given up."""
        if cause.sent is not None:
            return self.deliveries.get(cause.sent)
        for send in reversed(self.sends):
            given_up = send.given_up is not None and send.given_up <= at
            if given_up and (send.destination, self.program.predicates[send.predicate].name) == cause[:2]:
                return send
        return None

    def newest_premise(self, firing: FiringRecord) -> tuple[PastFact, bool] | None:
        """Return the newest fact that a firing has matched, or the newest that must not hold and (True) was removed."""
        place = self.firing_places[firing.number]
        matched = firing.matched or [serial for origin in firing.derived for serial in origin.inner]
        found = [(self.facts[serial].place, False, self.facts[serial]) for serial in matched]
        for each in self.program.rules[firing.rule].body:
            if isinstance(each, Atom) and each.mode is Mode.ABSENT:
                removed = [fact for fact in self.by_predicate[each.predicate] if fact.removed_place < place]
                found += [(fact.removed_place, True, fact) for fact in removed]
        newest = max(found, key=lambda each: each[0], default=None)
        return None if newest is None else (newest[2], newest[1])

    def found_nothing(self, firing: FiringRecord) -> bool:
        """Return whether a firing has derived nothing, by a rule whose head looks for facts."""
        if not any(inner(self.program.rules[firing.rule].head)):
            return False
        causes = [item.cause for item in self.items]
        return not any(isinstance(cause, FiringCause) and cause.number == firing.number for cause in causes)

    def held(self, predicate: int, now: Instant) -> list[PastFact]:
        """Return the facts of `predicate` that held after all that happened at `now`, oldest first."""
        return [fact for fact in self.by_predicate[predicate] if fact.held_at(now)]

    def held_before(self, predicate: int, firing: int) -> list[PastFact]:
        """Return the facts of `predicate` that held just before a firing, oldest first."""
        place = self.firing_places[firing]
        return [fact for fact in self.by_predicate[predicate] if fact.place < place < fact.removed_place]

    def heard_within(self, firing: FiringRecord) -> list[PastFact]:
        """Return what neighbours had told that the aggregates in the body of a firing's rule have taken up."""
        heard = [each.predicate for each in self.program.ensemble if each.duty is Duty.HEARD]
        found: dict[int, PastFact] = {}
        for fold in folds(self.program.rules[firing.rule].body) if heard else ():
            # What the aggregate has bound itself may differ from match to match.
            known = tuple([None if slot in fold.slots else value for slot, value in enumerate(firing.bindings)])
            for atom in fold.body:
                if isinstance(atom, Atom) and atom.predicate in heard and atom.mode is not Mode.ABSENT:
                    facts = self.held_before(atom.predicate, firing.number)
                    found.update((fact.serial, fact) for fact in facts if pattern_agrees(atom.args, fact.args, known))
        return list(found.values())

    def take(self, record: ProvenanceRecord) -> None:
        """Take in the next record."""
        self.place += 1
        match record:
            case InsertionRecord(at, serial, predicate, args, cause):
                fact = PastFact(self.next_number, serial, predicate, args, at, self.place, cause)
                self.items.append(fact)
                self.facts[serial] = fact
                self.by_predicate[predicate].append(fact)
                if cause == SENSED and self._slot is not None and self._slot in self._schedules:
                    self.schedules[serial] = self._schedules[self._slot]
            case RemovalRecord(at, serial, cause):
                fact = self.facts[serial]
                fact.until = at
                fact.removal = cause
                fact.removed_place = self.place
            case FiringRecord():
                self.firings[record.number] = record
                self.firing_places[record.number] = self.place
            case ActionRecord():
                self._acted(record)
            case GoalRecord(at, predicate, args, cause):
                goal = PastGoal(self.next_number, predicate, args, at, self.place, cause)
                self.items.append(goal)
                self.goals.append(goal)
                self._open[predicate].append(goal)
            case SendRecord(at, role, destination, predicate, args, cause):
                send = PastSend(self.next_number, role, destination, predicate, args, at, self.place, cause)
                self.items.append(send)
                self.sends.append(send)
            case JobRecord(_, job, fact_serial):
                self.jobs.setdefault(job, PastJob()).starts.append(self.facts[fact_serial])
            case ToldRecord(at, event):
                self._told(at, event)

    def _acted(self, record: ActionRecord) -> None:
        action = PastAction(
            self.next_number,
            record.serial,
            record.predicate,
            record.executor,
            record.args,
            record.at,
            self.place,
            record.cause,
            record.then,
        )
        self.items.append(action)
        self.actions[record.serial] = action

    def _progressed(self, at: Instant, event: ActionHeld | ActionBegun | ActionEnded) -> None:
        action = self.actions.get(event.serial)
        if action is None:
            return
        match event:
            case ActionHeld(turn=turn):
                action.held = at
                action.group = turn
            case ActionBegun(turn=turn):
                action.begun = at
                action.group = action.group and (turn or action.group)
                self.begun.append(action)
            case ActionEnded(failure=failure):
                action.ended = at
                action.failure = failure

    def _told(self, at: Instant, event: object) -> None:
        match event:
            case DeliveryProgress():
                self._delivered(at, event)
            case ScheduleChanged():
                self._schedules[event.group_id] = event
                self.schedule_log.append((at, event))
            case SlotAssigned(group_id=group_id):
                self._slot = group_id
            case JobStarted() | JobFinished() | JobMissed():
                self._job(at, event)
            case DeliveryRefused(of, why):
                refused = self._sent(of)
                refused.given_up = at
                refused.why = why
            case Spoken():
                self._spoken(at, event)
            case GoalAchieved() | GoalWithdrawn():
                self._goal(event)
            case ActionHeld() | ActionBegun() | ActionEnded():
                self._progressed(at, event)
            case ActionDerived(serial=serial) if serial and serial not in self.actions:
                # Under way when the program changed: it is derived by no rule of this one.
                self._acted(ActionRecord(at, serial, event.predicate, event.executor, event.args, OUTSIDE, ()))
            case ActionCancelled(serial=serial, served=served):
                if serial in self.actions:
                    self.actions[serial].cancelled_with = served
            case _:  # of many others nothing is explained
                pass

    def _job(self, at: Instant, event: JobStarted | JobFinished | JobMissed) -> None:
        known = self.jobs.setdefault(event.job.serial, PastJob())
        known.job = event.job
        if isinstance(event, JobFinished):
            known.learned = at

    def _sent(self, of: Sent | None) -> PastDelivery:
        """Return what the sender knows of the message that was sent for `of`."""
        match of:
            case FactSent(number=number) | GoalSent(number=number) | ActionDerived(number=number):
                return self.sends[number - 1]
            case FinishSeen(assertion=assertion, args=args):
                return PastDelivery(news=self._newest(self.program.assertions[assertion].finish.predicate, args))
            case FinishAwaited(assertion=assertion, start_args=args):
                return PastDelivery(news=self._newest(self.program.assertions[assertion].start.predicate, args))
            case ActionEnded(serial=serial):
                return PastDelivery(news=self.actions.get(serial))
            case None:
                return PastDelivery()

    def _newest(self, predicate: int, args: Args) -> PastFact | None:
        """Return the newest fact with these arguments; None if there is none."""
        return next((fact for fact in reversed(self.by_predicate[predicate]) if fact.args == args), None)

    def _delivered(self, at: Instant, event: DeliveryProgress) -> None:
        stage, peer, epoch, sequence, *_ = event
        key = SentKey(peer, epoch, sequence)
        if stage is Stage.ACCEPTED:
            self.arrived.setdefault(DeliveredCause(peer, epoch, sequence), PastArrival(at, self.place))
        elif stage is Stage.RELEASED:
            # Until now it waited for the delivery of an earlier one.
            self.arrived[DeliveredCause(peer, epoch, sequence)] = PastArrival(at, self.place)
        elif stage is Stage.BEGUN:
            begun = self._sent(event.of)
            begun.key = key
            begun.begun = at
            assert event.delivery is not None
            begun.text = delivery_text(self.program, event.delivery, self.robot, peer)
            self.deliveries[key] = begun
        elif (sent := self.deliveries.get(key)) is not None:
            if stage is Stage.REPEATED:
                sent.repeated.append(at)
            elif stage is Stage.ACKNOWLEDGED:
                sent.acknowledged = at
            else:
                sent.given_up = at
                sent.why = WHY_GIVEN_UP[stage]

    def _spoken(self, at: Instant, event: Spoken) -> None:
        self._handles += 1
        payload = event.payload
        if event.destination is None or not payload or payload[0] not in (PayloadKind.FACT, PayloadKind.FRAGMENT):
            return
        try:
            frame = payloads.decode_fact_frame(payload)
        except WireError:
            return
        sent = self.deliveries.get(SentKey(event.destination, frame.epoch, frame.sequence))
        if sent is not None:
            sent.transmissions.append((at, event.handle or self._handles))

    def _goal(self, event: GoalAchieved | GoalWithdrawn) -> None:
        """Note the end of a goal that was open."""
        goals = self._open[event.predicate]
        goal = next((each for each in goals if _is_goal(each.args, event.args)), None)
        if goal is None:
            return
        if isinstance(event, GoalAchieved):
            self.achieved.append(goal)
        for each in [each for each in goals if each.args == goal.args]:  # a goal may be opened again while it is open
            goals.remove(each)
            if isinstance(event, GoalAchieved):
                each.achieved = event.at
            else:
                each.withdrawn = event.at
                each.served = event.served


def _is_goal(patterns: tuple[Pattern, ...], args: tuple[object, ...]) -> bool:
    """Return whether `args`, values or ANY, are those of a goal."""
    return all(
        same(pattern.value, arg) if isinstance(pattern, Constant) else arg is ANY  # type: ignore[arg-type]
        for pattern, arg in zip(patterns, args, strict=True)
    )
