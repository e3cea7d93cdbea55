"""Facts between robots: exactly once while both live (a fact travels until the *node* acknowledges it).

Each delivery has (sender, epoch, sequence). The sender repeats it, with back-off, until the receiving node
acknowledges; the receiver acknowledges every copy and hands on only the first. Fragments are acknowledged as
a whole. A delivery that outlives its time comes back as `Outcome.UNDELIVERED`: nothing vanishes.

Nothing is handed on twice, however late a copy comes. The receiver keeps a window of sequence numbers for the newest
epoch of each sender, as IPsec does against replay (RFC 4303, section 3.4.3): what is older than the window is a repeat,
for the sender began the newer ones only when it was done with it. Frames of an older epoch are late ones of a life that
has ended: nobody waits for their acknowledgement, and they are dropped. Epochs and sequence numbers are compared as
serial numbers (RFC 1982): of two the newer is less than half the range ahead. An epoch has 8 bits, so a receiver that
hears nothing through 128 restarts of a sender takes the next lives for old ones; the sender then reports its deliveries
as undelivered.

It does not know what a fact means and it does not know the radio: frames leave through `outbox`.
"""

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.node import payloads
from rmr.node.payloads import Delivery, WireError

RETRY_FIRST: Final[Duration] = milliseconds(150)
"""Longer than a whole MAC request with three retries, so that a repeat never races the first copy."""
RETRY_MAX: Final[Duration] = seconds(1)
"""Longest time between two repeats: about 25 in `TIME_TO_LIVE`; at 50 % loss both ways 1 delivery in 1000 fails."""
TIME_TO_LIVE: Final[Duration] = seconds(30)
"""Time after its first transmission at which a delivery is given up and reported. One that still waits is given up when
the receiver has acknowledged nothing for that long."""
IN_FLIGHT_MAX: Final = 8
"""Deliveries under way to one robot; more wait in order."""
WAITING_MAX: Final = 10_000
"""Deliveries that may wait for one robot; more are refused, so that a program that talks to a dead robot stays bounded.
They and what is in flight have different sequence numbers."""
REMEMBERED_MAX: Final = 256
"""Width of the receiver's window of sequence numbers. A sender starts no delivery this far ahead of its oldest one in
flight, so all that is in flight lies in the window."""
_WINDOW: Final = (1 << REMEMBERED_MAX) - 1
SENDERS_MAX: Final = 1024
PARTIAL_MAX: Final = 32
"""Deliveries in fragments that may be incomplete at one time."""


class Outcome(Enum):
    """What became of a delivery."""

    DELIVERED = "delivered"
    """The other node has acknowledged it."""
    REPEATED = "repeated"
    """It was sent again."""
    UNDELIVERED = "undelivered"
    """It was given up; the other robot may have got it all the same, if all its acknowledgements were lost."""


class News(NamedTuple):
    """An outcome."""

    outcome: Outcome
    destination: int
    delivery: Delivery


@dataclass(slots=True)
class _Outgoing:
    delivery: Delivery
    destination: int
    sequence: int
    frames: list[bytes]
    expires: Instant
    next_send: Instant = NEVER
    wait: Duration = RETRY_FIRST


@dataclass(slots=True)
class _Peer:
    in_flight: OrderedDict[int, _Outgoing] = field(default_factory=OrderedDict)
    waiting: deque[_Outgoing] = field(default_factory=deque)
    next_sequence: int = 0
    heard: Instant = -TIME_TO_LIVE
    """When it last acknowledged something."""


@dataclass(slots=True)
class _Seen:
    """What has been accepted of one life of a sender."""

    epoch: int
    newest: int
    """The newest sequence number."""
    accepted: int = 0
    """Bit k: number newest - k was accepted."""

    def holds(self, sequence: int) -> bool:
        """Return whether `sequence` was accepted, or is so old that its sender is done with it."""
        behind = _ahead(sequence, self.newest, 16)
        return behind >= REMEMBERED_MAX or (behind >= 0 and bool(self.accepted >> behind & 1))

    def accept(self, sequence: int) -> None:
        """Take note of `sequence`, which it does not hold."""
        behind = _ahead(sequence, self.newest, 16)
        if behind < 0:
            self.newest = sequence
            self.accepted = self.accepted << min(-behind, REMEMBERED_MAX) & _WINDOW
            behind = 0
        self.accepted |= 1 << behind


