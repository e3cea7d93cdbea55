"""What a robot says and hears: coordination, deliveries and their acknowledgements, shared facts, hellos, failures.

The first octet of a payload says whose it is. A frame is handled in a call of the node, the executive's radio task, or
overheard between two calls if it changes nothing but what is known of its sender.

A frame that does not parse, or that no robot of this program could have sent, is the sender's mistake: it is
counted, noted and dropped.
"""

from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot, Symbol
from rmr.node import payloads
from rmr.node.crossing.coordination_link import CoordLink
from rmr.node.logic.deliveries import ABOUT_JOBS, Deliveries
from rmr.node.logic.earlier_program import EarlierProgram
from rmr.node.logic.inbound import Arrival
from rmr.node.logic.shared_facts import SharedFacts
from rmr.node.parts import Radio
from rmr.node.payloads import PayloadKind, WireError
from rmr.node.peers.presence import Presence, decode_hello_cached
from rmr.node.ports import RadioPort, Received, Spoken
from rmr.node.robot_state import RobotState
from rmr.vm.provenance import DeliveredCause
from rmr.vm.shared import shared_of
from rmr.vm.store import Args


class Transmitter:
    """Hands payloads to the radio."""

    def __init__(self, state: RobotState, port: RadioPort) -> None:
        self._state = state
        self._port = port
        self._sent = 0

    def follow(self, other: "Transmitter") -> None:
        """Number payloads from the last one of `other` on: outcomes of its frames may still come."""
        self._sent = other._sent

    def transmit(self, payload: bytes, destination: int | None, due: Instant = NEVER) -> int:
        """Hand a payload to the radio; return the handle by which it will tell the outcome.

        `due` is the deadline of a delivery's frame, by which the radio orders those that wait; NEVER: another frame.
        """
        self._sent += 1
        if self._state.config.witness is not None:
            self._state.tell(Spoken(payload, destination, self._sent))
        self._port.transmit(payload, destination, self._sent, due)
        return self._sent


