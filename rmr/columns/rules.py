"""Vectorised rules: the rows (robots) in which a rule is satisfied, and its effect where it fires.

Each step of a body restricts a Boolean column of rows, in the order in which `rmr.vm.match` tries the conjuncts for one
robot. A predicate has at most one fact in a row, so a row has at most one match. A rule that consumes nothing fires
once for that match (refraction): again after one of its facts has been replaced, or, with ``not`` in the body, after
the match has ceased to hold.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np

from rmr.analysis.column_obstacles import Slots, fallible
from rmr.analysis.straight_line import AND, BASES, CONST, IF, LOAD, NOTHING, OR, Operation, straight
from rmr.base.values import Value
from rmr.bytecode.program import SELF_SLOT, Atom, Base, Bind, DeriveFact, Guard, Mode, Program, Rule, Steps
from rmr.columns.block import Block, ColumnLayout, Follows
from rmr.columns.numbers import WORK, Array, MaskedColumn, also, same
from rmr.vm.match import plan_atom

# ---- vectorised expressions: their operations one after another, each on whole columns of a block


class _Instruction(NamedTuple):
    """An operation, bound to its function and its operands."""

    name: str
    args: tuple[int, ...]
    bases: list[Base]
    """Of the operands."""
    slot: int
    """Of ``load``."""
    constant: MaskedColumn | None


class ColumnExpression:
    """An expression over the columns of a rule's variables."""

    def __init__(self, operations: Sequence[Operation], layout: ColumnLayout) -> None:
        self._steps = [_ready(each, operations, layout) for each in operations]
        self.base = operations[-1].base
        last = operations[-1]
        self.slot = last.operand if last.name == LOAD and isinstance(last.operand, int) else None
        """The variable, if that is all of it."""

    def __call__(self, slots: Sequence[Array | None]) -> MaskedColumn:
        """Return the expression's column, given those of the variables."""
        known: list[MaskedColumn] = []
        for step in self._steps:
            known.append(_held(step, [known[each] for each in step.args], slots))
        return known[-1]


def _ready(operation: Operation, operations: Sequence[Operation], layout: ColumnLayout) -> _Instruction:
    constant = None
    slot = 0
    if operation.name == CONST:
        assert operation.operand is not None
        constant = MaskedColumn(layout.single(operation.operand, operation.base))
    elif operation.name == NOTHING:
        constant = MaskedColumn(np.zeros((), layout.types[operation.base]), np.zeros((), np.bool_))
    elif operation.name == LOAD:
        assert isinstance(operation.operand, int)
        slot = operation.operand
    return _Instruction(
        operation.name, operation.args, [operations[each].base for each in operation.args], slot, constant
    )


def _held(step: _Instruction, operands: list[MaskedColumn], slots: Sequence[Array | None]) -> MaskedColumn:
    """Return the column of one operation."""
    if step.constant is not None:
        return step.constant
    if step.name == LOAD:
        column = slots[step.slot]
        assert column is not None
        return MaskedColumn(column)
    if step.name in _CHOICES:
        return _CHOICES[step.name](*operands)
    found = WORK[step.name]([each.value for each in operands], step.bases)
    valid = found.valid
    for each in operands:
        valid = also(valid, each.valid)
    return MaskedColumn(found.value, valid)


# ---- operations that look at some operands only


def _and(one: MaskedColumn, other: MaskedColumn) -> MaskedColumn:
    valid = one.valid if other.valid is None else also(one.valid, ~one.value | other.valid)
    return MaskedColumn(one.value & other.value, valid)


def _or(one: MaskedColumn, other: MaskedColumn) -> MaskedColumn:
    valid = one.valid if other.valid is None else also(one.valid, one.value | other.valid)
    return MaskedColumn(one.value | other.value, valid)


def _if(condition: MaskedColumn, one: MaskedColumn, other: MaskedColumn) -> MaskedColumn:
    valid = condition.valid
    if one.valid is not None or other.valid is not None:
        branches = [np.True_ if each.valid is None else each.valid for each in (one, other)]
        valid = also(valid, np.where(condition.value, *branches))
    return MaskedColumn(np.where(condition.value, one.value, other.value), valid)


_CHOICES: dict[str, Callable[..., MaskedColumn]] = {AND: _and, OR: _or, IF: _if}


Columns = list[Array | None]
"""By slot, the column of a rule's variable; None: unbound."""


class _Step(ABC):
    """A conjunct."""

    @abstractmethod
    def narrow(self, block: Block, slots: Columns, rows: Array) -> Array:
        """Return a new column: those of `rows` in which the conjunct holds. Bind its variables."""


