"""Encoding of values in columns: numbers as they are, Booleans in one octet, robots in two, symbols as small codes.

No operation makes a new symbol, so a symbol's code is its index among those in the program and the given facts.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.heads import codes
from rmr.bytecode.program import Atom, Base, Bind, Code, Constant, Guard, InitialFact, Program, Slot
from rmr.columns.numbers import Array


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
