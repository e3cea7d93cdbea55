"""Makes the history of a robot from its mind: its provenance log, and a look at the node after each call.

The mind is the twin that a replay drives, or a node of a simulated run. Its configuration needs the listener's `log` as
provenance log, and a witness, of whatever kind: without one a node does not tell which frames it hands to its radio.
The listener changes nothing in the node.
"""

from typing import Any, Protocol

from rmr.base.time import NEVER, NS_PER_S, TICK_HZ, Duration, Instant
from rmr.bytecode.program import Program
from rmr.coord.events import ScheduleChanged
from rmr.node import payloads
from rmr.node.actions.dispatcher import Dispatcher
from rmr.node.config import NodeConfig
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.crossings import Crossings
from rmr.node.crossing.phases import Preparing
from rmr.node.driver import Driver
from rmr.node.logic.exchange import WHY_GIVEN_UP, DeliveryProgress, Stage
from rmr.node.motion.hindrance import Hindrance
from rmr.node.motion.localiser import MISTAKEN_M
from rmr.node.payloads import PayloadKind, WireError
from rmr.node.peers.perception import Peers
from rmr.node.ports import Spoken
from rmr.node.services import RobotServices
from rmr.node.standstill import Motion, MotionState, motion_state
from rmr.node.trace import Trace, fact_text, rule_text
from rmr.vm.machine_events import FinishSeen, JobFinished, JobMissed, JobStarted
from rmr.vm.provenance import (
    ActionRecord,
    ActionStage,
    Cause,
    DeliveredCause,
    EffectCause,
    FiringCause,
    FiringRecord,
    GivenCause,
    GoalRecord,
    HandlerCause,
    InsertionRecord,
    JobRecord,
    MissedCause,
    OutsideCause,
    ProvenanceLog,
    ProvenanceRecord,
    RefusedRecord,
    RemovalRecord,
    SendingRecord,
    SendRecord,
    SensedCause,
    StandsCause,
    StepCause,
    ToldRecord,
    UndeliveredCause,
)
from rmr.why.robot_history import (
    ActionSpan,
    CauseKind,
    Change,
    DeliverySpan,
    EventCause,
    KnownOrder,
    LostDelivery,
    PassageSpan,
    RobotHistory,
    TimedFiring,
    TurnGate,
)
from rmr.why.true_places import TruePlaces

LATE: Duration = NS_PER_S // TICK_HZ
"""A call that comes later than it was due by more than a frame is late."""
_GIVEN = EventCause(CauseKind.GIVEN)


class WatchedNode(Protocol):
    """What the listener looks at: `rmr.node.node.Node`."""

    config: NodeConfig
    next_wake: Instant
    driver: Driver | None
    peers: Peers
    notes: Trace
    actions: Dispatcher
    crossings: Crossings
    services: RobotServices