class _Term(NamedTuple):
    """A comparison of an argument with a value, a variable, or an earlier argument."""

    place: int
    base: Base
    other_base: Base
    value: Array | None = None
    slot: int | None = None
    twin: int = 0


class _Fact(_Step):
    """An atom: a fact that holds, or (``not``) the absence of one."""

    def __init__(self, atom: Atom, program: Program, slots: Slots, layout: ColumnLayout, *, again: bool) -> None:
        """`again`: another conjunct has taken the one temporary fact of the predicate that there can be."""
        step = plan_atom(atom, program.predicates, slots.bases)
        types = [kind.base for kind in program.predicates[atom.predicate].types]
        self._predicate = atom.predicate
        self._absent = atom.mode is Mode.ABSENT
        self._again = again
        self._binds = step.binds
        self._terms = [self._constant(place, types[place], value, layout) for place, value in step.tests]
        self._terms += [_Term(place, types[place], slots.bases[slot], slot=slot) for place, slot in step.joins]
        self._terms += [_Term(place, types[place], types[other], twin=other) for place, other in step.twins]
        slots.match(atom)

    @staticmethod
    def _constant(place: int, base: Base, value: Value, layout: ColumnLayout) -> _Term:
        return _Term(place, base, BASES[type(value)], layout.single(value, BASES[type(value)]))

    def narrow(self, block: Block, slots: Columns, rows: Array) -> Array:
        args = block.args[self._predicate]
        holds = block.present[self._predicate]
        for term in self._terms:
            other = slots[term.slot] if term.slot is not None else term.value
            if other is None:
                other = args[term.twin]
            # Rows without the fact are compared too, on stale arguments: `present` masks the result.
            holds = holds & same(args[term.place], term.base, other, term.other_base)
        if self._absent:
            return rows & ~holds
        for place, slot in self._binds:
            slots[slot] = args[place]
        return rows & holds & (not self._again)


class _Condition(_Step):
    """A condition, or an equation that binds a variable."""

    def __init__(self, line: ColumnExpression, place: int | None, slot: int | None = None) -> None:
        self._line = line
        self._place = place
        self._slot = slot

    def narrow(self, block: Block, slots: Columns, rows: Array) -> Array:
        found = self._line(slots)
        rows = _valid(block, found.valid, self._place, rows)
        if self._slot is None:
            return rows & found.value
        slots[self._slot] = found.value
        return rows


def _valid(block: Block, valid: Array | None, place: int | None, rows: Array) -> Array:
    """Return those of `rows` in which the expression has a value; record a failure in the others."""
    if valid is None:
        return rows
    assert place is not None
    failed = rows & ~valid
    if failed.any():
        block.fail(place, failed)
    return rows & valid


class _Insertion(NamedTuple):
    """A fact of the head."""

    predicate: int
    lines: list[ColumnExpression]


class _Part(NamedTuple):
    """A part of the head: a fact, or a chain of facts (``then``)."""

    insertions: list[_Insertion]
    place: int | None


class MatchedRows(NamedTuple):
    """The rows in which a rule is satisfied, and the columns that it would derive there."""

    rule: "ColumnRule"
    rows: Array
    derived: list[tuple[_Insertion, list[MaskedColumn]]]


