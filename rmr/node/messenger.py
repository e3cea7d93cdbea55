"""What a robot says and hears besides coordination: deliveries, their acknowledgements, hellos, failure broadcasts.

A frame that does not parse, or that no robot of this program could have sent, is the sender's mistake: it is
counted, noted and dropped.
"""

from typing import Final

from rmr.base.time import Instant
from rmr.base.values import Robot, Symbol
from rmr.node import payloads
from rmr.node.logic.deliveries import Deliveries
from rmr.node.logic.exchange import Exchange
from rmr.node.parts import Radio
from rmr.node.payloads import PayloadKind, WireError
from rmr.node.peers.presence import Presence, decode_hello_cached
from rmr.node.ports import Received
from rmr.node.robot_state import RobotState

UNNAMED_FAILURE: Final = "broadcast"
"""Name told to the program of a failure broadcast that no missed deadline derived."""


class Messenger:
    """Everything that one robot and the others say to each other, frame by frame."""

    def __init__(
        self, state: RobotState, radio: Radio, presence: Presence, exchange: Exchange, deliveries: Deliveries
    ) -> None:
        self.exchange = exchange
        self.deliveries = deliveries
        self.malformed = 0
        """Frames dropped because no robot of this program sends such."""
        self._state = state
        self._radio = radio
        self._presence = presence

    @property
    def next_wake(self) -> Instant:
        """When there is something to say or to repeat."""
        return min(self._presence.next_wake, self.exchange.next_wake)

    def wake(self, now: Instant) -> None:
        """Say what is due."""
        self._presence.wake(now)
        if now >= self.exchange.next_wake:
            self.exchange.wake(now)
        self.flush(now)

    def flush(self, now: Instant) -> None:
        """Hand the radio what is to leave at once, and see to what became of what has left."""
        exchange = self.exchange
        if exchange.outbox:
            for payload, destination in exchange.outbox:
                self._radio.transmit(payload, destination)
            exchange.outbox.clear()
        if exchange.news:
            self.deliveries.collect(now)

    def receive(self, now: Instant, frame: Received) -> None:
        """Handle a frame of another robot that does not belong to coordination."""
        try:
            self._dispatch(now, frame)
        except WireError as error:
            self.drop(now, frame.source, str(error))

    def drop(self, now: Instant, source: int, why: str) -> None:
        """Count a frame that no robot of this program sends."""
        self.malformed += 1
        self._state.trace(now, "malformed", source=source, why=why)

    def _dispatch(self, now: Instant, frame: Received) -> None:
        payload = frame.payload
        if not payload:
            raise WireError("a frame without content")
        match payload[0]:
            case PayloadKind.HELLO:
                self._presence.met(now, frame, decode_hello_cached(payload))
            case PayloadKind.FACT | PayloadKind.FRAGMENT:
                # The exchange acknowledges every copy and hands on the body once: with its first complete copy.
                body = self.exchange.received(payload, frame.source)
                if body is not None:
                    self._state.mark_dirty()
                    self.deliveries.arrived(now, body, frame.source)
            case PayloadKind.FACT_ACK:
                self.exchange.acknowledged(now, payload, frame.source)
            case PayloadKind.FAILURE:
                self._failure(now, frame)
            case kind:
                raise WireError(f"a frame of the unknown kind {kind:#04x}")

    def _failure(self, now: Instant, frame: Received) -> None:
        digest, assertion = payloads.decode_failure(frame.payload)
        assertions = self._state.program.assertions
        # Of another program the number means nothing. The program senses the failure, it is no delivery: of the three
        # copies that are sent (`FAILURE_REPEATS`) the second and third find the fact held already.
        if digest != self._state.digest or (assertion is not None and assertion >= len(assertions)):
            return
        self._state.mark_dirty()
        name = UNNAMED_FAILURE if assertion is None else assertions[assertion].name
        self._state.senses.add(now, "failed", (Robot(frame.source), Symbol(name)))
