"""Matches as generated machines keep them, and which of a rule's have fired.

A match is named by the serials of its facts: they grow, and a fact that comes back has a new one.
"""

from collections.abc import Iterator
from typing import Any

from rmr.vm import once
from rmr.vm.derive import Chain
from rmr.vm.generate.form import HELD, SERIAL

HeldFact = list[Any]
"""A fact: whether it holds, its serial, its arguments (`rmr.vm.generate.form`)."""

Entry = tuple[HeldFact, ...]
"""The facts of a match."""

Key = tuple[int, ...]
"""Their serials, which name the match for ever."""

Valued = tuple[list[tuple[int, HeldFact]], list[Chain]]
"""What a match consumes, each fact behind its predicate, and derives."""


class SeenFact:
    """A fact as failures remember it."""

    __slots__ = ("_fact", "serial")

    def __init__(self, fact: HeldFact) -> None:
        self._fact = fact
        self.serial: int = fact[SERIAL]

    @property
    def held(self) -> bool:
        """Whether it holds."""
        return bool(self._fact[HELD])


def key_of(entry: Entry) -> Key:
    """Return the key of a match."""
    return tuple([fact[SERIAL] for fact in entry])


class Unfired:
    """Which matches of a rule that consumes nothing, and is matched anew, have fired and which not."""

    __slots__ = ("_complete", "_fired", "_left")

    def __init__(self, fired: set[Key]) -> None:
        """`fired` are the keys of matches, the serials of their facts."""
        self._fired = fired
        self._left: list[Entry] = []
        self._complete = True
        """Of those that have not fired all are in what is left."""

    @property
    def is_used_up(self) -> bool:
        """Whether nothing is left although there was more than is kept."""
        self._forget_gone()
        return not self._left and not self._complete

    def look(self, matches: Iterator[Entry]) -> None:
        """Take all `matches` that there are now: forget the fired ones that are gone."""
        found: set[Key] = set()
        left: list[Entry] = []
        self._complete = True
        for entry in matches:
            if (key := key_of(entry)) in self._fired:
                found.add(key)
            elif len(left) < once.MATCHES_MAX:
                left.append(entry)
            else:
                self._complete = False
        self._fired = found
        self._left = left[::-1]

    def each(self) -> Iterator[Entry]:
        """Yield the matches that have not fired, the oldest first."""
        self._forget_gone()
        return (entry for entry in reversed(self._left) if self._stands(entry))

    def fire(self, entry: Entry) -> None:
        """Note that a match has fired."""
        self._fired.add(key_of(entry))

    def _forget_gone(self) -> None:
        while self._left and not self._stands(self._left[-1]):
            self._left.pop()

    def _stands(self, entry: Entry) -> bool:
        return key_of(entry) not in self._fired and all(fact[HELD] for fact in entry)
