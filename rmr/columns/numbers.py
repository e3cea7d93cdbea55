"""Vectorised operators, equal bit for bit to `rmr.bytecode.arithmetic` on single values.

numpy wraps integers around, rounds them when they meet floats, and has its own sine. So overflow is detected, and a
result that numpy cannot compute exactly is computed value by value, which is slow and rare: products near 64 bits,
integers beyond 2**53 among floats, angles. Rows in which the fact does not hold have arbitrary values; these pass
through every operator without an error and are masked afterwards.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from rmr.analysis.straight_line import work_out
from rmr.base.values import INT_MIN
from rmr.bytecode.arithmetic import NoValue
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.program import Base

Array = npt.NDArray[Any]
"""A column, or a single value that numpy broadcasts to a column."""

EXACT = 1 << 53
"""Bound on the magnitude of integers that are all exact as floats (53 bits of mantissa)."""
SURE = float((1 << 63) - 8192)
"""Bound on a product computed with floats below which the exact product certainly fits into 64 bits.

The margin covers three roundings, of both factors and of the product, each by half a unit in the last place."""
BEYOND = float(1 << 63)
"""Least positive float that no 64-bit integer reaches."""


class MaskedColumn(NamedTuple):
    """A column of values."""

    value: Array
    valid: Array | None = None
    """Rows in which the expression has a value; None: all."""


Work = Callable[[list[Array], list[Base]], MaskedColumn]


def also(one: Array | None, other: Array | None) -> Array | None:
    """Return the conjunction of two masks; None stands for all rows."""
    if one is None or other is None:
        return other if one is None else one
    both: Array = one & other
    return both


def write(column: Array, value: Array, rows: Array) -> None:
    """Write a value, or the values of another column, into `rows` of a column.

    numpy's masked copies branch on each row. The rows that fire are unpredictable, so that costs ten times as much.
    """
    if column.itemsize == 1:
        # Branch-free select: -True is 0xFF as an octet, so a selected row gets column ^ (column ^ value) = value.
        octets = column.view(np.uint8)
        octets ^= (octets ^ value.view(np.uint8)) & -rows.view(np.uint8)
    else:
        np.putmask(column, rows, value)


def unless(rows: Array) -> Array:
    """Return 0 in `rows` and the largest number elsewhere."""
    # 1 - 1 is 0; 0 - 1 wraps around to 65535.
    return rows.astype(np.uint16) - np.uint16(1)


def _floats(value: Array) -> Array:
    """Return numbers as floats, rounded as Python rounds them."""
    return value.astype(np.float64, copy=False)


def _one_by_one(name: str, values: list[Array], rows: Array, found: MaskedColumn) -> MaskedColumn:
    """Compute `rows` of a column value by value, as the interpreter does, and merge them into the column `found`."""
    columns = np.broadcast_arrays(*map(np.atleast_1d, values))
    shape = columns[0].shape
    value = np.array(np.broadcast_to(found.value, shape))
    valid = np.ones(shape, np.bool_) if found.valid is None else np.array(np.broadcast_to(found.valid, shape))
    places = np.flatnonzero(np.broadcast_to(rows, shape))
    for place, *operands in zip(places.tolist(), *[each[places].tolist() for each in columns], strict=True):
        try:
            value[place] = work_out(name, operands)
            valid[place] = True
        except NoValue:
            valid[place] = False
    return MaskedColumn(value, valid)


def _large(value: Array, base: Base) -> Array | bool:
    """Return the rows with integers that may be inexact as floats."""
    return (value > EXACT) | (value < -EXACT) if base is Base.INT else False


def _mended(name: str, values: list[Array], bases: list[Base], found: MaskedColumn) -> MaskedColumn:
    """Return a column computed with floats, recomputed exactly where an operand is too large an integer."""
    rows = _large(values[0], bases[0]) | _large(values[-1], bases[-1])
    return _one_by_one(name, values, np.asarray(rows), found) if np.any(rows) else found


# ---- arithmetic


def _finite(value: Array) -> MaskedColumn:
    return MaskedColumn(value, np.isfinite(value))


def _add(values: list[Array], bases: list[Base]) -> MaskedColumn:
    one, other = values
    if Base.FLOAT in bases:
        return _finite(_floats(one) + _floats(other))
    total = one + other
    # The sum has overflowed if both operands have the sign that the sum has not (Warren, Hacker's Delight, 2-13).
    return MaskedColumn(total, ((one ^ total) & (other ^ total)) >= 0)


def _sub(values: list[Array], bases: list[Base]) -> MaskedColumn:
    one, other = values
    if Base.FLOAT in bases:
        return _finite(_floats(one) - _floats(other))
    rest = one - other
    # The difference has overflowed if the operands differ in sign and the result has not the minuend's sign.
    return MaskedColumn(rest, ((one ^ other) & (one ^ rest)) >= 0)


def _mul(values: list[Array], bases: list[Base]) -> MaskedColumn:
    one, other = values
    about = _floats(one) * _floats(other)
    if Base.FLOAT in bases:
        return _finite(about)
    # numpy has no overflow flag for products: a float estimate decides, and doubtful rows are computed exactly.
    sure = np.abs(about) < SURE
    found = MaskedColumn(one * other, sure)
    return found if np.all(sure) else _one_by_one("mul", values, ~sure, found)


def _div(values: list[Array], bases: list[Base]) -> MaskedColumn:
    one, other = values
    share = _floats(one) / _floats(other)
    found = MaskedColumn(share, (other != 0) & np.isfinite(share))
    return found if Base.FLOAT in bases else _mended("div", values, bases, found)


def _mod(values: list[Array], bases: list[Base]) -> MaskedColumn:
    one, other = values
    if Base.FLOAT not in bases:
        return MaskedColumn(np.remainder(one, other), other != 0)
    rest = np.remainder(_floats(one), _floats(other))
    return MaskedColumn(rest, (other != 0) & np.isfinite(rest))


def _neg(values: list[Array], bases: list[Base]) -> MaskedColumn:
    [value] = values
    return MaskedColumn(-value, None if bases[0] is Base.FLOAT else value != INT_MIN)


def _abs(values: list[Array], bases: list[Base]) -> MaskedColumn:
    [value] = values
    return MaskedColumn(np.abs(value), None if bases[0] is Base.FLOAT else value != INT_MIN)


def _floor(values: list[Array], bases: list[Base]) -> MaskedColumn:
    [value] = values
    if bases[0] is Base.INT:
        return MaskedColumn(np.array(value))
    whole = np.floor(value)
    return MaskedColumn(whole.astype(np.int64), (whole >= -BEYOND) & (whole < BEYOND))


def _sqrt(values: list[Array], _: list[Base]) -> MaskedColumn:
    root = np.sqrt(_floats(values[0]))
    return MaskedColumn(root, values[0] >= 0)


def _float(values: list[Array], _: list[Base]) -> MaskedColumn:
    return MaskedColumn(values[0].astype(np.float64))


def _id(values: list[Array], _: list[Base]) -> MaskedColumn:
    return MaskedColumn(values[0].astype(np.int64))


def _single(name: str) -> Work:
    """Return the operator that computes a function value by value."""

    def work(values: list[Array], _: list[Base]) -> MaskedColumn:
        nothing = np.zeros(np.broadcast_shapes(*[each.shape for each in values]))
        return _one_by_one(name, values, np.ones(nothing.shape, np.bool_), MaskedColumn(nothing))

    return work


# ---- comparisons


_COMPARED: dict[str, Callable[[Array, Array], Array]] = {
    "eq": np.equal,
    "ne": np.not_equal,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
}


def _compare(name: str) -> Work:
    compared = _COMPARED[name]

    def work(values: list[Array], bases: list[Base]) -> MaskedColumn:
        if bases[0] is bases[1]:
            return MaskedColumn(compared(*values))
        found = MaskedColumn(compared(_floats(values[0]), _floats(values[1])))
        return MaskedColumn(_mended(name, values, bases, found).value)

    return work


def same(one: Array, one_base: Base, other: Array, other_base: Base) -> Array:
    """Return in which rows two columns of comparable types hold the same value."""
    return WORK["eq"]([one, other], [one_base, other_base]).value


def _choose(comparison: str) -> Work:
    """Return the operator for the smaller or larger of two values; the first of equal ones (0.0 and -0.0)."""
    better = _compare(comparison)

    def work(values: list[Array], bases: list[Base]) -> MaskedColumn:
        second = better(values[::-1], bases[::-1]).value
        one, other = map(_floats, values) if Base.FLOAT in bases else values
        return MaskedColumn(np.where(second, other, one))

    return work


FORMS: dict[str, Work] = {
    "absolute": _abs,
    "smaller": _choose("lt"),
    "larger": _choose("gt"),
    "rounded_down": _floor,
    "root": _sqrt,
    "robot_number": _id,
}
"""Vectorised forms, by the name in `FUNCTIONS`; a function without one is computed value by value."""

WORK: dict[str, Work] = {
    **{name: _compare(name) for name in _COMPARED},
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "mod": _mod,
    "neg": _neg,
    "float": _float,
    "not": lambda values, _: MaskedColumn(~values[0]),
    "never": lambda values, _: MaskedColumn(np.zeros_like(values[0], np.bool_)),
    "always": lambda values, _: MaskedColumn(np.ones_like(values[0], np.bool_)),
    **{each.name: FORMS[each.columns] if each.columns else _single(each.name) for each in FUNCTIONS},
}
"""Operators by name, for operands that have a value in every row."""
