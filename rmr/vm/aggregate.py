"""Aggregates: folds of the values of a body's matches into one value (paper III.D's comprehensions).

The values come in the order of the matches, oldest first. A sum of ints is an int; it is exact, for only the total must
be in range, not the partial sums. Among equal values the oldest is both the minimum and the maximum, and keeps its type
(1 and 1.0 are equal).
"""

from collections.abc import Callable
from typing import Any

from rmr.base.values import Value
from rmr.bytecode.arithmetic import built, checked, less, numbers
from rmr.bytecode.program import Best, Operator


def _sum(values: list[Value]) -> Value:
    total: float = 0
    for value in numbers("sum", *values):
        total += value
    return checked(total)


FOLDS: dict[Operator, Callable[[list[Value]], Value]] = {
    Operator.COUNT: len,
    Operator.SUM: _sum,
    Operator.COLLECT: lambda values: built(tuple(values)),
}
"""Folds by operator; each raises NoValue if its result is out of range. MIN and MAX select a match: `better`."""


def better(operator: Operator, value: Value, best: Value | None) -> bool:
    """Return whether `value` replaces the `best` so far. Raises NoValue for values without an order."""
    if best is None:
        less(value, value)  # raises for a single value without an order, as it would with two
        return True
    return less(value, best) if operator is Operator.MIN else less(best, value)


def replaces(best: Best, args: tuple[Value, ...], kept: tuple[Value, ...]) -> bool:
    """Return whether a fact takes the place of the one `kept`, with which it agrees before the argument of `best`.

    Equal values are told apart by the arguments behind, in their order: what is kept of some facts is the same in
    whichever order they come, at every robot.
    """
    value: Any = args[best.argument]
    other: Any = kept[best.argument]
    if value != other:  # of one type, which has an order (`rmr.bytecode.verify`)
        return (value < other) is best.least
    behind, others = _place(args[best.argument + 1 :]), _place(kept[best.argument + 1 :])
    return behind < others if best.least else others < behind


def _place(value: Value) -> tuple[str, Any]:
    """Return where a value of any type stands among all values; those of different types by the names of these."""
    if isinstance(value, tuple):
        return "list", tuple([_place(item) for item in value])
    return type(value).__name__, value


def reduced(operator: Operator, values: list[Value]) -> Value | None:
    """Return the value of a fold; None if it has none, as MIN and MAX of no value. Raises NoValue."""
    if operator not in (Operator.MIN, Operator.MAX):
        return FOLDS[operator](values)
    best: Value | None = None
    for value in values:
        if better(operator, value, best):
            best = value
    return best
