"""Makes the history of a robot from its mind: events that the node tells its witness, and a look at it after each call.

The mind is a node of a simulated run, or the twin that a replay drives; the listener changes nothing in it. Facts are
told only where they are traced (`TraceLevel.FACTS`).
"""

from typing import Any

from rmr.base.time import NEVER, NS_PER_S, TICK_HZ, Duration, Instant
from rmr.bytecode.heads import items
from rmr.bytecode.program import Kind, Program
from rmr.coord.events import ScheduleChanged
from rmr.node import payloads
from rmr.node.actions.dispatcher import RunningAction
from rmr.node.logic.exchange import DeliveryProgress, Stage
from rmr.node.node import Node
from rmr.node.payloads import PayloadKind, WireError
from rmr.node.ports import Spoken
from rmr.node.services import ActionBegan, ActionOver
from rmr.node.standstill import Motion, MotionState, motion_state
from rmr.node.trace import fact_text, rule_text
from rmr.vm.machine_events import (
    ActionDerived,
    FactInserted,
    FactRemoved,
    JobFinished,
    JobMissed,
    JobStarted,
    RuleFired,
)
from rmr.why.robot_history import (
    ActionSpan,
    Cause,
    CauseKind,
    Change,
    DeliveryKey,
    DeliverySpan,
    Firing,
    Order,
    Passage,
    RobotHistory,
)

LATE: Duration = NS_PER_S // TICK_HZ
"""A call that comes later than it was due by more than a frame is late."""

COMPLETED = " completed"
FAILED = " failed"
"""How the text of a delivery ends that reports the end of an action."""


