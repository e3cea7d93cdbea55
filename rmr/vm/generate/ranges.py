"""Interval arithmetic: the bounds of results from the bounds of operands.

It is sound for ints, for floats and for both mixed, because a bound is computed by the same operation as the result and
rounding is monotonic. A bound may lie beyond the type's limits, or be infinite: then the result must be checked.
"""

from collections.abc import Callable

from rmr.bytecode.opcodes import Op
from rmr.vm.generate.known import FLOAT_MAX, Bounds


def _sum(one: Bounds, other: Bounds) -> Bounds:
    return one[0] + other[0], one[1] + other[1]


def _difference(one: Bounds, other: Bounds) -> Bounds:
    return one[0] - other[1], one[1] - other[0]


def _product(one: Bounds, other: Bounds) -> Bounds:
    corners = [a * b for a in one for b in other]  # a product is monotonic in each factor: extremes are at corners
    return min(corners), max(corners)


RESULTS: dict[Op, Callable[[Bounds, Bounds], Bounds]] = {Op.ADD: _sum, Op.SUB: _difference, Op.MUL: _product}


def nonzero(bounds: Bounds) -> bool:
    """Return whether no number within `bounds` is zero."""
    return bounds[0] > 0 or bounds[1] < 0


def quotient(one: Bounds, other: Bounds, *, whole: bool) -> Bounds:
    """Return the bounds of a quotient by a divisor that is not zero at run time; `whole`: the divisor is an int."""
    if nonzero(other):
        corners = [float(a / b) for a in one for b in other]
        return min(corners), max(corners)
    # An int other than 0 has a magnitude of 1 or more. A float near 0 gives any quotient: 2 * FLOAT_MAX is infinite.
    most = float(max(abs(one[0]), abs(one[1]))) if whole else 2 * FLOAT_MAX
    return -most, most


def remainder(one: Bounds, other: Bounds, *, whole: bool) -> Bounds:
    """Return the bounds of a remainder, which has the divisor's sign; `whole`: of an int by an int."""
    low = min(0, other[0])
    high = max(0, other[1])
    if not whole:
        return low, high  # a float remainder may be rounded to the divisor itself
    if low == 0 and one[0] >= 0:
        return 0, min(one[1], high - 1)
    return min(0, low + 1), max(0, high - 1)


def negative(bounds: Bounds) -> Bounds:
    """Return the bounds of a negated value."""
    return -bounds[1], -bounds[0]


def magnitude(bounds: Bounds) -> Bounds:
    """Return the bounds of the absolute value."""
    low, high = bounds
    return max(0, low, -high), max(abs(low), abs(high))
