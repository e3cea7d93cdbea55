"""Deliveries: what the robots' machines say to each other reliably, and what comes of it on arrival.

A fact or goal is taken up. An action is carried out, and its end reported to the robot that derived it if a chain
of steps waits there. A job that waits for another robot's fact asks that robot, which tells it when the fact comes.
What cannot be delivered is noted, comes back as the fact `undelivered(A, B, what)` where the program declares it,
and fails the step that waits for it: nothing vanishes, and no chain waits for what never left.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.base.values import Robot, Symbol, Value, format_fact
from rmr.bytecode.hidden_words import hidden_label
from rmr.bytecode.program import SENT_DUTIES, Duty, Kind, Program
from rmr.node import payloads
from rmr.node.actions.action_log import ActionEnded
from rmr.node.logic.exchange import STAGES, WHY_GIVEN_UP, Exchange, News, Outcome, Sent
from rmr.node.logic.outbound import Outgoing
from rmr.node.logic.symbol_numbers import symbols_of
from rmr.node.payloads import Delivery, DeliveryRole, UnsendableError, WireError
from rmr.node.robot_state import RobotState
from rmr.node.trace import TraceLevel, fact_text
from rmr.vm.job import TimedJob
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionDerived, FactSent, FinishAwaited, FinishSeen, GoalSent
from rmr.vm.predicate_reach import reach_of
from rmr.vm.provenance import DeliveredCause, SentKey, StandsCause, UndeliveredCause
from rmr.vm.store import Args

UNDELIVERED: Final = "undelivered"
"""The predicate that a program declares to learn what could not be delivered, ``undelivered(A, B, what)``: A sent it, B
did not get it, `what` is the predicate's name; the last argument may be left out."""
ABOUT_JOBS: Final = frozenset({DeliveryRole.FINISH_AWAITED, DeliveryRole.FINISH_SEEN})
"""Roles whose index is an assertion's."""
ITEMS: Final = frozenset({DeliveryRole.FACT, DeliveryRole.GOAL, DeliveryRole.ACTION})
"""Roles of what a program derives; the others are news of it."""

SERVING_MAX: Final = 64
"""Deliveries of one job whose waiting is remembered, the newest."""

Origin = tuple[int, int]
"""The robot that waits for an action's end, and the number by which it knows the action."""


class DeliveryRefused(NamedTuple):
    """What the host was to send cannot be sent; an event of the robot."""

    of: Sent | None
    why: str


