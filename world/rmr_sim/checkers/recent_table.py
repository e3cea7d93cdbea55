"""What a checker remembers of events, jobs and terms: the newest alone, so that a lab may run for days."""

from collections import OrderedDict
from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")

KEPT_MAX = 10_000
"""Entries of a table; older ones concern what is settled: no lab has as many events or terms under way at a time."""


class RecentTable(OrderedDict[K, V]):
    """A table of the `KEPT_MAX` entries that were set last."""

    def __setitem__(self, key: K, value: V) -> None:
        """Set an entry, which is the newest then."""
        super().__setitem__(key, value)
        self.move_to_end(key)
        if len(self) > KEPT_MAX:
            self.popitem(last=False)
