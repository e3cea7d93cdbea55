"""Matches in generated machines, and the refraction memory of a rule that is rematched.

A match is identified by the serial numbers of its facts: they grow, and a fact that is inserted again has a new one.
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
"""The serials of a match's facts: its identity over the whole run."""

Valued = tuple[list[tuple[int, HeldFact]], list[Chain]]
"""The effect of a match: the consumed facts, each with its predicate, and the derived chains."""


class SeenFact:
    """Adapter of a fact to the interface that `Failures` needs (`serial`, `held`)."""

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
    """The fired and the unfired matches of a rule that consumes nothing and is rematched after each change."""

    __slots__ = ("_complete", "_fired", "_left")

    def __init__(self, fired: set[Key]) -> None:
        """`fired` are the keys of matches, the serials of their facts."""
        self._fired = fired
        self._left: list[Entry] = []
        self._complete = True
        """Whether `_left` holds all matches that have not fired."""

    @property
    def is_used_up(self) -> bool:
        """Whether all kept matches have fired although there are more than were kept."""
        self._forget_gone()
        return not self._left and not self._complete

    def look(self, matches: Iterator[Entry]) -> None:
        """Replace the memory by all `matches` that hold now: forget the fired ones that no longer hold."""
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
        """Record that a match has fired."""
        self._fired.add(key_of(entry))

    def _forget_gone(self) -> None:
        while self._left and not self._stands(self._left[-1]):
            self._left.pop()

    def _stands(self, entry: Entry) -> bool:
        return key_of(entry) not in self._fired and all(fact[HELD] for fact in entry)