class ColumnRule:
    """One rule."""

    def __init__(
        self, index: int, program: Program, layout: ColumnLayout, places: Iterator[int], follows: Follows
    ) -> None:
        """`places` numbers the expressions that may fail; `follows` collects what each insertion must reset."""
        rule = program.rules[index]
        self.index = index
        self._slots = rule.slots
        bases = Slots(program)
        atoms = [each for each in rule.body if isinstance(each, Atom)]
        self._matched = [each.predicate for each in atoms if each.mode is not Mode.ABSENT]
        self._steps = list(self._body(rule, program, bases, layout, places, follows))
        self._head = list(self._parts(rule, bases, layout, places, follows))
        consumed = [each.predicate for each in atoms if each.mode is Mode.CONSUME]
        derived = [each.predicate for part in self._head for each in part.insertions]
        # A predicate consumed and derived by the same firing stays present: its arguments are overwritten.
        self._removed = [each for each in consumed if each not in derived]
        self._copied = sum(len(each.lines) for part in self._head for each in part.insertions) > 1
        self.once = not consumed
        self._changing = any(each.mode is Mode.ABSENT for each in atoms)
        if self.once:
            for predicate in self._matched:
                follows.fired[predicate].append(index)

    @staticmethod
    def _body(
        rule: Rule, program: Program, slots: Slots, layout: ColumnLayout, places: Iterator[int], follows: Follows
    ) -> Iterator[_Step]:
        """Yield the steps of a body."""
        found: list[int] = []
        for conjunct in rule.body:
            if isinstance(conjunct, Guard):
                operations = straight(conjunct.code, slots.bases)
                yield _Condition(
                    ColumnExpression(operations, layout), _place(fallible(operations), found, places, follows)
                )
            elif isinstance(conjunct, Bind):
                operations = slots.bind(conjunct)
                place = _place(fallible(operations), found, places, follows)
                yield _Condition(ColumnExpression(operations, layout), place, conjunct.slot)
            else:
                assert isinstance(conjunct, Atom)  # a fold is an obstacle (`rmr.analysis.column_obstacles`)
                linear = conjunct.mode in (Mode.CONSUME, Mode.KEEP)
                yield _Fact(conjunct, program, slots, layout, again=linear and conjunct.predicate in found)
                if conjunct.mode is not Mode.ABSENT:
                    found.append(conjunct.predicate)

    def _parts(
        self, rule: Rule, slots: Slots, layout: ColumnLayout, places: Iterator[int], follows: Follows
    ) -> Iterator[_Part]:
        """Yield the parts of a head."""
        for head in rule.head:
            insertions = []
            failing = False
            for item in head.steps if isinstance(head, Steps) else (head,):
                assert isinstance(item, DeriveFact)
                lines = [straight(code, slots.bases) for code in item.args]
                failing |= any(map(fallible, lines))
                insertions.append(_Insertion(item.predicate, [ColumnExpression(each, layout) for each in lines]))
            yield _Part(insertions, _place(failing, self._matched, places, follows))

    def match(self, block: Block) -> MatchedRows | None:
        """Return where the rule is satisfied; None if nowhere."""
        slots: Columns = [None] * self._slots
        slots[SELF_SLOT] = block.robots
        rows = self._narrowed(block, slots)
        fired = block.fired.get(self.index)
        if fired is not None:
            if self._changing:
                fired &= rows  # where a match with ``not`` has ceased to hold, the rule may fire again
            rows = rows & ~fired
        if not rows.any():
            return None
        derived: list[tuple[_Insertion, list[MaskedColumn]]] = []
        for part in self._head:
            valid: Array | None = None
            for insertion in part.insertions:
                values = [line(slots) for line in insertion.lines]
                derived.append((insertion, values))
                for each in values:
                    valid = also(valid, each.valid)
            # Part by part: the first part that fails ends the row, so each row reports one failure, as `rmr.vm.derive`.
            rows = _valid(block, valid, part.place, rows)
        return MatchedRows(self, rows, derived) if rows.any() else None

    def _narrowed(self, block: Block, slots: Columns) -> Array:
        """Return where the body holds."""
        rows = np.ones(block.size, np.bool_)
        for step in self._steps:
            rows = step.narrow(block, slots, rows)
            if not rows.any():
                break
        return rows

    def fire(self, block: Block, match: MatchedRows, rows: Array) -> None:
        """Fire in `rows`: remove what is consumed, then insert what is derived."""
        if self.once:
            fired = block.fired.get(self.index)
            if fired is None:
                fired = block.fired[self.index] = np.zeros(block.size, np.bool_)
            fired |= rows
        # All columns are secured before any is written: a head may read the arguments that it overwrites.
        values = [(insertion.predicate, self._kept(block, insertion, held)) for insertion, held in match.derived]
        for predicate in self._removed:
            block.present[predicate] ^= rows
        for predicate, columns in values:
            block.insert(predicate, columns, rows)

    def _kept(self, block: Block, insertion: _Insertion, values: Sequence[MaskedColumn]) -> list[Array]:
        """Return the columns to insert: a copy of each column of the block, unless it is inserted in its own place."""
        if not self._copied:
            return [held.value for held in values]
        places = zip(insertion.lines, values, block.args[insertion.predicate], strict=True)
        return [
            held.value if line.slot in (None, SELF_SLOT) or held.value is column else held.value.copy()
            for line, held, column in places
        ]


def _place(failing: bool, found: Sequence[int], places: Iterator[int], follows: Follows) -> int | None:
    """Number a place where an expression may fail for the facts `found` so far; None if it cannot."""
    if not failing:
        return None
    place = next(places)
    for predicate in dict.fromkeys(found):
        follows.failed[predicate].append(place)
    return place


def column_rules(program: Program, layout: ColumnLayout, follows: Follows) -> list[ColumnRule]:
    """Return all rules of a program."""
    places = count()
    return [ColumnRule(index, program, layout, places, follows) for index in range(len(program.rules))]
