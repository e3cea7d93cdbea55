"""Receiving side of the exchange: one life of a sender, its repeats detected, its ordered deliveries put in order.

Sequence numbers have 15 bits and are compared as serial numbers (RFC 1982): of two the newer is less than half the
range ahead. A window of accepted numbers detects repeats, as IPsec does against replay (RFC 4303, section 3.4.3): a
number older than the window is a repeat, for the sender began the newer ones only when it was done with it.

An ordered delivery is acknowledged when it arrives and takes effect when all earlier ones of its sender have. Until
then it is held back. The number that takes effect next is known from the first number of a life, which is 0, or from
the sender's answer to a question (`Exchange`): a receiver that has started anew does not know what its earlier life
got.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Instant
from rmr.node.payloads import ACK_BEFORE_BITS

SEQUENCE_BITS: Final = 15
SEQUENCE_MASK: Final = (1 << SEQUENCE_BITS) - 1
UNORDERED: Final = 1 << SEQUENCE_BITS
"""Bit of a sequence number on the wire: the delivery takes effect at once, whatever is missing before it. Ordered and
unordered deliveries are numbered apart."""
ORDERED_WINDOW: Final = 256
"""Width of the receiver's window of ordered numbers, and the most deliveries of one sender that are held back. A sender
starts no delivery this far ahead of its oldest one in flight."""
UNORDERED_WINDOW: Final = 1 << (SEQUENCE_BITS - 1)
"""Width of the window of unordered numbers: an urgent delivery is sent before thousands that were numbered earlier."""


def ahead(of: int, number: int, bits: int = SEQUENCE_BITS) -> int:
    """Return how far `number` is ahead of `of`, negative if it is behind: serial numbers of so many `bits`."""
    half = 1 << (bits - 1)
    return ((number - of + half) & ((1 << bits) - 1)) - half


class Arrival(NamedTuple):
    """A delivery that nothing of its sender holds back."""

    source: int
    epoch: int
    sequence: int
    """As on the wire, with the bit `UNORDERED`."""
    body: bytes
    held: bool
    """Whether it has been held back since it was accepted."""
    earlier: int | None = None
    """Digest of the earlier program that it belongs to; None: the one that runs."""


@dataclass(slots=True)
class Window:
    """The numbers that have been accepted."""

    width: int
    newest: int = -1
    """The newest number; -1: there is none."""
    accepted: int = 0
    """Bit k: number newest - k was accepted."""

    def holds(self, number: int) -> bool:
        """Return whether `number` was accepted, or is so old that its sender is done with it."""
        if self.newest < 0:
            return False
        behind = ahead(number, self.newest)
        return behind >= self.width or (behind >= 0 and bool(self.accepted >> behind & 1))

    def before(self, number: int) -> int:
        """Return which of the numbers before `number` were accepted: bit k stands for number - 1 - k."""
        return (self.accepted >> (ahead(number, self.newest) + 1)) & ((1 << ACK_BEFORE_BITS) - 1)

    def accept(self, number: int) -> None:
        """Take note of `number`, which it does not hold."""
        behind = 0 if self.newest < 0 else ahead(number, self.newest)
        if self.newest < 0 or behind < 0:
            self.newest = number
            self.accepted = self.accepted << min(-behind, self.width) & ((1 << self.width) - 1)
            behind = 0
        self.accepted |= 1 << behind


@dataclass(slots=True)
class Inbound:
    """What has been accepted of one life of a sender."""

    source: int
    epoch: int
    next: int | None = None
    """The ordered number that takes effect next; None: not known yet."""
    ordered: Window = field(default_factory=lambda: Window(ORDERED_WINDOW))
    unordered: Window = field(default_factory=lambda: Window(UNORDERED_WINDOW))
    held: dict[int, tuple[Instant, bytes]] = field(default_factory=dict)
    """The ordered deliveries that wait for an earlier one, by number: when they came, the first first, and bodies."""
    ask_at: Instant = NEVER
    """When to ask the sender next which number is the first that it is not done with."""

    def has(self, sequence: int) -> bool:
        """Return whether a number, as on the wire, has been accepted."""
        window = self.unordered if sequence & UNORDERED else self.ordered
        return window.holds(sequence & SEQUENCE_MASK)

    def before(self, sequence: int) -> int:
        """Return which numbers before one that has been accepted have been, too (`Window.before`)."""
        window = self.unordered if sequence & UNORDERED else self.ordered
        return window.before(sequence & SEQUENCE_MASK)

    def passed(self, sequence: int) -> bool:
        """Return whether the turn of an ordered number is over: its sender is done with it."""
        return not sequence & UNORDERED and self.next is not None and ahead(self.next, sequence) < 0

    def full(self, sequence: int) -> bool:
        """Return whether the delivery would have to be held back and there is no room."""
        takes_effect = sequence & UNORDERED or sequence == (self.next or 0)
        return not takes_effect and len(self.held) >= ORDERED_WINDOW

    @property
    def held_since(self) -> Instant:
        """When the delivery came that has been held back longest; NEVER: there is none."""
        return next(iter(self.held.values()))[0] if self.held else NEVER

    def accept(self, now: Instant, sequence: int, body: bytes) -> list[Arrival]:
        """Take in a delivery that is new; return what takes effect now, in order."""
        if sequence & UNORDERED:
            self.unordered.accept(sequence & SEQUENCE_MASK)
            return [Arrival(self.source, self.epoch, sequence, body, False)]
        self.ordered.accept(sequence)
        if self.next is None and sequence == 0:
            self.next = 0
        if sequence != self.next:
            self.held[sequence] = now, body
            return []
        self.next = (sequence + 1) & SEQUENCE_MASK
        return [Arrival(self.source, self.epoch, sequence, body, False), *self._following()]

    def begin_at(self, base: int) -> list[Arrival]:
        """Wait for no ordered number before `base`: the sender is done with them. Return what takes effect now."""
        if self.next is not None and ahead(self.next, base) < 0:
            return []
        numbers = [number for number in self.held if ahead(base, number) < 0]
        self.next = base
        return [*self._release(numbers), *self._following()]

    def release_oldest(self) -> list[Arrival]:
        """Return what is held back up to the delivery that came first and what follows it: nothing before it comes."""
        return self.begin_at(next(iter(self.held))) if self.held else []

    def release_all(self) -> list[Arrival]:
        """Return all that is held back, in order: this life of the sender has ended."""
        return self._release(self.held)

    def _following(self) -> list[Arrival]:
        arrivals = []
        while self.next is not None and self.next in self.held:
            arrivals.append(Arrival(self.source, self.epoch, self.next, self.held.pop(self.next)[1], True))
            self.next = (self.next + 1) & SEQUENCE_MASK
        return arrivals

    def _release(self, numbers: Iterable[int]) -> list[Arrival]:
        # Sorted as serial numbers: all that is held back lies within one window.
        ordered = sorted(numbers, key=lambda number: ahead(self.ordered.newest, number))
        return [Arrival(self.source, self.epoch, number, self.held.pop(number)[1], True) for number in ordered]
