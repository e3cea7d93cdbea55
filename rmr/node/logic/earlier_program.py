"""An earlier program of a robot, whose offers are settled beside the program that runs (`EarlierMachine`).

After a switch each robot answers messages about offers of the program before by the rules of that program, under its
digest. So what was in doubt at the instant of the switch is decided as if no switch had been, and a robot that did not
switch finds its partners as they were, but for their facts: what it offers them is refused.

A robot that dies and begins its next life with the new program knows nothing of the one before. It says so
(`FACT_UNKNOWN`), and the others take for its answer what a robot of the earlier program without any fact, in its next
life, would answer: that is what a next life answers where no program was switched. It cannot tell by itself that it has
begun another life, so a robot with something in doubt asks.
"""

from typing import Final

from rmr.base.streams import Choices
from rmr.base.time import NEVER, Instant, seconds
from rmr.base.values import Robot
from rmr.bytecode.program import Duty, Program
from rmr.node import payloads
from rmr.node.logic.exchange import Exchange, News, Outcome, ProgramUnknown
from rmr.node.logic.symbol_numbers import symbols_of
from rmr.node.payloads import Delivery, DeliveryRole, WireError
from rmr.vm.carrying import EarlierMachine, settling
from rmr.vm.interpreted import Interpreted
from rmr.vm.machine import Machine
from rmr.vm.machine_events import FactSent
from rmr.vm.provenance import OUTSIDE
from rmr.vm.shared import shared_of

ASK_LIFE: Final = seconds(5)
"""Period in which a robot with an offer in doubt asks those that it noted whether they still are in the same life."""


def settled_predicates(program: Program) -> frozenset[int]:
    """Return the predicates of the messages by which a program's offers are settled; none if it offers nothing."""
    if shared_of(program).count is None:
        return frozenset()
    sent = (Duty.MESSAGE, Duty.DECISION)
    return frozenset([each.predicate for each in program.ensemble if each.duty in sent])


class EarlierProgram:
    """The offers of one earlier program of a robot."""

    def __init__(self, now: Instant, old: Machine, digest: int, choices: Choices) -> None:
        """`digest` has 16 bits."""
        self.program = old.program
        self._choices = choices
        self.digest: Final = digest
        self.machine = EarlierMachine(now, old, choices)
        self.next_wake: Instant = NEVER
        """When others are asked for their lives next."""
        self._symbols = symbols_of(old.program)
        self._decisions = {each.predicate: each.other for each in old.program.ensemble if each.duty is Duty.DECISION}
        self._hello = self._named("hello__")
        self._knows = self._named("knows__")

    def _named(self, base: str) -> int:
        program = self.program
        return next(i.predicate for i in program.ensemble if program.predicates[i.predicate].name.startswith(base))

    @property
    def open(self) -> bool:
        """Whether an offer is in doubt."""
        return self.machine.open

    def run(self, now: Instant, exchange: Exchange) -> None:
        """Settle what can be settled, and send what that takes."""
        machine = self.machine
        while machine.busy:
            machine.run(now)
        for event in machine.drain():
            if isinstance(event, FactSent):
                self._send(now, exchange, int(event.destination), event.predicate, event.args)
        if not self.machine.open:
            self.next_wake = NEVER
        elif self.next_wake == NEVER:
            self.next_wake = now + ASK_LIFE

    def _send(
        self, now: Instant, exchange: Exchange, destination: int, predicate: int, args: tuple[object, ...]
    ) -> None:
        delivery = Delivery(DeliveryRole.FACT, predicate, args)  # type: ignore[arg-type]
        body = payloads.encode_delivery(delivery, self._symbols.numbers)
        exchange.send(now, destination, delivery, body, ordered=False, lasting=True, earlier=self.digest)

    def arrived(self, now: Instant, body: bytes, exchange: Exchange) -> None:
        """Take up a message about an offer. Raises WireError for one that no robot of that program sends."""
        delivery = payloads.decode_delivery(body, self._symbols.names)
        try:
            self.machine.insert(now, delivery.index, delivery.args, OUTSIDE)
        except ValueError as error:
            raise WireError(str(error)) from error
        self.run(now, exchange)
        if self.program.predicates[delivery.index].name.startswith(("ask__", "query__")):
            # Whoever asks whether a rule has fired knows that its home has died. This robot may not, and then waits.
            self.next_wake = min(self.next_wake, now + ASK_LIFE // 5)

    def wake(self, now: Instant, exchange: Exchange) -> None:
        """Ask those whom the robot has noted whether they still are in the same life."""
        self.next_wake = NEVER
        for robot in self.machine.concerned:
            if not exchange.tells(int(robot), self.digest):
                self._send(now, exchange, int(robot), self._hello, (self.machine.robot,))
        self.run(now, exchange)

    def outcome(self, now: Instant, news: News, exchange: Exchange) -> None:
        """Take note of what became of a message."""
        other = self._decisions.get(news.delivery.index)
        if other is not None and news.outcome is Outcome.DELIVERED:
            self.machine.insert(now, other, (Robot(news.destination), *news.delivery.args), OUTSIDE)
            self.run(now, exchange)

    def not_known(self, now: Instant, unknown: ProgramUnknown, exchange: Exchange) -> None:
        """Answer for a robot that has not run this program in its life: as its next life would."""
        program = settling(self.program)
        life = shared_of(program).life
        assert life is not None
        me = self.machine.robot
        blank = Interpreted(program, unknown.robot, self._choices)
        blank.insert(now, life, (unknown.life,), OUTSIDE)
        for known in self.machine.each(self._knows):
            blank.insert(now, self._knows, known, OUTSIDE)
        messages = [Delivery(DeliveryRole.FACT, self._hello, (me,)), *unknown.deliveries]
        for message in messages:
            blank.insert(now, message.index, message.args, OUTSIDE)
            blank.run(now)
        for event in blank.drain():
            if isinstance(event, FactSent) and event.destination == me:
                self.machine.insert(now, event.predicate, event.args, OUTSIDE)
        self.run(now, exchange)
