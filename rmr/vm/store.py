"""The fact store of one robot: the paper's tiny database (V.B.3), with insert, delete and query.

Temporary facts are linear resources: a multiset, in which each insertion is a fact of its own. Persistent and sensed
facts are sets. Every fact has a serial number, so "oldest first" is the order of insertion, and the instant of its
insertion. A fact that is withdrawn and inserted again is a new one.

A table of `INDEX_FROM` or more facts builds an index of an argument when it is first probed. Values that are equal in
Python but not in the language (1 and @1) meet only in arguments of open type; the matcher compares those strictly.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

from rmr.base.time import Instant
from rmr.base.values import Value
from rmr.bytecode.conform import length
from rmr.bytecode.octets import identity
from rmr.bytecode.program import Base, Kind, Predicate, Type

HOLES_MAX = 1024
"""Removals after which a table is rebuilt: a Python dict keeps the holes, and iteration from the front skips them."""

LONG = (Base.STRING, Base.LIST, Base.OPEN)
"""Types without a bound on the length of their values."""

INDEX_FROM = 12
"""Facts of a predicate from which on probing an index is cheaper than examining each fact."""

Args = tuple[Value, ...]


class Holdings(Protocol):
    """Read access to a machine's facts, for goals, jobs and watches."""

    def each(self, predicate: int) -> Iterable[Args]:
        """Return the arguments of the facts of `predicate` that hold, oldest first."""

    def dated(self, predicate: int) -> Iterable[tuple[Args, Instant]]:
        """Return the same with the instants of their insertion."""


class Fact:
    """One fact; compared by identity."""

    __slots__ = ("args", "at", "held", "length", "predicate", "serial")

    def __init__(self, predicate: int, args: Args, serial: int, at: Instant, length: int) -> None:
        self.predicate = predicate
        self.args = args
        self.serial = serial
        self.at = at
        self.length = length
        """Of its strings and lists."""
        self.held = True
        """False once it has been consumed or withdrawn."""


class Facts(Protocol):
    """Facts in the order of insertion."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Fact]: ...

    def __reversed__(self) -> Iterator[Fact]: ...


class StoreTable:
    """The facts of one predicate in the order of insertion."""

    __slots__ = ("_holes", "_indices", "_known", "_long", "_open", "facts", "linear", "newest")

    def __init__(self, predicate: Predicate) -> None:
        self.linear = predicate.kind is Kind.TEMPORARY
        self.facts: dict[int, Fact] = {}
        self.newest = 0
        """Serial of the last fact inserted; the fact may have been removed since."""
        self._holes = 0
        self._open = any(is_open(kind) for kind in predicate.types)
        self._long = tuple(place for place, kind in enumerate(predicate.types) if kind.base in LONG)
        self._known: dict[object, Fact] = {}
        self._indices: dict[int, dict[Value, dict[int, Fact]]] = {}

    def length(self, args: Args) -> int:
        """Return the total length, in characters and items, of the arguments of unbounded types (`LONG`)."""
        return sum([length(args[place]) for place in self._long]) if self._long else 0

    def find(self, args: Args) -> Fact | None:
        """Return the fact of a set with these arguments."""
        return self._known.get(identity(args) if self._open else args)

    def add(self, fact: Fact) -> None:
        """Add `fact`; a set must not hold an equal one."""
        self.facts[fact.serial] = fact
        self.newest = fact.serial
        if not self.linear:
            self._known[identity(fact.args) if self._open else fact.args] = fact
        for position, index in self._indices.items():
            index.setdefault(fact.args[position], {})[fact.serial] = fact

    def remove(self, fact: Fact) -> None:
        """Drop `fact`."""
        del self.facts[fact.serial]
        self._holes += 1  # see HOLES_MAX
        if self._holes > HOLES_MAX:
            self._holes = 0
            self.facts = {each.serial: each for each in self.facts.values()}
        if not self.linear:
            del self._known[identity(fact.args) if self._open else fact.args]
        for position, index in self._indices.items():
            bucket = index[fact.args[position]]
            del bucket[fact.serial]
            if not bucket:  # else an index of ever new values would grow without bound
                del index[fact.args[position]]

    def probe(self, position: int, value: Value) -> Facts:
        """Return a superset of the facts whose argument at `position` is `value`, oldest first."""
        if len(self.facts) < INDEX_FROM:
            return self.facts.values()
        index = self._indices.get(position)
        if index is None:
            index = self._indices[position] = {}
            for fact in self.facts.values():
                index.setdefault(fact.args[position], {})[fact.serial] = fact
        # Equal keys in Python (1, 1.0, True) share a bucket; the matcher compares strictly where that matters.
        bucket = index.get(value)
        return bucket.values() if bucket is not None else ()


class Store:
    """All facts of one robot."""

    __slots__ = ("count", "length", "newest", "tables")

    def __init__(self, predicates: Sequence[Predicate]) -> None:
        self.tables = [StoreTable(predicate) for predicate in predicates]
        self.count = 0
        """How many facts there are."""
        self.length = 0
        """How many characters and items their strings and lists hold."""
        self.newest = 0
        """The serial of the fact that was inserted last."""

    def each(self, predicate: int) -> list[Args]:
        """Return the arguments of the facts of `predicate` that hold, oldest first."""
        return [fact.args for fact in self.tables[predicate].facts.values()]

    def dated(self, predicate: int) -> list[tuple[Args, Instant]]:
        """Return the same with the instants of their insertion."""
        return [(fact.args, fact.at) for fact in self.tables[predicate].facts.values()]

    def has(self, predicate: int, args: Args) -> bool:
        """Return whether a set holds the fact already, so that its insertion would change nothing."""
        table = self.tables[predicate]
        return not table.linear and table.find(args) is not None

    def insert(self, predicate: int, args: Args, now: Instant) -> Fact:
        """Insert a fact for which `has` is False."""
        self.newest += 1
        self.count += 1
        table = self.tables[predicate]
        fact = Fact(predicate, args, self.newest, now, table.length(args))
        self.length += fact.length
        table.add(fact)
        return fact

    def remove(self, fact: Fact) -> None:
        """Remove a fact that is there."""
        self.tables[fact.predicate].remove(fact)
        self.count -= 1
        self.length -= fact.length
        fact.held = False


def is_open(kind: Type) -> bool:
    """Return whether the type, or the type of a list's items, is not fixed."""
    if kind.base is Base.LIST:
        return kind.element is None or is_open(kind.element)
    return kind.base is Base.OPEN
