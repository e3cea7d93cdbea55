"""Checks of what comes over the bus: each returns the value in its declared type or raises `MalformedError`.

msgpack says whether octets are well formed; these say whether they are what was agreed. They accept exactly the
types that are sent (a bool is no number here) and never an infinite or undefined number.
"""

import math
from collections.abc import Callable
from typing import Any, Final

from rmr.base.values import ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.radio.air import Announcement
from rmr.radio.links import Disturbance

VALUE_DEPTH_MAX: Final = 16
"""Lists within lists in a fact's arguments."""

PLAIN_DEPTH_MAX: Final = 32
"""Lists and records within each other in plain data; reports and arenas have a handful."""


class MalformedError(ValueError):
    """Octets that are no message of ours; the message says what is wrong with them."""


Check = Callable[[Any], Any]


def number(value: Any) -> float:
    """Accept a finite number and return it as a float."""
    if type(value) is float and math.isfinite(value):
        return value
    if type(value) is int and -(1 << 53) <= value <= 1 << 53:
        return float(value)
    raise MalformedError("expected a finite number")


def integer(value: Any) -> int:
    """Accept an integer."""
    if type(value) is not int:
        raise MalformedError("expected an integer")
    return value


def count(value: Any) -> int:
    """Accept an integer that is not negative."""
    if type(value) is not int or value < 0:
        raise MalformedError("expected a count")
    return value


def robot(value: Any) -> int:
    """Accept a robot's id."""
    if type(value) is not int or not 0 <= value <= ROBOT_ID_MAX:
        raise MalformedError("expected a robot's id")
    return value


def flag(value: Any) -> bool:
    """Accept a bool."""
    if type(value) is not bool:
        raise MalformedError("expected a flag")
    return value


def text(value: Any) -> str:
    """Accept a string."""
    if type(value) is not str:
        raise MalformedError("expected text")
    return value


def plain(value: Any, depth: int = 0) -> Any:
    """Accept what JSON and msgpack share, and octets; lists become tuples."""
    kind = type(value)
    if value is None or kind in {bool, int, float, str, bytes}:
        return value
    if depth > PLAIN_DEPTH_MAX:
        raise MalformedError("nested too deeply")
    if kind is list:
        return tuple([plain(item, depth + 1) for item in value])
    if kind is dict:
        return {text(key): plain(item, depth + 1) for key, item in value.items()}
    raise MalformedError("expected plain data")


def record(value: Any) -> dict[str, Any]:
    """Accept a dict of plain data by name."""
    if type(value) is not dict:
        raise MalformedError("expected a record")
    return {text(key): plain(item) for key, item in value.items()}


def announcement(value: Any) -> Announcement:
    """Accept the announcement of a radio frame."""
    try:
        return Announcement.from_wire(value)
    except ValueError as error:
        raise MalformedError(str(error)) from None


def disturbance(value: Any) -> Disturbance:
    """Accept a disturbance of the radio."""
    try:
        return Disturbance.from_wire(value)
    except ValueError as error:
        raise MalformedError(str(error)) from None


def one_of(words: tuple[str, ...]) -> Check:
    """Return the check that accepts one of `words`."""

    def check(value: Any) -> str:
        if type(value) is not str or value not in words:
            raise MalformedError(f"expected one of {', '.join(words)}")
        return value

    return check


def optional(inner: Check) -> Check:
    """Return the check that accepts None, too."""
    return lambda value: None if value is None else inner(value)


def each(inner: Check, most: int | None = None) -> Check:
    """Return the check that accepts a list of what `inner` accepts, `most` at most; the result is a tuple."""

    def check(value: Any) -> tuple[Any, ...]:
        if type(value) is not list or (most is not None and len(value) > most):
            raise MalformedError("expected a list" + (f" of at most {most}" if most else ""))
        return tuple([inner(item) for item in value])

    return check


def group(*inner: Check) -> Check:
    """Return the check that accepts a list with one item for each of `inner`; the result is a tuple."""

    def check(value: Any) -> tuple[Any, ...]:
        if type(value) is not list or len(value) != len(inner):
            raise MalformedError(f"expected {len(inner)} values")
        return tuple([test(item) for test, item in zip(inner, value, strict=True)])

    return check


# --- values of facts: symbols and robots keep their type ---------------------------------------------------


def pack_value(value: Value) -> Any:
    """Return `value` as plain data in which symbols, robots and lists are marked."""
    if isinstance(value, Symbol):
        return ["s", str(value)]
    if isinstance(value, Robot):
        return ["r", int(value)]
    if isinstance(value, tuple):
        return ["l", *map(pack_value, value)]
    return value


def value(packed: Any, depth: int = 0) -> Value:
    """Return the value that `pack_value` packed."""
    if type(packed) in {bool, int, float, str}:
        return packed  # type: ignore[no-any-return]
    if type(packed) is not list or not packed or depth > VALUE_DEPTH_MAX:
        raise MalformedError("expected a value")
    mark, *rest = packed
    if mark == "l":
        return tuple([value(item, depth + 1) for item in rest])
    if mark == "s" and len(rest) == 1:
        return Symbol(text(rest[0]))
    if mark == "r" and len(rest) == 1:
        return Robot(robot(rest[0]))
    raise MalformedError("expected a value")
