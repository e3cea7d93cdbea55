"""The built-in functions of expressions (paper III.A): one Python function for each name of `FUNCTIONS`.

Functions of numbers have no value outside their domain; those of lists none for what is no list, for a place
that the list does not have, and for items without an order.
"""

import math
from collections.abc import Callable

from rmr.base.time import Instant, in_seconds
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.arithmetic import NoValue, checked, numbers, same

SORTABLE: tuple[set[type], ...] = ({int, float}, {str}, {Symbol}, {Robot})
"""Kinds of items that `sort` can order among themselves."""


def _extreme(choose: Callable[[float, float], float], a: float, b: float) -> float:
    """Return the smaller or larger of two numbers; a float if either is one."""
    chosen = choose(a, b)
    return chosen if type(a) is type(b) else float(chosen)


NUMERIC: dict[str, Callable[..., float]] = {
    "abs": abs,
    "min": lambda a, b: _extreme(min, a, b),
    "max": lambda a, b: _extreme(max, a, b),
    "floor": math.floor,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "atan2": math.atan2,
    "dist": lambda x1, y1, x2, y2: math.hypot(x2 - x1, y2 - y1),
}


def _items(name: str, value: Value) -> tuple[Value, ...]:
    """Return `value` if it is a list."""
    if type(value) is not tuple:
        raise NoValue(f"{name} of something that is no list")
    return value


def _place(name: str, value: Value, size: int) -> int:
    """Return `value` if it is a whole number from 0 up to `size`."""
    if type(value) is not int:
        raise NoValue(f"{name} at a place that is no whole number")
    if not 0 <= value <= size:
        raise NoValue(f"{name} at a place that the list does not have")
    return value


def _len(value: Value) -> Value:
    """Return how many items a list, or characters a string, has."""
    return len(value) if type(value) is str else len(_items("len", value))


def _nth(value: Value, place: Value) -> Value:
    """Return the item at `place`, counted from 0."""
    items = _items("nth", value)
    return items[_place("nth", place, len(items) - 1)]


def _member(item: Value, value: Value) -> Value:
    return any(same(item, each) for each in _items("member", value))


def _sort(value: Value) -> Value:
    """Return the items in ascending order; of equal ones (1 and 1.0) the first stays first."""
    items = _items("sort", value)
    kinds = {type(item) for item in items}
    if not any(kinds <= sortable for sortable in SORTABLE):
        raise NoValue("sort of items without an order")
    return tuple(sorted(items))


def _rest(value: Value, count: Value) -> Value:
    """Return a list without its first `count` items."""
    items = _items("rest", value)
    return items[_place("rest", count, len(items)) :]


def _id(value: Value) -> Value:
    if type(value) is not Robot:
        raise NoValue("id of something that is no robot")
    return int(value)


OTHERS: dict[str, Callable[..., Value]] = {
    "id": _id,
    "len": _len,
    "nth": _nth,
    "member": _member,
    "sort": _sort,
    "rest": _rest,
}


def call(name: str, args: list[Value], now: Instant) -> Value:
    """Return the value of a function of `FUNCTIONS` at `now`. Raises NoValue."""
    if name == "now":
        return in_seconds(now)
    if name in OTHERS:
        return OTHERS[name](*args)
    try:
        return checked(NUMERIC[name](*numbers(name, *args)))
    except (ValueError, OverflowError):
        raise NoValue(f"{name} outside its domain") from None
