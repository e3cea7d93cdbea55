"""Counters of dropped data: each collection of a robot has a named bound; the excess is dropped and counted.

A program that derives ever more facts, goals or chains therefore degrades its own behaviour, but never exhausts the
robot's memory or time. Each bound is defined beside the collection that it limits.
"""

from typing import TypeVar

from rmr.base.time import Instant
from rmr.vm.machine_events import BoundReached, VmEvent

T = TypeVar("T")


def remember(items: list[T], item: T, bound: int) -> None:
    """Append `item`; drop the oldest item if there would be more than `bound`."""
    if len(items) >= bound:
        del items[0]
    items.append(item)


NOTHING: dict[str, int] = {}
"""Counters of a machine that has dropped nothing: one empty dict for all, never written to."""


class Dropped:
    """Counts what was dropped, by kind: ``facts``, ``goals``, ``actions``, ``chains``, ..."""

    __slots__ = ("_events", "counts")

    def __init__(self, events: list[VmEvent]) -> None:
        """Report the first drop of each kind to `events`."""
        self.counts = NOTHING
        self._events = events

    def add(self, what: str, bound: int, now: Instant) -> None:
        """Count one dropped thing of the kind `what`, and report the first."""
        if what not in self.counts:
            self._events.append(BoundReached(what, bound, now))
            self.counts = {**self.counts, what: 0}  # a copy: `NOTHING` is shared
        self.counts[what] += 1
