"""The bounded memory of a checker for events, jobs and terms, so that a lab may run for days."""

from collections import OrderedDict
from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")

KEPT_MAX = 10_000
"""Bound of the entries of a table, more than any lab has events or terms at a time: older ones are settled."""


class RecentTable(OrderedDict[K, V]):
    """A table of the `KEPT_MAX` entries that were set last."""

    def __setitem__(self, key: K, value: V) -> None:
        """Set an entry and make it the newest."""
        super().__setitem__(key, value)
        self.move_to_end(key)
        if len(self) > KEPT_MAX:
            self.popitem(last=False)