class Messenger:
    """Everything that one robot and the others say to each other, frame by frame."""

    def __init__(
        self,
        state: RobotState,
        port: RadioPort,
        radio: Radio,
        coordination: CoordLink,
        presence: Presence,
        deliveries: Deliveries,
        shared: SharedFacts,
    ) -> None:
        self.shared = shared
        self.exchange = deliveries.exchange
        self.exchange.loaded = state.changes > 0
        self.deliveries = deliveries
        self.earlier: dict[int, EarlierProgram] = {}
        """By digest of 16 bits, the programs that the robot has run before in this life and that have offered."""
        self.offers_are_held = False
        """Whether no offer is to be made, as a change of programs is ahead."""
        self.offers_held: list[Args] = []
        """What the next offer takes its number from, meanwhile."""
        self.malformed = 0
        """Frames dropped because no robot of this program sends such."""
        self._state = state
        self._port = port
        self._radio = radio
        self._coordination = coordination
        self._presence = presence
        self._profile = state.config.profile
        self._needs_call = state.senses.used("neighbor") or state.senses.used("range")
        """Whether every frame needs a call of the node: it may change the facts about who is near."""

    @property
    def next_wake(self) -> Instant:
        """When there is something to say or to repeat."""
        hello = self._presence.next_wake
        delivery = self.exchange.next_wake
        due = hello if hello < delivery else delivery
        for program in self.earlier.values():
            due = min(due, program.next_wake)
        return min(due, self.shared.next_wake) if self.shared.used else due

    def wake(self, now: Instant) -> None:
        """Say what is due."""
        self._presence.wake(now)
        if now >= self.exchange.next_wake:
            self.exchange.wake(now)
        if self.shared.used:
            self.shared.wake(now)
        for program in self.earlier.values():
            if now >= program.next_wake:
                program.wake(now, self.exchange)
        self.flush(now)

    def flush(self, now: Instant) -> None:
        """Hand the radio what is to leave at once, and see to what became of what has left."""
        exchange = self.exchange
        if self.earlier:
            self._settle(now)
        if exchange.outbox:
            for payload, destination, due in exchange.outbox:
                self._radio.transmit(payload, destination, due)
            exchange.outbox.clear()
        if exchange.news:
            self.deliveries.collect(now)

    def hold_offers(self, now: Instant, held: bool) -> None:
        """Offer nothing more by ensemble rules while `held`."""
        machine = self._state.machine
        count = shared_of(machine.program).count
        if count is None:
            return
        self.offers_are_held = held
        if held:
            self.offers_held += machine.take_out(now, count)
        else:
            for args in self.offers_held:
                machine.insert(now, count, args)
            self.offers_held.clear()
        self._state.mark_dirty()

    def _settle(self, now: Instant) -> None:
        """See to what has become known about offers of earlier programs."""
        exchange = self.exchange
        settled = [each for each in exchange.news if each.earlier in self.earlier]
        if settled or exchange.unknown:
            exchange.news = [each for each in exchange.news if each not in settled]
            unknown, exchange.unknown = exchange.unknown, []
            self._state.mark_dirty()
            for news in settled:
                self.earlier[news.earlier or 0].outcome(now, news, exchange)
            for each in unknown:
                if each.digest in self.earlier:
                    self.earlier[each.digest].not_known(now, each, exchange)

    def run(self, now: Instant) -> None:
        """Handle all that has arrived since the last call, and say what is due: the executive's radio task."""
        for frame in self._port.receive():
            self.receive(now, frame)
        for outcome in self._port.confirmations():
            self._state.reschedule = True
            self._coordination.confirm(now, outcome)
        self.wake(now)

    def receive(self, now: Instant, frame: Received) -> None:
        """Handle a frame of another robot: coordination's are those below `PayloadKind.FACT`."""
        self._state.peers.heard(now, frame.source, frame.rssi_dbm)
        if frame.source in self.exchange.silent:
            self.exchange.heard_again(now, frame.source)
        kind = frame.payload[0] if frame.payload else PayloadKind.HELLO
        if kind != PayloadKind.HELLO:
            self._state.reschedule = True
        if kind < PayloadKind.FACT:
            self._coordination.core.receive(now, frame.payload, frame.source)
            return
        try:
            self._dispatch(now, frame)
        except WireError as error:
            self._malformed(now, frame.source, error)

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` as it arrives, if no task has to look at it; else return False: it is to wait for a call.

        In a crowd nearly all that is heard are hellos that change nothing but where a robot is known to be, and
        frames of the robots in the bottleneck, which concern hardly any.
        """
        # After a suspension of the host the age of `frame` is not known: a call of the node dates it (`heard_at`).
        state = self._state
        if self._needs_call or state.suspended(now) or frame.source in self.exchange.silent:
            return False
        if self._presence.overhear(now, frame):
            return True
        known = self._profile.overhears_passing and frame.source in state.peers.known
        if not known or not self._coordination.core.overhear(now, frame.payload):
            return False
        state.peers.heard(now, frame.source, frame.rssi_dbm)
        return True

    def _dispatch(self, now: Instant, frame: Received) -> None:
        payload = frame.payload
        if not payload:
            raise WireError("a frame without content")
        match payload[0]:
            case PayloadKind.HELLO:
                self._presence.met(now, frame, decode_hello_cached(payload))
            case PayloadKind.FACT | PayloadKind.FRAGMENT:
                # The exchange acknowledges every copy and hands on the body once, after those that were sent before it.
                self.exchange.received(now, payload, frame.source)
                self._take_news(now)
            case PayloadKind.FACT_ACK:
                self.exchange.acknowledged(now, payload, frame.source)
            case PayloadKind.FACT_BASE:
                self.exchange.base_told(now, payload, frame.source)
            case PayloadKind.FACT_BASE_WANTED:
                self.exchange.asked(payload, frame.source)
            case PayloadKind.FACT_LIFE:
                self.exchange.life_told(now, payload, frame.source)
            case PayloadKind.FACT_UNKNOWN:
                self.exchange.unknown_told(now, payload, frame.source)
            case PayloadKind.SHARED:
                if self.shared.used:
                    self.shared.received(now, frame)
            case PayloadKind.FAILURE:
                self._failure(now, frame)
            case kind:
                raise WireError(f"a frame of the unknown kind {kind:#04x}")

    @property
    def waiting(self) -> bool:
        """Whether deliveries have arrived that have not taken effect."""
        return bool(self.exchange.arrivals)

    def take_up(self, now: Instant) -> None:
        """Let the first delivery of those that are `waiting` take effect."""
        self._arrived(now, self.exchange.arrivals.pop(0))

    def _take_news(self, now: Instant) -> None:
        """Let what has just arrived take effect at once if it is news of a job: no rule sees it, and deadlines pass."""
        arrivals = self.exchange.arrivals
        if arrivals and payloads.role_of(arrivals[-1].body) in ABOUT_JOBS:
            self._state.mark_dirty()
            self._arrived(now, arrivals.pop())

    def _arrived(self, now: Instant, arrival: Arrival) -> None:
        if not arrival.body:  # it waited while the program changed, and the new one has no use for it
            return
        try:
            if arrival.earlier is not None:
                if arrival.earlier in self.earlier:
                    self.earlier[arrival.earlier].arrived(now, arrival.body, self.exchange)
                return
            self.deliveries.arrived(now, arrival.body, DeliveredCause(*arrival[:3]))
        except WireError as error:
            self._malformed(now, arrival.source, error)

    def _malformed(self, now: Instant, source: int, error: WireError) -> None:
        self.malformed += 1
        self._state.trace(now, "malformed", source=source, why=str(error))

    def _failure(self, now: Instant, frame: Received) -> None:
        digest, assertion = payloads.decode_failure(frame.payload)
        assertions = self._state.program.assertions
        # Of another program the number means nothing. The program senses the failure, it is no delivery: of the three
        # copies that are sent (`FAILURE_REPEATS`) the second and third find the fact held already.
        if digest != self._state.digest or (assertion is not None and assertion >= len(assertions)):
            return
        self._state.mark_dirty()
        # Name told to the program of a failure broadcast that no missed deadline derived.
        name = "broadcast" if assertion is None else assertions[assertion].name
        self._state.senses.add(now, "failed", (Robot(frame.source), Symbol(name)))