class HistoryListener:
    """Builds the history of one robot.

    Give `tell` to the robot's configuration as its witness; call `born` after `Node.start`, `called` after each call of
    the node, and `died` when its process ends.
    """

    def __init__(self, robot: int, program: Program) -> None:
        self.history = RobotHistory(robot)
        self._robot = robot
        self._program = program
        self._heads = [frozenset(item.predicate for item in items(rule.head)) for rule in program.rules]
        self._order = 0
        self._handles = 0
        self._forget()

    def _forget(self) -> None:
        """Begin with a new incarnation."""
        self._handles = 0
        self._due: Instant = NEVER
        self._sets_out: Instant | None = None
        self._called: Instant = 0
        self._last: dict[str, Any] | None = None
        """The newest entry of the trace that has been looked at."""
        self._actions: dict[int, int] = {}
        """Serial of an action -> its index in the history."""
        self._groups: dict[bytes, str] = {}
        self._inside: dict[str, Instant] = {}
        self._firing: int | None = None
        self._fact: int | None = None
        self._clear()

    def _clear(self) -> None:
        """Forget what belongs to one call."""
        self._accepted: list[DeliveryKey] = []
        self._ended: list[int] = []
        self._missed = False
        self._unresolved_changes: list[int] = []
        self._unresolved_actions: list[int] = []

    # -- the life of a process ------------------------------------------------------------------------------

    def born(self, node: Node, now: Instant) -> None:
        """Note that a process of the robot has begun, and its node was started."""
        self.history.lives.append((now, NEVER))
        self.called(node, now)

    def died(self, now: Instant) -> None:
        """Note that the process has ended."""
        history = self.history
        begin, _ = history.lives[-1]
        history.lives[-1] = (begin, now)
        for group, entered in self._inside.items():
            history.passages.append(Passage(group, entered, now))
        for index in self._actions.values():
            span = history.actions[index]
            span.ended = min(span.ended, now)
        self._forget()

    def ended(self, now: Instant) -> None:
        """Note that the run is over."""
        self.history.ends = now
        for group, entered in self._inside.items():
            self.history.passages.append(Passage(group, entered, NEVER))
        self._inside = {}

    # -- what the node tells --------------------------------------------------------------------------------

    def tell(self, robot: int, now: Instant, event: object) -> None:
        """Take in an event of the robot's mind; others are ignored."""
        if robot != self._robot:
            return
        self._order += 1
        match event:
            case RuleFired(rule=rule):
                self._firing = len(self.history.firings)
                self._fact = None
                self.history.firings.append(Firing(now, self._order, rule, rule_text(self._program, rule)))
            case FactInserted(predicate=predicate, args=args, at=at):
                self._changed(at, predicate, args, came=True)
            case FactRemoved(predicate=predicate, args=args, at=at):
                self._changed(at, predicate, args, came=False)
            case ActionDerived():
                self._derived(now, event)
            case ActionBegan(running=running):
                self._began(now, running)
            case ActionOver(running=running, failure=failure):
                self._over(now, running, failure)
            case JobStarted() | JobFinished() | JobMissed():
                self._job(now, event)
            case _:
                self._communicated(now, event)

    def _communicated(self, now: Instant, event: object) -> None:
        """Take in what concerns others. What a rule derives for them needs no case: `DeliveryProgress` follows."""
        match event:
            case DeliveryProgress():
                self._progress(now, event)
            case Spoken():
                self._spoken(now, event)
            case ScheduleChanged(group_id=group_id, leader=leader, order=order):
                group = self._groups.get(group_id, group_id.hex())
                self.history.orders.append(Order(now, group, leader, order))

    def _changed(self, at: Instant, predicate: int, args: tuple[Any, ...], *, came: bool) -> None:
        changes = self.history.changes
        text = fact_text(self._program, predicate, self._robot, args)
        cause = Cause(CauseKind.GIVEN)
        firing = self._firing
        if firing is not None and (not came or predicate in self._heads[self.history.firings[firing].rule]):
            cause = Cause(CauseKind.FIRING, firing)
        else:
            self._unresolved_changes.append(len(changes))
        self._fact = len(changes)
        changes.append(Change(at, self._order, predicate, args, came, cause, text))

    def _derived(self, now: Instant, event: ActionDerived) -> None:
        if event.executor != self._robot:
            return  # `DeliveryProgress` follows
        actions = self.history.actions
        name = self._program.predicates[event.predicate].name
        text = fact_text(self._program, event.predicate, self._robot, event.args)
        cause = Cause(CauseKind.GIVEN)
        if self._missed:
            cause = Cause(CauseKind.MISSED)
        elif self._firing is not None and event.origin is None:
            cause = Cause(CauseKind.FIRING, self._firing)
        else:
            self._unresolved_actions.append(len(actions))
        self._actions[event.serial] = len(actions)
        actions.append(ActionSpan(name, text, now, self._order, cause, wheels=False))

    def _span(self, running: RunningAction) -> ActionSpan | None:
        index = self._actions.get(running.serial)
        if index is None:
            return None
        span = self.history.actions[index]
        span.wheels = running.uses_wheels
        return span

    def _began(self, now: Instant, running: RunningAction) -> None:
        span = self._span(running)
        if span is not None:
            span.started = now

    def _over(self, now: Instant, running: RunningAction, failure: str | None) -> None:
        span = self._span(running)
        if span is not None:
            span.ended = now
            span.failure = failure
            self._ended.append(self._actions[running.serial])
        self._firing = None

    def _job(self, now: Instant, event: JobStarted | JobFinished | JobMissed) -> None:
        jobs = self.history.jobs
        self._missed = isinstance(event, JobMissed)
        if self._missed:
            self._firing = None
        known = [index for index, (job, _) in enumerate(jobs) if job is event.job]
        if not known:
            jobs.append((event.job, None))
        if isinstance(event, JobFinished):
            jobs[known[-1] if known else -1] = (event.job, now)

    def _progress(self, now: Instant, event: DeliveryProgress) -> None:
        if event.stage is Stage.ACCEPTED:
            key = (event.peer, self._robot, event.epoch, event.sequence)
            self.history.received.setdefault(key, (now, self._order))
            self._accepted.append(key)
            self._firing = None
            return
        key = (self._robot, event.peer, event.epoch, event.sequence)
        if event.stage is Stage.BEGUN:
            self.history.sent[key] = DeliverySpan(key, now, self._order, self._context())
        elif event.stage is Stage.GIVEN_UP and key in self.history.sent:
            self.history.sent[key].given_up = now

    def _context(self) -> Cause:
        """Return what has just happened, of which a delivery is a consequence."""
        if self._fact is not None and self._firing is None:
            return Cause(CauseKind.GIVEN, self._fact)
        if self._firing is not None:
            return Cause(CauseKind.FIRING, self._firing)
        if self._ended:
            return Cause(CauseKind.ACTION, self._ended[-1])
        return Cause(CauseKind.GIVEN)

    def _spoken(self, now: Instant, event: Spoken) -> None:
        self._handles = event.handle or self._handles + 1
        payload = event.payload
        if event.destination is None or not payload or payload[0] not in (PayloadKind.FACT, PayloadKind.FRAGMENT):
            return
        try:
            frame = payloads.decode_fact_frame(payload)
        except WireError:
            return
        span = self.history.sent.get((self._robot, event.destination, frame.epoch, frame.sequence))
        if span is not None:
            span.transmissions.append((now, self._handles))

    # -- after each call --------------------------------------------------------------------------------------

    def called(self, node: Node, now: Instant) -> None:
        """Look at the node after a call at `now`."""
        history = self.history
        history.ends = max(history.ends, now)
        due = max(self._due, self._called)
        if due < NEVER and now - due > LATE:
            history.late.append((due, now))
        self._called = now
        self._due = node.next_wake
        received = self._notes(node, now)
        self._resolve(received, bodily=node.driver is not None)
        self._waiting(node, now)
        drives = node.actions.driving is not None
        state = motion_state(now, node.driver, node.peers, self._robot, node.config.roster, drives)
        self._moved(now, state)
        self._firing = None
        self._fact = None
        self._clear()

    def _moved(self, now: Instant, state: MotionState | None) -> None:
        """Take in what the wheels do. Between a drive's beginning and its first frame they do what that frame finds."""
        states = self.history.motion
        idle = not states or states[-1][1].motion is Motion.IDLE
        if state is None:
            self._sets_out = now if idle and self._sets_out is None else self._sets_out
        elif not states or states[-1][1] != state:
            states.append((now if self._sets_out is None else self._sets_out, state))
        if state is not None:
            self._sets_out = None

    def _notes(self, node: Node, now: Instant) -> dict[str, DeliveryKey]:
        """Take in the new entries of the trace; return the deliveries that have arrived, by their text."""
        entries = node.notes.entries
        first = len(entries)
        while first > 0 and entries[first - 1] is not self._last:
            first -= 1
        arrived: dict[str, DeliveryKey] = {}
        for entry in entries[first:]:
            self._entry(now, entry, arrived)
        if entries:
            self._last = entries[-1]
        return arrived

    def _entry(self, now: Instant, entry: dict[str, Any], arrived: dict[str, DeliveryKey]) -> None:
        match entry["what"]:
            case "entered":
                self._leave(entry["event"], now)
                self._inside[entry["event"]] = now
            case "left" | "slot_lost":
                self._leave(entry["event"], now)
            case "received":
                key = next((key for key in self._accepted if key[0] == entry["source"]), None)
                if key is not None:
                    self._accepted.remove(key)
                    arrived[entry["fact"]] = key
            case "sent":
                self._named(entry)

    def _named(self, entry: dict[str, Any]) -> None:
        """Give the newest delivery to a robot that has no text yet its text."""
        unnamed = [span for span in self.history.sent.values() if not span.text and span.key[1] == entry["destination"]]
        if unnamed:
            unnamed[0].text = entry["fact"]

    def _leave(self, group: str, now: Instant) -> None:
        entered = self._inside.pop(group, None)
        if entered is not None:
            self.history.passages.append(Passage(group, entered, now))

    def _resolve(self, received: dict[str, DeliveryKey], *, bodily: bool) -> None:
        """Find the causes of what no rule has derived."""
        history = self.history
        for index in self._unresolved_changes:
            change = history.changes[index]
            predicate = self._program.predicates[change.predicate]
            sensed = predicate.kind is Kind.SENSED or (predicate.provided and predicate.kind is not Kind.ACTION)
            cause = self._cause(change.text, received)
            if sensed and (bodily or cause.kind is not CauseKind.ACTION):
                cause = Cause(CauseKind.SENSED)
            history.changes[index] = change._replace(cause=cause)
        for index in self._unresolved_actions:
            span = history.actions[index]
            span.cause = self._cause(span.text, received)

    def _cause(self, text: str, received: dict[str, DeliveryKey]) -> Cause:
        key = received.get(text)
        if key is not None:
            return Cause(CauseKind.DELIVERY, key=key)
        if self._ended:
            return Cause(CauseKind.ACTION, self._ended[-1])
        reports = [key for said, key in received.items() if said.endswith((COMPLETED, FAILED))]
        return Cause(CauseKind.DELIVERY, key=reports[-1]) if reports else Cause(CauseKind.GIVEN)

    def _waiting(self, node: Node, now: Instant) -> None:
        """Note which actions wait, and for what."""
        for job, _ in self.history.jobs[-1:]:
            self._groups.setdefault(node.crossings.group_of(job), job.event)
        for waiting, what in ((node.actions.held, "held"), (node.actions.queue, "queued"), (node.actions.running, "")):
            for running in waiting:
                span = self._span(running)
                if span is None:
                    continue
                crossing = node.crossings.crossing(running)
                span.gated_by = None if crossing is None else crossing.job.event
                if what and (not span.waits or span.waits[-1][1] != what):
                    span.waits.append((now, what))
