"""Terms: which leadership a frame belongs to, and which of two is preferred.

Counters are serial numbers in a circle, as in RFC 1982, so no counter is the last one and a forged one ends nothing.
"""

from typing import Final, NamedTuple

NOBODY: Final = 0xFFFF
"""No robot: the broadcast address belongs to none."""

COUNTER_MAX: Final = 0xFFFF
"""Term counters are serial numbers 1..65535 in a circle (as in RFC 1982); 0 stands for "no term".

The length of the circle is odd, so of two different counters exactly one is newer, however far apart they are. Merging
two leaders needs no more than that: one of the two steps down. No counter is the last one.
"""


def newer(counter: int, other: int) -> bool:
    """Return whether `counter` is ahead of `other` by less than half of the circle; each is ahead of 0."""
    if counter == 0 or other == 0:
        return counter > other
    return 0 < (counter - other) % COUNTER_MAX <= COUNTER_MAX // 2


def successor(counter: int) -> int:
    """Return the counter of the next term."""
    return counter % COUNTER_MAX + 1


class Term(NamedTuple):
    """One leadership: a serial number and the leader."""

    counter: int
    leader: int

    def better(self, other: "Term") -> bool:
        """Return whether this term is preferred to `other`: newer counter, then lower leader."""
        if self.counter == other.counter:
            return self.leader < other.leader
        return newer(self.counter, other.counter)


NO_TERM: Final = Term(0, NOBODY)
