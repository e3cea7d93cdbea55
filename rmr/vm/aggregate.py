"""What an aggregate makes of the values of its matches (paper III.D's comprehensions, folded to one value).

The values come in the order of the matches, oldest first. A sum is an int as long as ints alone are added, and
then exact whatever its parts add up to on the way. Of equal values the oldest is the smallest and the largest;
it keeps its type, be it an int among floats.
"""

from collections.abc import Callable

from rmr.base.values import Value
from rmr.bytecode.arithmetic import built, checked, less, numbers
from rmr.bytecode.program import Operator


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
"""One value of all; NoValue if it is out of range. MIN and MAX choose a match: `better`."""


def better(operator: Operator, value: Value, best: Value | None) -> bool:
    """Tell whether `value` takes the place of the `best` so far. Raises NoValue for values without an order."""
    if best is None:
        less(value, value)
        return True
    return less(value, best) if operator is Operator.MIN else less(best, value)
