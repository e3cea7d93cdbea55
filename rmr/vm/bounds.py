"""What does not fit: all that a robot keeps is bounded by name; what comes beyond is dropped, counted, told once.

A program that makes ever more facts, goals or chains thus costs one robot some of its own program, and never
its memory or its pace. Each bound stands with what it bounds.
"""

from typing import TypeVar

from rmr.base.time import Instant
from rmr.vm.machine_events import BoundReached, VmEvent

T = TypeVar("T")


def remember(items: list[T], item: T, bound: int) -> None:
    """Append `item`; the oldest goes where it would be one more than `bound`."""
    if len(items) >= bound:
        del items[0]
    items.append(item)


NOTHING: dict[str, int] = {}
"""What has been dropped as a rule; nobody writes into it."""


class Dropped:
    """Counts what was dropped, by kind: ``facts``, ``goals``, ``actions``, ``chains``, ..."""

    __slots__ = ("_events", "counts")

    def __init__(self, events: list[VmEvent]) -> None:
        """Report the first drop of each kind to `events`."""
        self.counts = NOTHING
        self._events = events

    def add(self, what: str, bound: int, now: Instant) -> None:
        """Note that one more did not fit."""
        if what not in self.counts:
            self._events.append(BoundReached(what, bound, now))
            self.counts = {**self.counts, what: 0}
        self.counts[what] += 1