class Deliveries:
    """The deliveries of one robot, in both directions."""

    def __init__(self, state: RobotState, exchange: Exchange) -> None:
        self._state = state
        self._robot = state.robot
        self._program = state.program
        self._machine = state.machine
        self.exchange = exchange
        self._symbols = symbols_of(state.program)
        # An action's number on the wire is its serial with the sender's epoch in the upper 8 of 64 bits, so that a
        # report meant for an earlier incarnation of the robot ends no action of this one.
        self._incarnation = (state.config.epoch & 0xFF) << 56
        self._deadlines = Deadlines(state.program, state.machine)
        sent = [each for each in state.program.ensemble if each.duty in SENT_DUTIES]
        self._lasting = frozenset([each.predicate for each in sent])
        """Predicates of ensemble rules, whose facts are repeated until they are acknowledged."""
        self._decisions = {each.predicate: each.other for each in sent if each.duty is Duty.DECISION}
        """By predicate of a decision: that of the fact which its sender gets when it has been acknowledged."""
        self._serving: dict[int, deque[Outgoing]] = {}
        """Deliveries that serve a job of this robot, by the job's serial."""
        self.undelivered = 0
        self.unsendable = 0
        """How many of them no frames can carry."""
        self.first_undelivered: tuple[float, str, str] | None = None
        """When the first one was given up, seconds of lab time, what it was, and why."""

    def take_over(self, old: "Deliveries") -> None:
        """Go on with the exchange and the counters of another program's deliveries, but not with their deadlines."""
        self.exchange = old.exchange
        self._serving = old._serving
        self.undelivered = old.undelivered
        self.unsendable = old.unsendable
        self.first_undelivered = old.first_undelivered

    def text(self, delivery: Delivery) -> str:
        """Return a delivery under way, in program syntax where its index means something."""
        try:
            return delivery_text(self._program, delivery, self._robot, self._robot)
        except IndexError:
            return f"{delivery.role.name.lower()} {delivery.index}"

    # -- what leaves ------------------------------------------------------------------------------------------

    def send(self, now: Instant, event: FactSent | GoalSent | FinishAwaited | FinishSeen) -> None:
        """Send what the machine has for another robot."""
        match event:
            case FactSent():
                delivery = Delivery(DeliveryRole.FACT, event.predicate, event.args)
            case GoalSent():
                delivery = Delivery(DeliveryRole.GOAL, event.predicate, event.args)
            case FinishAwaited():
                delivery = Delivery(DeliveryRole.FINISH_AWAITED, event.assertion, event.start_args, event.since)
            case FinishSeen():
                delivery = Delivery(DeliveryRole.FINISH_SEEN, event.assertion, event.args, event.at)
        self._send(now, int(event.destination), delivery, event)

    def send_action(self, now: Instant, event: ActionDerived) -> None:
        """Send an action to its executor, with its number if a chain waits for its end."""
        number = self._incarnation | event.serial if event.serial else 0
        self._send(now, int(event.executor), Delivery(DeliveryRole.ACTION, event.predicate, event.args, number), event)

    def report_end(self, now: Instant, origin: Origin, predicate: int, ended: ActionEnded | None) -> None:
        """Tell the robot that derived an action how it ended; None: the action was refused."""
        robot, number = origin
        ok = ended is not None and ended.failure is None
        role = DeliveryRole.COMPLETED if ok else DeliveryRole.FAILED
        self._send(now, robot, Delivery(role, predicate, (), number), ended)

    def _send(self, now: Instant, destination: int, delivery: Delivery, of: Sent | None) -> None:
        if destination not in self._state.config.roster:
            self._refuse(now, destination, delivery, of, "no such robot")
            return
        try:
            due, jobs = self._deadlines.of(now, destination, delivery)
            if due != NEVER:
                delivery = replace(delivery, due=due)
            body = payloads.encode_delivery(delivery, self._symbols.numbers)
            lasting = delivery.role is DeliveryRole.FACT and delivery.index in self._lasting
            ordered = not lasting and self._ordered(delivery)
            outgoing = self.exchange.send(
                now, destination, delivery, body, due=due, ordered=ordered, lasting=lasting, of=of
            )
        except WireError as error:
            self.unsendable += isinstance(error, UnsendableError)
            self._refuse(now, destination, delivery, of, str(error))
            return
        for job in jobs:
            self._serving.setdefault(job.serial, deque(maxlen=SERVING_MAX)).append(outgoing)
        self._note(now, "sent", destination, delivery)

    def missed(self, now: Instant, job: TimedJob) -> None:
        """Tell a job that has missed its deadline for how long its deliveries have waited for others to leave."""
        serving = self._serving.pop(job.serial, ())
        job.queued = sum(outgoing.waited(now) for outgoing in serving)
        job.stuck = any(outgoing.sent == NEVER for outgoing in serving)

    def finished(self, job: TimedJob) -> None:
        """Forget the deliveries of a job that has ended."""
        self._serving.pop(job.serial, None)

    def _ordered(self, delivery: Delivery) -> bool:
        """Return whether a delivery takes effect after all ordered ones before it.

        What is said of jobs bears the instant that it is about, so its order means nothing.
        """
        return delivery.role not in ABOUT_JOBS and not self._program.predicates[delivery.index].unordered

    # -- what became of it ------------------------------------------------------------------------------------

    def collect(self, now: Instant) -> None:
        """Take in what became of deliveries."""
        news = self.exchange.news
        if news:
            self.exchange.news = []
            self._state.mark_dirty()
            for each in news:
                self._outcome(now, each)

    def _outcome(self, now: Instant, news: News) -> None:
        why = WHY_GIVEN_UP.get(STAGES[news.outcome])
        sent = SentKey(news.destination, news.epoch, news.sequence)
        if why is not None:
            self._give_up(now, news.destination, news.delivery, why, sent)
        else:
            self._note(now, news.outcome.value, news.destination, news.delivery)
            other = self._decisions.get(news.delivery.index) if self._decisions else None
            if other is not None and news.outcome is Outcome.DELIVERED and news.delivery.role is DeliveryRole.FACT:
                self._stands(now, sent, other, news.delivery.args)

    def _stands(self, now: Instant, sent: SentKey, predicate: int, args: Args) -> None:
        """Tell the program that the decision which it has sent is known to the receiver."""
        self._machine.insert(now, predicate, (Robot(sent.destination), *args), StandsCause(sent))

    def _refuse(self, now: Instant, destination: int, delivery: Delivery, of: Sent | None, why: str) -> None:
        """Give up what cannot be sent."""
        self._state.tell(DeliveryRefused(of, why))
        self._give_up(now, destination, delivery, why)

    def _give_up(
        self, now: Instant, destination: int, delivery: Delivery, why: str, sent: SentKey | None = None
    ) -> None:
        """Record an undeliverable item, and end the wait for it; without `sent` it was refused."""
        self.undelivered += 1
        name = self._name(delivery)
        text = delivery_text(self._program, delivery, self._robot, destination)
        if self.first_undelivered is None:
            self.first_undelivered = round(in_seconds(now), 3), text, why
        self._state.trace(now, "undelivered", destination=destination, predicate=name, fact=text, why=why)
        if delivery.role in ITEMS:
            self._tell_program(now, UndeliveredCause(destination, name, sent))
        if delivery.role is DeliveryRole.ACTION and delivery.number:
            self._machine.complete(now, delivery.number ^ self._incarnation, ok=False)

    def _tell_program(self, now: Instant, cause: UndeliveredCause) -> None:
        """Insert the fact that something was not delivered, unless the program does not know it."""
        program = self._program
        index = program.index(UNDELIVERED)
        if index is None or program.predicates[index].kind is Kind.ACTION:
            return
        args: tuple[Value, ...] = Robot(cause.destination), Symbol(cause.name)
        args = args[: len(program.predicates[index].types)]
        with suppress(ValueError):  # the program means something else by the name
            self._machine.insert(now, index, args, cause)

    # -- what arrives -----------------------------------------------------------------------------------------

    def arrived(self, now: Instant, body: bytes, cause: DeliveredCause) -> None:
        """Take up a delivery, which is the `cause` of what comes of it.

        Raises WireError for one that no robot of this program sends.
        """
        source = cause.source
        delivery = payloads.decode_delivery(body, self._symbols.names)
        try:
            name = self._name(delivery)
        except IndexError:
            raise WireError(f"the program has no number {delivery.index} of that kind") from None
        self._deadlines.arrived(now, source, delivery)
        try:
            self._take(now, delivery, cause)
        except ValueError as error:
            if delivery.role is DeliveryRole.ACTION and delivery.number:
                self.report_end(now, (source, delivery.number), delivery.index, None)
            raise WireError(str(error)) from error
        if self._state.notes.level is not TraceLevel.NOTHING:
            fact = delivery_text(self._program, delivery, source, self._robot)
            label = name if delivery.role in ABOUT_JOBS else hidden_label(self._program, delivery.index)
            self._state.trace(now, "received", source=source, predicate=label, fact=fact)

    def _take(self, now: Instant, delivery: Delivery, cause: DeliveredCause) -> None:
        machine = self._machine
        source = cause.source
        index = delivery.index
        args = delivery.args
        match delivery.role:
            case DeliveryRole.FACT:
                machine.insert(now, index, args, cause)
            case DeliveryRole.GOAL:
                machine.want(now, index, args, cause)
            case DeliveryRole.ACTION:
                origin = (source, delivery.number) if delivery.number else None
                machine.derive_action(now, index, args, origin, cause)
            case DeliveryRole.COMPLETED | DeliveryRole.FAILED:
                completed = delivery.role is DeliveryRole.COMPLETED
                machine.complete(now, delivery.number ^ self._incarnation, completed, source, cause)
            case DeliveryRole.FINISH_AWAITED:
                machine.await_finish(now, source, index, args, delivery.number)
            case DeliveryRole.FINISH_SEEN:
                machine.finish_seen(now, source, index, args, delivery.number)

    # -- words ------------------------------------------------------------------------------------------------

    def _name(self, delivery: Delivery) -> str:
        """Return the name of a delivery's predicate or assertion. Raises IndexError."""
        program = self._program
        named = program.assertions if delivery.role in ABOUT_JOBS else program.predicates
        return named[delivery.index].name

    def _note(self, now: Instant, what: str, destination: int, delivery: Delivery) -> None:
        if self._state.notes.level is not TraceLevel.NOTHING:
            self._state.trace(
                now,
                what,
                destination=destination,
                fact=delivery_text(self._program, delivery, self._robot, destination),
            )


