"""What a robot says and hears besides coordination: hellos, facts for others, failure broadcasts.

Every robot says where it stands: every 0.4 s while it moves, once a second while it is parked, and at once when
that changes. Others plan around parked robots and keep off places that are taken.
"""

from typing import TYPE_CHECKING

from rmr.base.streams import stream
from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Program
from rmr.node import wire
from rmr.node.exchange import Exchange
from rmr.node.ports import Received
from rmr.node.wire import Delivery, Hello, Kind, Role, WireError
from rmr.radio.phy import LOSS_AT_1_M_DB
from rmr.vm.events import ActionDerived, FactSent, GoalSent

if TYPE_CHECKING:
    from rmr.node.node import Node

HELLO_MOVING: Duration = milliseconds(400)
HELLO_PARKED: Duration = seconds(1)
HELLO_FIRST: Duration = milliseconds(100)
"""The first hellos are spread over this much per robot of the roster, at most one second."""


UNNAMED_FAILURE = "broadcast"
"""The event of a failure broadcast that no missed deadline derived."""


class Talk:
    """One robot's conversation."""

    def __init__(self, node: "Node", exchange: Exchange, digest: int) -> None:
        self._node = node
        self.exchange = exchange
        self.digest = digest & 0xFFFF
        self._rng = stream(f"{node.config.seed}/robot{node.robot}/hello")
        self._hello_at: Instant = NEVER
        self._parked = True
        self._symbols = symbols_of(node.program)
        self._symbol_index = {symbol: i for i, symbol in enumerate(self._symbols)}
        self.malformed = 0
        self.undelivered = 0

    @property
    def next_wake(self) -> Instant:
        """When there is something to say or to repeat."""
        return min(self._hello_at, self.exchange.next_wake)

    def start(self, now: Instant) -> None:
        """Plan the first hello."""
        spread = min(HELLO_FIRST * len(self._node.config.roster), seconds(1))
        self._hello_at = now + milliseconds(200) + round(self._rng.random() * spread)

    def hello_soon(self, now: Instant) -> None:
        """Say hello within 20 ms: something that matters to the others has changed."""
        self._hello_at = min(self._hello_at, now + round(self._rng.random() * milliseconds(20)))

    def telemetry(self, now: Instant) -> None:
        """Notice a change between parked and moving."""
        parked = self._node.actions.driving is None
        if parked != self._parked:
            self._parked = parked
            self.hello_soon(now)

    def wake(self, now: Instant) -> None:
        """Say what is due."""
        if now >= self._hello_at:
            self._hello(now)
        self.exchange.wake(now)
        self.flush()
        if self.exchange.undelivered:
            self._give_up(now)

    def flush(self) -> None:
        """Hand the radio what is to leave at once."""
        for payload, destination in self.exchange.outbox:
            self._node.transmit(payload, destination)
        self.exchange.outbox.clear()

    def _hello(self, now: Instant) -> None:
        period = HELLO_PARKED if self._parked else HELLO_MOVING
        self._hello_at = now + round(period * self._rng.uniform(0.9, 1.1))
        pose = self._node.percept().pose
        if pose is None:
            return
        hello = Hello(
            pose.x, pose.y, pose.theta, self._parked, self._node.turns.rank, self._node.bound_for, self.digest
        )
        self._node.transmit(wire.encode_hello(hello), None)

    def receive(self, now: Instant, frame: Received) -> None:
        """Handle a frame of another robot; what does not parse is counted."""
        try:
            self._dispatch(now, frame)
        except WireError:
            self.malformed += 1

    def _dispatch(self, now: Instant, frame: Received) -> None:
        match frame.payload[0]:
            case Kind.HELLO:
                self._met(now, frame.source, wire.decode_hello(frame.payload))
                if self._node.driver is not None:
                    self._node.driver.navigator.update_parked(self._node.peers.parked(now))
            case Kind.FACT | Kind.FRAGMENT:
                body = self.exchange.received(frame.payload, frame.source)
                if body is not None:
                    self._deliver(now, wire.decode_delivery(body, self._symbols), frame.source)
            case Kind.FACT_ACK:
                self.exchange.acknowledged(now, frame.payload, frame.source)
            case Kind.FAILURE:
                self._failure(now, frame)
            case _:
                self.malformed += 1

    def _met(self, now: Instant, source: int, hello: Hello) -> None:
        known = self._node.peers.known[source].hello
        if hello.digest != self.digest and (known is None or known.digest != hello.digest):
            self._node.trace(now, "other_program", source=source)
        self._node.peers.hello(now, source, hello)
        self._node.heed_claim(source, hello)

    def _failure(self, now: Instant, frame: Received) -> None:
        digest, assertion = wire.decode_failure(frame.payload)
        assertions = self._node.program.assertions
        if digest != self.digest or (assertion is not None and assertion >= len(assertions)):
            return
        name = UNNAMED_FAILURE if assertion is None else assertions[assertion].name
        self._node.senses.add(now, "failed", (Robot(frame.source), Symbol(name)))

    def _deliver(self, now: Instant, delivery: Delivery, source: int) -> None:
        node = self._node
        try:
            match delivery.role:
                case Role.FACT:
                    node.machine.insert(now, delivery.predicate, delivery.args)
                case Role.GOAL:
                    node.machine.want(now, delivery.predicate, delivery.args)
                case Role.ACTION:
                    node.machine.derive_action(now, delivery.predicate, delivery.args)
        except (ValueError, IndexError) as error:
            raise WireError(str(error)) from error
        node.trace(now, "received", source=source, predicate=node.program.predicates[delivery.predicate].name)

    def send(self, now: Instant, event: FactSent | GoalSent) -> None:
        """Send a derived fact or goal to its owner."""
        role = Role.FACT if isinstance(event, FactSent) else Role.GOAL
        self._send(now, event.destination, Delivery(role, event.predicate, event.args))

    def send_action(self, now: Instant, event: ActionDerived) -> None:
        """Send a derived action to its executor."""
        self._send(now, event.executor, Delivery(Role.ACTION, event.predicate, event.args))

    def _send(self, now: Instant, destination: int, delivery: Delivery) -> None:
        name = self._node.program.predicates[delivery.predicate].name
        if destination not in self._node.config.roster:
            self.undelivered += 1
            self._node.trace(now, "undelivered", destination=destination, predicate=name, why="no such robot")
            return
        try:
            self.exchange.send(now, destination, delivery, wire.encode_delivery(delivery, self._symbol_index))
        except WireError as error:
            self.undelivered += 1
            self._node.trace(now, "undelivered", destination=destination, predicate=name, why=str(error))

    def _give_up(self, now: Instant) -> None:
        for destination, delivery in self.exchange.undelivered:
            self.undelivered += 1
            name = self._node.program.predicates[delivery.predicate].name
            self._node.trace(now, "undelivered", destination=destination, predicate=name, why="no acknowledgement")
        self.exchange.undelivered.clear()

    def ranges(self, now: Instant) -> list[tuple[Value, ...]]:
        """Return (robot, metres) for each neighbor, from signal strength by the log-distance law, to 10 cm."""
        radio, known = self._node.config.radio, self._node.peers.known
        at_1_m = radio.tx_power_dbm - LOSS_AT_1_M_DB
        return [
            (Robot(robot), round(10 ** ((at_1_m - known[robot].rssi_dbm) / (10 * radio.exponent)), 1))
            for robot in self._node.peers.neighbors(now)
        ]


def symbols_of(program: Program) -> tuple[str, ...]:
    """Return the symbols of `program` in the order in which every robot finds them."""
    values: list[Value] = []
    for fact in program.facts:
        values += fact.args
    for rule in program.rules:
        for head in rule.head:
            for code in getattr(head, "args", ()):
                values += [i.operand for i in code if i.op is Op.CONST and i.operand is not None]
    return wire.program_symbols(values)
