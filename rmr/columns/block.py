"""The state of one block of robots in columns, one row for each robot.

- Facts: whether each predicate's fact holds, and its arguments.
- Goals: whether each is open, and when it was achieved.
- Refraction: whether a rule that consumes nothing has fired for its present match.
- Failures: whether an expression has failed for its present facts, so that each failure counts once.
- The state of each robot's random stream.

In columns numbers stand as they are, Booleans in one octet, robots in two, symbols as small codes. No operation makes a
new symbol, so a symbol's code is its index among those in the program and the given facts.
"""

from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from typing import Protocol

import numpy as np

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.heads import codes
from rmr.bytecode.program import Atom, Base, Bind, Code, Constant, Guard, InitialFact, Kind, Program, Slot
from rmr.columns.numbers import Array, write


class ColumnLayout:
    """The numpy types of columns, and the table of symbols."""

    def __init__(self, program: Program, given: Iterable[InitialFact]) -> None:
        symbols = dict.fromkeys(each for each in _values(program, given) if type(each) is Symbol)
        self._symbols = list(symbols)
        self._codes = {symbol: code for code, symbol in enumerate(symbols)}
        self.types: dict[Base, np.dtype[np.generic]] = {
            Base.BOOL: np.dtype(np.bool_),
            Base.INT: np.dtype(np.int64),
            Base.FLOAT: np.dtype(np.float64),
            Base.ROBOT: np.dtype(np.uint16),
            Base.SYMBOL: np.min_scalar_type(max(len(symbols) - 1, 0)),
        }

    def column(self, base: Base, size: int) -> Array:
        """Return a new column."""
        return np.zeros(size, self.types[base])

    def single(self, value: Value, base: Base) -> Array:
        """Return a value as one of a column of `base`."""
        coded = self._codes[value] if isinstance(value, Symbol) else value
        return np.asarray(coded, self.types[base])

    def value(self, column: Array, row: int, base: Base) -> Value:
        """Return the value in a row of a column."""
        item: Value = column[row].item()
        if base is Base.SYMBOL:
            return self._symbols[item]  # type: ignore[index]
        return Robot(item) if base is Base.ROBOT else item  # type: ignore[arg-type]


def _values(program: Program, given: Iterable[InitialFact]) -> Iterator[object]:
    """Yield every value that a program and the given facts name."""
    for fact in (*program.facts, *given):
        yield from (arg for arg in fact.args if not isinstance(arg, Slot))
    for goal in program.goals:
        yield from (arg.value for arg in goal.args if isinstance(arg, Constant))
    for rule in program.rules:
        for conjunct in rule.body:
            if isinstance(conjunct, Atom):
                yield from (arg.value for arg in conjunct.args if isinstance(arg, Constant))
            elif isinstance(conjunct, Guard | Bind):
                yield from _constants(conjunct.code)
        for code in codes(rule.head):
            yield from _constants(code)


def _constants(code: Code) -> Iterator[object]:
    return (each.operand for each in code)


class GoalWatch(Protocol):
    """The receiver of a block's new facts: `rmr.columns.columns`."""

    def inserted(self, block: "Block", predicate: int, rows: Array) -> None:
        """Handle new facts of `predicate` in `rows`."""


class Follows:
    """By predicate, the state that an insertion resets; the same for all blocks."""

    def __init__(self, program: Program, goals: GoalWatch) -> None:
        self.goals = goals
        self.fired: list[list[int]] = [[] for _ in program.predicates]
        """Rules that may fire again after an insertion: their refraction mark is cleared."""
        self.failed: list[list[int]] = [[] for _ in program.predicates]
        """Places whose next failure counts again after an insertion."""
        self.persistent = [each.kind is Kind.PERSISTENT for each in program.predicates]


