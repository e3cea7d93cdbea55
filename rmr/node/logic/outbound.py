"""Sending side of the exchange: the deliveries to one robot, under way and waiting.

Ordered deliveries leave in the order of their numbers: each inherits the earliest deadline of those behind it, so that
an urgent one lifts those that must take effect first. Unordered ones leave earliest deadline first. What has no
deadline counts as due `ROUTINE_WITHIN` after it began to wait: a stream of urgent deliveries does not starve it.
"""

from collections import OrderedDict, deque
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Final

from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.node import payloads
from rmr.node.logic.inbound import ORDERED_WINDOW, SEQUENCE_MASK, UNORDERED, UNORDERED_WINDOW
from rmr.node.payloads import ACK_BEFORE_BITS, Delivery

RETRY_FIRST: Final[Duration] = milliseconds(150)
"""Longer than a whole MAC request with three retries, so that a repeat never races the first copy."""
ROUTINE_WITHIN: Final[Duration] = seconds(5)
"""Deadline of a delivery without one, after it began to wait, or after it was handed to the radio."""
IN_FLIGHT_MAX: Final = 8
"""Deliveries of each kind, ordered and unordered, under way to one robot; more wait."""
URGENT_MAX: Final = 4
"""Deliveries with a deadline that may be under way beyond `IN_FLIGHT_MAX`."""


@dataclass(slots=True, eq=False)
class Outgoing:
    """A delivery to another robot."""

    delivery: Delivery
    destination: int
    sequence: int
    """As on the wire, with the bit `UNORDERED`."""
    frames: list[bytes]
    expires: Instant
    due: Instant
    """The deadline; NEVER: it has none."""
    begun: Instant
    sent: Instant = NEVER
    """When it was first handed to the radio."""
    first_copy: int = 0
    """Place of its first copy among all copies that the robot has handed to the radio; 0: none yet."""
    last_copy: int = 0
    """The same of its last copy."""
    next_send: Instant = NEVER
    wait: Duration = RETRY_FIRST
    lasting: bool = False
    """It is never given up: it is repeated until it is acknowledged."""
    digest: int = 0
    """Of the program that it belongs to, 16 bits."""

    def meant_for(self, life: int) -> None:
        """Address all its frames to another life of its receiver."""
        to = payloads.address(self.digest, life)
        self.frames = [payloads.addressed(frame, to) for frame in self.frames]

    def overtaken_by(self, other: "Outgoing") -> bool:
        """Return whether all its copies left before the first one of `other`, which the radio cannot have preferred.

        If `other` has arrived, the copies of this one are lost, or their acknowledgements. Those of `other` that were
        acknowledged may be later ones, so its first one is compared (Karn's ambiguity; RACK-TLP, RFC 8985, 6.2).
        """
        return self.last_copy < other.first_copy and self.due <= other.due

    def waited(self, now: Instant) -> Duration:
        """Return for how long it has waited for others to leave."""
        return min(self.sent, now) - self.begun

    @property
    def rank(self) -> tuple[Instant, int]:
        """Place in the order of deadlines, oldest first among equals."""
        return min(self.due, self.begun + ROUTINE_WITHIN), self.begun


