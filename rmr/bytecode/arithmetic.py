"""Semantics of the operators (paper III.A).

Integers are 64-bit and checked, floats finite. Overflow, division by zero and mixed types have no value. An int and a
float may be mixed: the result is a float. Numbers of different types are equal when they denote the same number.
Values of different kinds (a robot and an int, a symbol and a string) are never equal. Only numbers and strings are
ordered. `+` concatenates strings and lists; results are bounded in size and depth, so that comparing and writing any
value takes bounded time.
"""

import math
from collections.abc import Callable

from rmr.base.values import INT_MAX, INT_MIN, Value
from rmr.bytecode.conform import LENGTH_MAX, sound
from rmr.bytecode.opcodes import Op


class NoValue(Exception):  # noqa: N818  (an outcome, not a fault)
    """The expression has no value; the message says why."""


class OutOfRange(NoValue):
    """Overflow: the result would not fit into 64 bits."""


def is_number(value: Value) -> bool:
    """Tell whether `value` is an int or a float; a robot is neither."""
    kind = type(value)
    return kind is int or kind is float


def same(left: Value, right: Value) -> bool:
    """Tell whether two values are equal in the language: 1 is 1.0, but @1 is not 1, true not 1, ``a`` not ``"a"``."""
    if left != right:
        return False
    if type(left) is tuple and type(right) is tuple:
        return all(same(a, b) for a, b in zip(left, right, strict=True))
    return type(left) is type(right) or (is_number(left) and is_number(right))


def checked(value: int | float) -> Value:
    """Return `value` if it is in range. Raises NoValue."""
    if type(value) is int:
        if INT_MIN <= value <= INT_MAX:
            return value
        raise OutOfRange("an integer beyond 64 bits")
    if math.isfinite(value):
        return value
    raise OutOfRange("a float beyond its range")


def numbers(name: str, *values: Value) -> tuple[float, ...]:
    """Return `values` if all are numbers. Raises NoValue."""
    for value in values:
        if not is_number(value):
            raise NoValue(f"{name} of something that is no number")
    return values  # type: ignore[return-value]


def truth(value: Value) -> bool:
    """Return `value` if it is a Boolean. Raises NoValue."""
    if type(value) is not bool:
        raise NoValue("a condition that is neither true nor false")
    return value


def less(left: Value, right: Value) -> bool:
    """Tell whether `left` comes before `right`. Raises NoValue where there is no order."""
    if is_number(left) and is_number(right):
        return left < right  # type: ignore[operator]
    if type(left) is str and type(right) is str:
        return left < right
    raise NoValue("values without an order compared")


def built(items: tuple[Value, ...]) -> Value:
    """Return a list that an expression has built. Raises NoValue if it exceeds the bounds of values."""
    if not sound(items):
        raise NoValue("a list that is too long or nested too deep")
    return items


def _add(left: Value, right: Value) -> Value:
    """Add numbers, join strings or lists."""
    if type(left) is tuple and type(right) is tuple:
        return built(left + right)
    if type(left) is str and type(right) is str:
        if len(left) + len(right) > LENGTH_MAX:
            raise NoValue("a string that is too long")
        return left + right
    a, b = numbers("+", left, right)
    return checked(a + b)


def _subtract(left: Value, right: Value) -> Value:
    a, b = numbers("-", left, right)
    return checked(a - b)


def _multiply(left: Value, right: Value) -> Value:
    a, b = numbers("*", left, right)
    return checked(a * b)


def _divide(left: Value, right: Value) -> Value:
    a, b = numbers("/", left, right)
    if b == 0:
        raise NoValue("division by zero")
    return checked(float(a / b))


def _modulo(left: Value, right: Value) -> Value:
    """Return the remainder; it has the divisor's sign."""
    a, b = numbers("%", left, right)
    if b == 0:
        raise NoValue("division by zero")
    return checked(a % b)


BINARY: dict[Op, Callable[[Value, Value], Value]] = {
    Op.ADD: _add,
    Op.SUB: _subtract,
    Op.MUL: _multiply,
    Op.DIV: _divide,
    Op.MOD: _modulo,
    Op.EQ: same,
    Op.NE: lambda left, right: not same(left, right),
    Op.LT: less,
    Op.LE: lambda left, right: not less(right, left),
    Op.GT: lambda left, right: less(right, left),
    Op.GE: lambda left, right: not less(left, right),
}


def _negate(value: Value) -> Value:
    (number,) = numbers("-", value)
    return checked(-number)


def _float(value: Value) -> Value:
    """Return a number as a float, a list with its items so; the nesting of values is bounded."""
    if type(value) is tuple:
        return tuple(map(_float, value))
    (number,) = numbers("float", value)
    return float(number)


UNARY: dict[Op, Callable[[Value], Value]] = {
    Op.NEG: _negate,
    Op.NOT: lambda value: not truth(value),
    Op.FLOAT: _float,
}