class HistoryListener:
    """Builds the history of one robot.

    Call `begin` before a node of the robot is made, `born` after its start, `called` after each tick, `touched` after
    any other call, and `died` when its process ends; `ended` at the end of the run.
    """

    def __init__(self, robot: int, program: Program, truth: TruePlaces | None = None) -> None:
        """`truth`: where the robot was, if the recording tells."""
        self._truth = truth
        self.history = RobotHistory(robot)
        self._robot = robot
        self._program = program
        self._order = 0
        self.begin()

    def begin(self) -> None:
        """Begin with a new incarnation: its node writes the `log` that stands here from now on."""
        self.log = ProvenanceLog()
        self._first_firing = len(self.history.firings)
        self._handles = 0
        self._due: Instant = NEVER
        self._called: Instant = 0
        self._sets_out: Instant | None = None
        self._last_entry: dict[str, Any] | None = None
        self._facts: dict[int, int] = {}
        """Serial of an insertion -> its index among the changes."""
        self._actions: dict[int, int] = {}
        """Serial of an action of this robot -> its index."""
        self._sends: dict[int, EventCause] = {}
        """Identity of an event that has to be sent -> its cause."""
        self._sending = _GIVEN
        self._seen: tuple[int, EventCause] = 0, _GIVEN
        """Identity and cause of the newest report that another robot's finish fact has come."""
        self._starts: dict[int, int] = {}
        """Serial of a job -> index of the change that has started it last."""
        self._ended: int | None = None
        self._groups: dict[str, bytes] = {}
        """What the trace calls a resource -> those that contend for it."""
        self._inside: dict[str, tuple[bytes, Instant]] = {}

    # -- the life of a process --------------------------------------------------------------------------------

    def born(self, node: WatchedNode, now: Instant) -> None:
        """Note that a process of the robot has begun, and its node was started."""
        self.history.lives.append((now, NEVER))
        self.called(node, now)

    def died(self, now: Instant, *, stopped: bool = False) -> None:
        """Note that the process has ended, perhaps because it was `stopped` in order."""
        history = self.history
        if stopped:
            history.stops.add(now)
        begin, _ = history.lives[-1]
        history.lives[-1] = (begin, now)
        history.motion.append((now, MotionState(Motion.IDLE)))
        for group in list(self._inside):
            self._leave(group, now)
        for index in self._actions.values():
            span = history.actions[index]
            span.ended = min(span.ended, now)

    def ended(self, now: Instant) -> None:
        """Note that the run is over."""
        self.history.ends = now
        for group in list(self._inside):
            self._leave(group, NEVER)

    # -- after each call --------------------------------------------------------------------------------------

    def touched(self, node: WatchedNode) -> None:
        """Take in a call that was none of the executive: a frame overheard, a fact inserted."""
        self._take_records(node)
        self._due = node.next_wake

    def called(self, node: WatchedNode, now: Instant) -> None:
        """Look at the node after a call at `now`."""
        history = self.history
        history.ends = max(history.ends, now)
        due = max(self._due, self._called)
        if due < NEVER and now - due > LATE:
            history.late.append((due, now))
        self._called = now
        self._due = node.next_wake
        self._take_records(node)
        self._take_notes(node, now)
        self._take_waits(node, now)
        drive = node.actions.driving
        since = None if drive is None else drive.started
        state = motion_state(now, node.driver, node.peers, self._robot, node.config.roster, since)
        self._take_motion(now, self._mistaken(now, node, state))

    def _mistaken(self, now: Instant, node: WatchedNode, state: MotionState | None) -> MotionState | None:
        """Return what the wheels do: of a robot on its way that is mistaken about its position, that it is so."""
        pose = None if node.driver is None else node.driver.localiser.pose
        if self._truth is None or pose is None or state is None or state.motion is Motion.IDLE:
            return state
        off_m = self._truth.off_m(now, pose)
        if off_m <= MISTAKEN_M:
            return state
        return MotionState(Motion.LOCATES, Hindrance("", place=f"its estimate was {off_m:.1f} m off"))

    def _take_motion(self, now: Instant, state: MotionState | None) -> None:
        """Take in what the wheels do. Between a drive's beginning and its first frame they do what that frame finds."""
        states = self.history.motion
        idle = not states or states[-1][1].motion is Motion.IDLE
        if state is None:
            self._sets_out = now if idle and self._sets_out is None else self._sets_out
            return
        if not states or states[-1][1] != state:
            states.append((now if self._sets_out is None else self._sets_out, state))
        self._sets_out = None

    def _take_notes(self, node: WatchedNode, now: Instant) -> None:
        """Take in the new entries of the trace."""
        entries = node.notes.entries
        first = len(entries)
        while first > 0 and entries[first - 1] is not self._last_entry:
            first -= 1
        for entry in entries[first:]:
            if entry["what"] == "entered":
                self._leave(entry["event"], now)
                self._inside[entry["event"]] = self._group(entry["event"], node), now
            elif entry["what"] in ("left", "slot_lost"):
                self._leave(entry["event"], now)
            elif entry["what"] == "asks" and node.crossings.current is not None:
                self._leave(node.crossings.current.told, now)
            elif entry["what"] == "sent":
                self._name_sent(entry)
            elif entry["what"] == "undelivered":
                lost = LostDelivery(now, self._robot, entry["destination"], entry["fact"], entry["why"])
                self.history.undelivered.append(lost)
        if entries:
            self._last_entry = entries[-1]

    def _group(self, told: str, node: WatchedNode) -> bytes:
        """Return the group of a resource of which the trace tells, that of an event, a station or a passage."""
        current = node.crossings.current
        if current is not None and current.told == told:
            return current.group_id
        return self._groups.get(told, told.encode())

    def _leave(self, told: str, now: Instant) -> None:
        if told in self._inside:
            self.history.passages.append(PassageSpan(*self._inside.pop(told), now))

    def _name_sent(self, entry: dict[str, Any]) -> None:
        """Give the oldest delivery to a robot that has no text yet its text."""
        for span in self.history.sent.values():
            if not span.text and span.key[1] == entry["destination"]:
                span.text = entry["fact"]
                return

    def _take_waits(self, node: WatchedNode, now: Instant) -> None:
        """Note which actions wait, and for what."""
        for waiting, what in ((node.actions.held, "held"), (node.actions.queue, "queued"), (node.actions.running, "")):
            for running in waiting:
                index = self._actions.get(running.serial)
                if index is None:
                    continue
                span = self.history.actions[index]
                crossing = node.crossings.crossing(running)
                if crossing is not None:
                    self._take_gate(now, span, crossing)
                if what and (not span.waits or span.waits[-1][1] != what):
                    span.waits.append((now, what))

    def _take_gate(self, now: Instant, span: ActionSpan, crossing: Crossing) -> None:
        """Note by which turn an action goes now, if it is another one than before."""
        self._groups[crossing.told] = crossing.group_id
        gate = TurnGate(now, crossing.group_id, not isinstance(crossing.phase, Preparing))
        if not span.gates or span.gates[-1][1:] != gate[1:]:
            span.gates.append(gate)

    # -- the provenance log -----------------------------------------------------------------------------------

    def _take_records(self, node: WatchedNode) -> None:
        for record in self.log.records:
            self._order += 1
            self._take(record, node)
        self.log.records.clear()

    def _take(self, record: ProvenanceRecord, node: WatchedNode) -> None:
        changes = self.history.changes
        match record:
            case FiringRecord(at=at, rule=rule):
                inner = [serial for chain in record.derived for serial in chain.inner]
                premises = [self._facts[serial] for serial in record.matched or inner if serial in self._facts]
                text = rule_text(self._program, rule)
                self.history.firings.append(TimedFiring(at, self._order, rule, text, tuple(premises)))
            case InsertionRecord(at, serial, predicate, args, cause):
                self._facts[serial] = len(changes)
                text = fact_text(self._program, predicate, self._robot, args)
                changes.append(Change(at, self._order, predicate, args, True, self._cause(cause), text))
            case RemovalRecord(at, serial, cause):
                if serial in self._facts:
                    gone = changes[self._facts[serial]]
                    changes.append(gone._replace(at=at, order=self._order, came=False, cause=self._cause(cause)))
            case ActionRecord() | ActionStage():
                self._take_action(record, node)
            case GoalRecord() | RefusedRecord():
                pass  # a goal that a body reads is a fact as well; what is refused has `self._sending` as its cause
            case JobRecord(_, job, serial):
                self._starts[job] = self._facts[serial]
            case SendRecord(event=event, cause=cause):
                self._sends[event] = self._cause(cause)
            case SendingRecord(event=event):
                self._sending = self._sends.pop(event, self._seen[1] if event == self._seen[0] else self._context())
            case ToldRecord(at, event):
                self._told(at, event, node)

    def _take_action(self, record: ActionRecord | ActionStage, node: WatchedNode) -> None:
        actions = self.history.actions
        if isinstance(record, ActionRecord):
            if record.executor == self._robot:
                name = self._program.predicates[record.predicate].name
                text = fact_text(self._program, record.predicate, self._robot, record.args)
                self._actions[record.serial] = len(actions)
                wheels = node.services.handler(name).wheels
                actions.append(ActionSpan(name, text, record.at, self._order, self._cause(record.cause), wheels))
            return
        index = self._actions.get(record.serial)
        if index is None:
            return
        if record.stage == "begun":
            actions[index].started = record.at
        elif record.stage == "ended":
            actions[index].ended = record.at
            actions[index].failure = record.words
            self._ended = index

    def _cause(self, cause: Cause) -> EventCause:
        """Return a cause of the log as one of the history."""
        match cause:
            case FiringCause(number=number):
                return EventCause(CauseKind.FIRING, self._first_firing + number - 1)
            case DeliveredCause(source, epoch, sequence):
                return EventCause(CauseKind.DELIVERY, key=(source, self._robot, epoch, sequence))
            case EffectCause(action=serial) | StepCause(action=serial) | HandlerCause(action=serial):
                if serial in self._actions:
                    return EventCause(CauseKind.ACTION, self._actions[serial])
                return _GIVEN if isinstance(cause, HandlerCause) else self._cause(cause.news)
            case UndeliveredCause(sent=sent) | StandsCause(sent):
                return self._sending if sent is None else EventCause(CauseKind.SENT, key=(self._robot, *sent))
            case SensedCause():
                return EventCause(CauseKind.SENSED)
            case MissedCause(job):
                return EventCause(CauseKind.MISSED, self._starts.get(job, -1))
            case GivenCause() | OutsideCause():
                return _GIVEN

    def _context(self) -> EventCause:
        """Return what has just happened, of which a message of the host's own is a consequence."""
        return _GIVEN if self._ended is None else EventCause(CauseKind.ACTION, self._ended)

    # -- what the node has told -------------------------------------------------------------------------------

    def _told(self, now: Instant, event: object, node: WatchedNode) -> None:
        match event:
            case JobStarted() | JobFinished() | JobMissed():
                self._job(now, event, node)
            case FinishSeen(assertion=assertion, args=args):
                finish = self._program.assertions[assertion].finish.predicate
                self._seen = id(event), EventCause(CauseKind.GIVEN, self.history.newest_fact(finish, args))
            case DeliveryProgress():
                self._progress(now, event)
            case Spoken():
                self._spoken(now, event)
            case ScheduleChanged(group_id=group_id, leader=leader, order=order):
                self.history.orders.append(KnownOrder(now, group_id, leader, order))
            case _:  # of many others no delay comes
                pass

    def _job(self, now: Instant, event: JobStarted | JobFinished | JobMissed, node: WatchedNode) -> None:
        jobs = self.history.jobs
        if isinstance(event, JobStarted) and event.job.serial in self._starts:
            self.history.starts.append((event.job.name, self._starts[event.job.serial]))
        self._groups[event.job.event] = node.crossings.group_of(event.job)
        known = [index for index, (job, _) in enumerate(jobs) if job is event.job]
        if not known:
            jobs.append((event.job, None))
        if isinstance(event, JobFinished):
            jobs[known[-1] if known else -1] = (event.job, now)

    def _progress(self, now: Instant, event: DeliveryProgress) -> None:
        received, sent = self.history.received, self.history.sent
        arrived = (event.peer, self._robot, event.epoch, event.sequence)
        key = (self._robot, event.peer, event.epoch, event.sequence)
        if event.stage is Stage.ACCEPTED:
            received.setdefault(arrived, (now, self._order))
        elif event.stage is Stage.RELEASED:
            # It takes effect now: until then it waited for the delivery of an earlier one.
            received[arrived] = now, self._order
        elif event.stage is Stage.BEGUN:
            sent[key] = DeliverySpan(key, now, self._order, self._sending)
        elif key in sent and event.stage in WHY_GIVEN_UP:
            sent[key].given_up = now

    def _spoken(self, now: Instant, event: Spoken) -> None:
        self._handles += 1
        payload = event.payload
        if event.destination is None or not payload or payload[0] not in (PayloadKind.FACT, PayloadKind.FRAGMENT):
            return
        try:
            frame = payloads.decode_fact_frame(payload)
        except WireError:
            return
        span = self.history.sent.get((self._robot, event.destination, frame.epoch, frame.sequence))
        if span is not None:
            span.transmissions.append((now, event.handle or self._handles))