class Block:
    """The state of some robots, one row each."""

    def __init__(self, program: Program, layout: ColumnLayout, follows: Follows, robots: Array, streams: Array) -> None:
        size = len(robots)
        self.follows = follows
        self.robots = robots
        self.streams = streams
        self.present: list[Array] = [np.zeros(size, np.bool_) for _ in program.predicates]
        self.args = [[layout.column(kind.base, size) for kind in each.types] for each in program.predicates]
        self.firings = np.zeros(size, np.uint32)
        self.fired: dict[int, Array] = {}
        """By rule; missing until it has fired somewhere."""
        self.failed: dict[int, Array] = {}
        """By place; missing until it has failed somewhere."""
        self.failures: Array | None = None
        """Number of failures of expressions (no value); None: 0."""
        self.open = [np.zeros(size, np.bool_) for _ in program.goals]
        self.achieved_at = [np.zeros(size, np.uint32) for _ in program.goals]
        """The tick."""
        self.achieved_as = [np.zeros(size, np.uint16) for _ in program.goals]
        """Ordinal number of the achievement on the robot, from 1; 0: not achieved."""
        self.live: list[int] = []
        """Goals that are open in some row."""
        self.busy = np.ones(size, np.bool_)
        """Robots that may have a satisfied rule."""
        self.last: Array | None = None
        """The rules with which robots used up the budget of their first run, -1 for none; None: no robot has."""
        self.tick = 0

    @property
    def size(self) -> int:
        """Number of robots."""
        return len(self.robots)

    def insert(self, predicate: int, values: Sequence[Array], rows: Array) -> None:
        """Insert a fact in `rows` and apply the consequences; where a set holds the fact already, do nothing."""
        present = self.present[predicate]
        if self.follows.persistent[predicate]:
            rows = rows & ~present
        for column, value in zip(self.args[predicate], values, strict=True):
            if value is not column:
                write(column, value, rows)
        present |= rows
        self._follow(predicate, rows)

    def _follow(self, predicate: int, rows: Array) -> None:
        """Reset the marks of matches with the old fact, and discharge goals."""
        again = [self.fired[each] for each in self.follows.fired[predicate] if each in self.fired]
        again += [self.failed[each] for each in self.follows.failed[predicate] if each in self.failed]
        if again:
            others = ~rows
            for column in again:
                np.logical_and(column, others, out=column)
        if self.live:
            self.follows.goals.inserted(self, predicate, rows)

    def fail(self, place: int, rows: Array) -> None:
        """Record that the expression at `place` has no value in `rows`; count it where it is new."""
        failed = self.failed.get(place)
        if failed is None:
            failed = self.failed[place] = np.zeros(self.size, np.bool_)
        if self.failures is None:
            self.failures = np.zeros(self.size, np.uint32)
        self.failures += rows & ~failed
        failed |= rows

    def part(self, rows: slice) -> "Block":
        """Return some rows as a block of their own; what the two share is changed by both."""
        other = Block.__new__(Block)
        other.follows = self.follows
        other.tick = self.tick
        other.live = list(self.live)
        other.robots = self.robots[rows]
        other.streams = self.streams[rows]
        other.firings = self.firings[rows]
        other.present = [each[rows] for each in self.present]
        other.args = [[each[rows] for each in columns] for columns in self.args]
        other.fired = {key: each[rows] for key, each in self.fired.items()}
        other.failed = {key: each[rows] for key, each in self.failed.items()}
        other.failures = None if self.failures is None else self.failures[rows]
        other.busy = self.busy[rows]
        other.last = None if self.last is None else self.last[rows]
        other.open = [each[rows] for each in self.open]
        other.achieved_at = [each[rows] for each in self.achieved_at]
        other.achieved_as = [each[rows] for each in self.achieved_as]
        return other

    def copy(self) -> "Block":
        """Return a block that shares no column with this one."""
        return deepcopy(self, {id(self.follows): self.follows})

    @property
    def octets(self) -> int:
        """Memory of all columns, in octets, without temporaries."""
        several = [self.present, self.open, self.achieved_at, self.achieved_as, *self.args]
        columns = [each for group in several for each in group]
        columns += [self.robots, self.streams, self.firings, self.busy, *self.fired.values(), *self.failed.values()]
        columns += [each for each in (self.failures, self.last) if each is not None]
        return sum(each.nbytes for each in columns)


def stated_values(fact: InitialFact, block: Block, program: Program, layout: ColumnLayout) -> list[Array]:
    """Return the columns of a stated fact."""
    types = program.predicates[fact.predicate].types
    return [
        block.robots if isinstance(arg, Slot) else layout.single(arg, kind.base)
        for arg, kind in zip(fact.args, types, strict=True)
    ]


def owned(owner: int | None, robots: Array) -> Array:
    """Return the mask of the rows whose robot is `owner`; None: all rows."""
    return np.ones(len(robots), np.bool_) if owner is None else robots == owner