class OrderedQueue:
    """The ordered deliveries to one robot, first in, first out."""

    __slots__ = ("_urgent", "in_flight", "next_number", "waiting")

    def __init__(self) -> None:
        self.in_flight: OrderedDict[int, Outgoing] = OrderedDict()
        self.waiting: deque[Outgoing] = deque()
        self.next_number = 0
        self._urgent: deque[Outgoing] = deque()
        """Those waiting that are due before all behind them: the front one is due first of all."""

    def push(self, outgoing: Outgoing) -> None:
        """Let a delivery wait; its number is `next_number`."""
        self.next_number = (self.next_number + 1) & SEQUENCE_MASK
        self.waiting.append(outgoing)
        if outgoing.due != NEVER:
            while self._urgent and self._urgent[-1].due >= outgoing.due:
                self._urgent.pop()
            self._urgent.append(outgoing)

    def ready(self) -> Outgoing | None:
        """Return the delivery that may leave next."""
        if not self.waiting:
            return None
        first = self.waiting[0]
        # Number 0 leaves alone: a receiver that has started anew takes it for the first one of a life.
        alone = first.sequence == 0 and self.in_flight
        oldest = next(iter(self.in_flight), first.sequence)
        outside = (first.sequence - oldest) & SEQUENCE_MASK >= ORDERED_WINDOW
        room = IN_FLIGHT_MAX + (URGENT_MAX if self._urgent else 0)
        return None if alone or outside or len(self.in_flight) >= room else first

    def pop(self, outgoing: Outgoing) -> None:
        """Take the delivery that `ready` has returned out of the waiting ones."""
        self.waiting.popleft()
        if self._urgent and self._urgent[0] is outgoing:
            self._urgent.popleft()

    def remove(self, outgoing: Outgoing) -> None:
        """Remove a delivery that waits."""
        self.waiting.remove(outgoing)
        if outgoing in self._urgent:
            self._urgent.remove(outgoing)

    def due(self, outgoing: Outgoing) -> Instant:
        """Return the deadline that a delivery under way has or inherits from those behind it; NEVER: none."""
        due = self._urgent[0].due if self._urgent else NEVER
        for other in reversed(self.in_flight.values()):
            due = min(due, other.due)
            if other is outgoing:
                break
        return min(due, outgoing.due)

    @property
    def oldest(self) -> Outgoing | None:
        """The delivery under way that was sent first."""
        return next(iter(self.in_flight.values()), None)

    @property
    def base(self) -> int:
        """The first number that is neither acknowledged nor given up."""
        waiting = self.waiting[0].sequence if self.waiting else self.next_number
        return next(iter(self.in_flight), waiting)


class UnorderedQueue:
    """The unordered deliveries to one robot, earliest deadline first."""

    __slots__ = ("_oldest", "_waiting", "in_flight", "next_number", "parked")

    def __init__(self) -> None:
        self.in_flight: OrderedDict[int, Outgoing] = OrderedDict()
        self.next_number = 0
        self._waiting: list[tuple[Instant, Instant, int, Outgoing]] = []
        """A heap by rank."""
        self.parked: dict[int, Outgoing] = {}
        """Lasting deliveries that have been in flight for long: they are repeated and take no other one's place."""
        self._oldest: OrderedDict[int, Outgoing] = OrderedDict()
        """The same by number."""

    def __len__(self) -> int:
        return len(self._oldest)

    def push(self, outgoing: Outgoing) -> None:
        """Let a delivery wait; its number is `next_number`."""
        self.next_number = (self.next_number + 1) & SEQUENCE_MASK
        self._oldest[outgoing.sequence] = outgoing
        heappush(self._waiting, (*outgoing.rank, outgoing.sequence, outgoing))

    def ready(self) -> Outgoing | None:
        """Return the delivery that may leave next."""
        while self._waiting and self._oldest.get(self._waiting[0][2]) is not self._waiting[0][3]:
            heappop(self._waiting)
        if not self._waiting:
            return None
        first = self._waiting[0][3]
        if len(self.in_flight) >= IN_FLIGHT_MAX + (URGENT_MAX if first.due != NEVER else 0):
            return None
        lowest = next(iter(self._oldest))
        under_way = min((*self.in_flight, *self.parked), key=self._age, default=lowest)
        oldest = min(lowest, under_way, key=self._age)
        # Keep all in flight inside the receiver's window: it takes what is older than the window for a repeat.
        if (first.sequence - oldest) & SEQUENCE_MASK >= UNORDERED_WINDOW - ORDERED_WINDOW:
            return self._oldest[lowest] if lowest == oldest else None
        return first

    def _age(self, sequence: int) -> int:
        """Sorts numbers by age, the oldest first."""
        return -((self.next_number - sequence) & SEQUENCE_MASK)

    def pop(self, outgoing: Outgoing) -> None:
        """Take the delivery that `ready` has returned out of the waiting ones."""
        del self._oldest[outgoing.sequence]

    def waiting(self) -> list[Outgoing]:
        """Return the deliveries that wait, in the order of their numbers."""
        return list(self._oldest.values())

    def remove(self, outgoing: Outgoing) -> None:
        """Remove a delivery that waits."""
        del self._oldest[outgoing.sequence]

    @staticmethod
    def due(outgoing: Outgoing) -> Instant:
        """Return the deadline of a delivery under way; NEVER: none."""
        return outgoing.due