def delivery_text(program: Program, delivery: Delivery, source: int, destination: int) -> str:
    """Return a delivery in program syntax; of news the subject with it."""
    index = delivery.index
    args = delivery.args
    match delivery.role:
        case DeliveryRole.FACT | DeliveryRole.ACTION:
            return fact_text(program, index, destination, args)
        case DeliveryRole.GOAL:
            return format_fact(program.predicates[index].name, (Robot(destination), *args), "?")
        case DeliveryRole.COMPLETED | DeliveryRole.FAILED:
            return f"{program.predicates[index].name} {delivery.role.name.lower()}"
        case DeliveryRole.FINISH_AWAITED:
            assertion = program.assertions[index]
            return f"{assertion.name} since {fact_text(program, assertion.start.predicate, source, args)}"
        case DeliveryRole.FINISH_SEEN:
            assertion = program.assertions[index]
            return f"{assertion.name} by {fact_text(program, assertion.finish.predicate, source, args)}"


# ---- deadlines of deliveries: what serves a time-bounded job inherits its deadline, on every robot that it passes
#
# A job is at its robot the reason for what can follow from its start fact, or from what is derived with that, and lead
# to its finish fact (`Reach`).
# What leaves the robot for that reason bears the job's deadline on the air. At the receiver whatever can follow
# from it bears it again. A robot asked to report a finish fact gives the deadline to what can lead to that fact.
#
# `can follow` is read off the rules by predicates alone, without values: facts of one predicate that serve several
# jobs all inherit the earliest deadline among them. Too early a deadline costs order, never correctness.