def _ahead(of: int, number: int, bits: int) -> int:
    """Return how far `number` is ahead of `of`, negative if it is behind: serial numbers of so many `bits`."""
    half = 1 << (bits - 1)
    return ((number - of + half) & ((1 << bits) - 1)) - half


class Stage(Enum):
    """How far a delivery has come."""

    BEGUN = "begun"
    REPEATED = "repeated"
    """Sent again, for want of an acknowledgement."""
    ACCEPTED = "accepted"
    """By the other node, the first copy."""
    ACKNOWLEDGED = "acknowledged"
    GIVEN_UP = "given up"


_STAGES: Final = {
    Outcome.DELIVERED: Stage.ACKNOWLEDGED,
    Outcome.REPEATED: Stage.REPEATED,
    Outcome.UNDELIVERED: Stage.GIVEN_UP,
}


class DeliveryProgress(NamedTuple):
    """A delivery has come further, for whoever checks a run."""

    stage: Stage
    peer: int
    """The other robot: of an accepted delivery its sender, else its destination."""
    epoch: int
    """The sender's."""
    sequence: int


class Exchange:
    """Reliable, unordered delivery of facts to other robots over a lossy link."""

    def __init__(self, digest: int, epoch: int, rng: Random, payload_max: int = payloads.PAYLOAD_OCTETS_MAX) -> None:
        self._payload_max = payload_max
        self._digest = digest & 0xFFFF
        self._epoch = epoch & 0xFF
        self._rng = rng
        self._peers: dict[int, _Peer] = {}
        self._seen: OrderedDict[int, _Seen] = OrderedDict()
        self._partial: OrderedDict[tuple[int, int, int, int], dict[int, bytes]] = OrderedDict()
        self.outbox: list[tuple[bytes, int]] = []
        """(payload, destination), to be handed to the link; the owner clears it."""
        self.news: list[News] = []
        """What became of deliveries since the last look; the owner clears it."""
        self.next_wake: Instant = NEVER
        self.delivered = 0
        """Deliveries of others that have arrived here, repeats not counted."""
        self.repeated = 0
        """Deliveries sent again."""
        self.tell: Callable[[DeliveryProgress], None] = lambda _: None
        self.last_accepted = (0, 0)
        """Epoch and sequence number of the delivery that `received` has returned last."""
        self.duplicates = 0
        self.late = 0
        """Frames of a sender's earlier life, dropped."""
        self.foreign = 0
        """Frames of another program, dropped."""

    @property
    def idle(self) -> bool:
        """Whether nothing is under way."""
        return self.next_wake == NEVER

    def send(self, now: Instant, destination: int, delivery: Delivery, body: bytes) -> None:
        """Begin to deliver. Raises WireError when `body` is too large to travel, or too much waits already."""
        peer = self._peers.setdefault(destination, _Peer())
        if len(peer.waiting) >= WAITING_MAX:
            raise WireError(f"{WAITING_MAX} facts wait for robot {destination} already")
        sequence = peer.next_sequence
        frames = payloads.encode_fact_frames(self._digest, self._epoch, sequence, body, self._payload_max)
        peer.next_sequence = (sequence + 1) & 0xFFFF
        peer.waiting.append(_Outgoing(delivery, destination, sequence, frames, now + TIME_TO_LIVE))
        self.tell(DeliveryProgress(Stage.BEGUN, destination, self._epoch, sequence))
        self._fill(now, peer)

    def _fill(self, now: Instant, peer: _Peer) -> None:
        while peer.waiting and len(peer.in_flight) < IN_FLIGHT_MAX:
            oldest = next(iter(peer.in_flight), peer.waiting[0].sequence)
            # Keep all in flight inside the receiver's window: it takes what is older than the window for a repeat.
            if (peer.waiting[0].sequence - oldest) & 0xFFFF >= REMEMBERED_MAX:
                return
            outgoing = peer.waiting.popleft()
            if max(outgoing.expires, peer.heard + TIME_TO_LIVE) <= now:
                self._tell(Outcome.UNDELIVERED, outgoing)
                continue
            outgoing.expires = now + TIME_TO_LIVE
            peer.in_flight[outgoing.sequence] = outgoing
            self._transmit(now, outgoing)

    def _tell(self, outcome: Outcome, outgoing: _Outgoing) -> None:
        self.news.append(News(outcome, outgoing.destination, outgoing.delivery))
        self.tell(DeliveryProgress(_STAGES[outcome], outgoing.destination, self._epoch, outgoing.sequence))

    def _transmit(self, now: Instant, outgoing: _Outgoing) -> None:
        for frame in outgoing.frames:
            self.outbox.append((frame, outgoing.destination))
        # Random, so that two senders whose frames have collided do not repeat at the same instant.
        outgoing.next_send = now + round(outgoing.wait * self._rng.uniform(1.0, 1.5))
        outgoing.wait = min(outgoing.wait * 2, RETRY_MAX)
        self.next_wake = min(self.next_wake, outgoing.next_send)

    def wake(self, now: Instant) -> None:
        """Repeat what is overdue and give up what has outlived its time."""
        if now < self.next_wake:
            return
        self.next_wake = NEVER
        for peer in self._peers.values():
            for outgoing in list(peer.in_flight.values()):
                if outgoing.expires <= now:
                    del peer.in_flight[outgoing.sequence]
                    self._tell(Outcome.UNDELIVERED, outgoing)
                elif outgoing.next_send <= now:
                    self.repeated += 1
                    self._tell(Outcome.REPEATED, outgoing)
                    self._transmit(now, outgoing)
                else:
                    self.next_wake = min(self.next_wake, outgoing.next_send)
            self._fill(now, peer)

    def acknowledged(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle an acknowledgement from `source`. Raises WireError."""
        epoch, sequence = payloads.decode_ack(payload)
        peer = self._peers.get(source)
        if peer is None or epoch != self._epoch or sequence not in peer.in_flight:
            return
        peer.heard = now
        self._tell(Outcome.DELIVERED, peer.in_flight.pop(sequence))
        self._fill(now, peer)
        if not any(other.in_flight for other in self._peers.values()):
            self.next_wake = NEVER

    def received(self, payload: bytes, source: int) -> bytes | None:
        """Handle a fact frame; return the body when a delivery is complete and new. Raises WireError."""
        frame = payloads.decode_fact_frame(payload)
        if frame.digest != self._digest:
            self.foreign += 1
            return None
        seen = self._seen.get(source)
        if seen is not None and _ahead(seen.epoch, frame.epoch, 8) < 0:
            self.late += 1
            return None
        if self._is_repeat(source, frame):
            # The first acknowledgement was lost, or crossed the repeat: say it again, or the sender never stops.
            self.duplicates += 1
            self.outbox.append((payloads.encode_ack(frame.epoch, frame.sequence), source))
            return None
        body = frame.piece if frame.parts == 1 else self._join(source, frame)
        if body is None:
            return None
        self._remember(source, frame)
        self.delivered += 1
        self.last_accepted = frame.epoch, frame.sequence
        self.tell(DeliveryProgress(Stage.ACCEPTED, source, frame.epoch, frame.sequence))
        self.outbox.append((payloads.encode_ack(frame.epoch, frame.sequence), source))
        return body

    def _is_repeat(self, source: int, frame: payloads.FactFrame) -> bool:
        seen = self._seen.get(source)
        return seen is not None and seen.epoch == frame.epoch and seen.holds(frame.sequence)

    def _remember(self, source: int, frame: payloads.FactFrame) -> None:
        seen = self._seen.get(source)
        if seen is None or seen.epoch != frame.epoch:
            seen = self._seen[source] = _Seen(frame.epoch, frame.sequence)
        seen.accept(frame.sequence)
        if len(self._seen) > SENDERS_MAX:
            self._seen.popitem(last=False)

    def _join(self, source: int, frame: payloads.FactFrame) -> bytes | None:
        key = (source, frame.epoch, frame.sequence, frame.parts)
        parts = self._partial.setdefault(key, {})
        parts[frame.part] = frame.piece
        if len(parts) == frame.parts:
            del self._partial[key]
            return b"".join(parts[i] for i in range(frame.parts))
        if len(self._partial) > PARTIAL_MAX:
            self._partial.popitem(last=False)
        return None