@dataclass(slots=True)
class Recipient:
    """What one robot is sent."""

    ordered: OrderedQueue = field(default_factory=OrderedQueue)
    unordered: UnorderedQueue = field(default_factory=UnorderedQueue)
    heard: Instant = -seconds(3600)
    """When it last acknowledged something."""
    retried: Instant = -seconds(3600)
    """When all that is under way to it was repeated last, as it was heard again."""
    life: int = 0
    """The life of it that deliveries are meant for, 8 bits; of one that has not told its life, the first."""

    @property
    def waiting(self) -> int:
        """Number of deliveries that wait."""
        return len(self.ordered.waiting) + len(self.unordered)

    @property
    def idle(self) -> bool:
        """Whether nothing is in flight."""
        return not self.ordered.in_flight and not self.unordered.in_flight and not self.unordered.parked

    def under_way(self) -> list[Outgoing]:
        """Return all deliveries in flight and waiting, in the order of their numbers."""
        ordered, unordered = self.ordered, self.unordered
        waiting = [*ordered.waiting, *unordered.waiting()]
        return [*ordered.in_flight.values(), *unordered.in_flight.values(), *waiting]

    def of_program(self, digest: int) -> list[Outgoing]:
        """Return all that is not acknowledged of a program."""
        return [each for each in (*self.under_way(), *self.unordered.parked.values()) if each.digest == digest]

    def repeated(self) -> list[Outgoing]:
        """Return all that is repeated until it is acknowledged."""
        ordered, unordered = self.ordered, self.unordered
        return [*ordered.in_flight.values(), *unordered.in_flight.values(), *unordered.parked.values()]

    def settle(self, sequence: int, before: int) -> list[Outgoing]:
        """Remove and return what an acknowledgement says has arrived, in the order of its numbers."""
        queue = self.queue(sequence)
        numbers = [sequence - 1 - k for k in reversed(range(ACK_BEFORE_BITS)) if before >> k & 1]
        arrived = []
        for number in (*numbers, sequence):
            known = number & SEQUENCE_MASK | sequence & UNORDERED
            outgoing = queue.in_flight.pop(known, None) or self.unordered.parked.pop(known, None)
            if outgoing is not None:
                arrived.append(outgoing)
        return arrived

    def begin_life(self, life: int, ended: Instant) -> list[Outgoing]:
        """Mean another life of the robot; remove and return what an earlier one may have got.

        That is what was first sent before the instant `ended`, when the earlier life had ended. The rest is sent to the
        new one.
        Lasting deliveries stay: their programs tell lives apart themselves.
        """
        self.life = life
        lost = [each for each in self.under_way() if each.sent < ended and not each.lasting]
        for outgoing in lost:
            self.remove(outgoing)
        for outgoing in (*self.under_way(), *self.unordered.parked.values()):
            outgoing.meant_for(life)
        return lost

    def remove(self, outgoing: Outgoing) -> None:
        """Give up a delivery that is in flight or waits."""
        queue = self.queue(outgoing.sequence)
        known = queue.in_flight.pop(outgoing.sequence, None) or self.unordered.parked.pop(outgoing.sequence, None)
        if known is None:
            queue.remove(outgoing)

    def queue(self, sequence: int) -> OrderedQueue | UnorderedQueue:
        """Return the queue of a number as on the wire."""
        return self.unordered if sequence & UNORDERED else self.ordered