INHERITED_MAX: Final = 256
"""Deadlines that have arrived and are remembered; beyond that the latest one is forgotten."""


class Deadlines:
    """The deadlines that one robot's deliveries inherit."""

    def __init__(self, program: Program, machine: Machine) -> None:
        self._program = program
        self._machine = machine
        self._timed = bool(program.assertions)
        self._inherited: dict[tuple[int, Instant], None] = {}
        """(predicate, deadline) of what has arrived."""
        self._awaited: dict[tuple[int, int], Instant] = {}
        """Deadlines of other robots' jobs that wait for a fact of this one, by robot and assertion."""

    def of(self, now: Instant, destination: int, delivery: Delivery) -> tuple[Instant, list[TimedJob]]:
        """Return the deadline of what leaves the robot (NEVER: none) and the jobs of this robot that it serves."""
        if not self._timed:
            return NEVER, []
        jobs = [job for job in self._machine.undecided_jobs() if self._serves(job, delivery)]
        due = min((job.deadline for job in jobs), default=NEVER)
        if delivery.role is DeliveryRole.FINISH_SEEN:
            due = min(due, self._awaited.get((destination, delivery.index), NEVER))
        elif delivery.role is not DeliveryRole.FINISH_AWAITED:
            due = min(due, min(self._handed_down(now, delivery.index), default=NEVER))
        return (due, jobs) if due >= now else (NEVER, jobs)

    def arrived(self, now: Instant, source: int, delivery: Delivery) -> None:
        """Remember the deadline of what has arrived."""
        if delivery.role is DeliveryRole.FINISH_AWAITED:
            self._awaited.pop((source, delivery.index), None)
        if delivery.due < now or delivery.due == NEVER or delivery.role is DeliveryRole.FINISH_SEEN:
            return
        if delivery.role is DeliveryRole.FINISH_AWAITED:
            self._awaited[source, delivery.index] = delivery.due
            known: dict[tuple[int, Instant], None] | dict[tuple[int, int], Instant] = self._awaited
        else:
            self._inherited[delivery.index, delivery.due] = None
            known = self._inherited
        if len(known) > INHERITED_MAX:
            self._forget(now)

    def _forget(self, now: Instant) -> None:
        """Forget what has passed and, if that is not enough, what is due last."""
        kept = sorted((due, index) for index, due in self._inherited if due >= now)[:INHERITED_MAX]
        self._inherited = {(index, due): None for due, index in kept}
        waits = sorted((due, key) for key, due in self._awaited.items() if due >= now)[:INHERITED_MAX]
        self._awaited = {key: due for due, key in waits}

    def _serves(self, job: TimedJob, delivery: Delivery) -> bool:
        if delivery.role is DeliveryRole.FINISH_AWAITED:
            return job.assertion == delivery.index
        if delivery.role is DeliveryRole.FINISH_SEEN:
            return False
        assertion = self._program.assertions[job.assertion]
        reach = reach_of(self._program)
        follows = reach.begun(assertion.start.predicate, delivery.index)
        return follows and reach.leads(delivery.index, assertion.finish.predicate)

    def _handed_down(self, now: Instant, predicate: int) -> Iterator[Instant]:
        """Yield the deadlines that have come from other robots and concern what is sent of a predicate."""
        reach = reach_of(self._program)
        for cause, due in self._inherited:
            if due >= now and reach.leads(cause, predicate):
                yield due
        for (_, index), due in self._awaited.items():
            if due >= now and reach.leads(predicate, self._program.assertions[index].finish.predicate):
                yield due
