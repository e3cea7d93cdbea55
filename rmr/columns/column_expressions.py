"""Vectorised expressions: their operations one after another, each on whole columns of a block."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from rmr.analysis.straight_line import AND, CONST, IF, LOAD, NOTHING, OR, Operation
from rmr.bytecode.program import Base
from rmr.columns.column_layout import ColumnLayout
from rmr.columns.numbers import WORK, Array, MaskedColumn, also


class _Step(NamedTuple):
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


def _ready(operation: Operation, operations: Sequence[Operation], layout: ColumnLayout) -> _Step:
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
    return _Step(operation.name, operation.args, [operations[each].base for each in operation.args], slot, constant)


def _held(step: _Step, operands: list[MaskedColumn], slots: Sequence[Array | None]) -> MaskedColumn:
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
