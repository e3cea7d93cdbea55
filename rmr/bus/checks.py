"""Checks of what comes over the bus: each returns the value in its declared type or raises `MalformedError`.

msgpack says whether octets are well formed; these say whether they are what was agreed. They accept exactly the
types that are sent (a bool is no number here), never an infinite or undefined number, and nothing beyond the bounds
named here: what passes can be used without another look. Text that is meant for people comes out printable.
"""

import math
import re
from collections.abc import Callable
from typing import Any, Final

from rmr.base.printable import one_line
from rmr.base.time import NEVER
from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bus.keys import LAB_NAME
from rmr.radio.air import PLACE_MAX_M, Announcement
from rmr.radio.links import Disturbance

VALUE_DEPTH_MAX: Final = 16
"""Depth of nested lists in a fact's arguments, at most."""

PLAIN_DEPTH_MAX: Final = 32
"""Depth of nested lists and records in plain data, at most; reports and arenas have a handful."""

COUNT_MAX: Final = 1 << 53
"""Greatest count: JSON and floats hold it exactly."""

QUANTITY_MAX: Final = 1e9
"""Greatest measured value, whatever its unit: a robot that drives for a year at 10 m/s goes 3e8 m."""

PEOPLE_CHARACTERS_MAX: Final = 500
"""Longest text for people: a reason or a progress line."""

TEXT_CHARACTERS_MAX: Final = 1 << 16
"""Longest text of a fact, a goal or an action."""

ROBOTS_MAX: Final = 1000
"""Robots of a lab, at most."""

LIVES_MAX: Final = 1 << 31
"""Incarnations of one robot, at most."""

NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,199}")
"""Format of a name of the language or of the lab file."""


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


def quantity(value: Any) -> float:
    """Accept a measured value: a finite number that a body in a lab can have to do with."""
    measured = number(value)
    if not -QUANTITY_MAX <= measured <= QUANTITY_MAX:
        raise MalformedError("expected a measured value within bounds")
    return measured


def place(value: Any) -> float:
    """Accept a coordinate in metres."""
    metres = number(value)
    if not -PLACE_MAX_M < metres < PLACE_MAX_M:
        raise MalformedError("expected a place")
    return metres


def length(value: Any) -> float:
    """Accept a distance: a measured value that is not negative."""
    measured = number(value)
    if not 0.0 <= measured <= QUANTITY_MAX:
        raise MalformedError("expected a distance")
    return measured


def integer(value: Any) -> int:
    """Accept an integer of 64 bits."""
    if type(value) is not int or not INT_MIN <= value <= INT_MAX:
        raise MalformedError("expected an integer")
    return value


def instant(value: Any) -> int:
    """Accept an instant of lab time, which is negative for a moment before the start."""
    if type(value) is not int or not -NEVER <= value <= NEVER:
        raise MalformedError("expected an instant")
    return value


def count(value: Any) -> int:
    """Accept an integer that is not negative."""
    if type(value) is not int or not 0 <= value <= COUNT_MAX:
        raise MalformedError("expected a count")
    return value


def sender(value: Any) -> int:
    """Accept a robot's id, the world (-1) or an operator (-2)."""
    if type(value) is not int or not -2 <= value <= ROBOT_ID_MAX:
        raise MalformedError("expected a sender")
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
    """Accept a string of bounded length, as it is; what shows it makes it printable."""
    if type(value) is not str or len(value) > TEXT_CHARACTERS_MAX:
        raise MalformedError("expected text")
    return value


def people(value: Any) -> str:
    """Accept a text for people and return it as one printable line."""
    if type(value) is not str:
        raise MalformedError("expected text")
    return one_line(value, PEOPLE_CHARACTERS_MAX)


def octets(most: int) -> Check:
    """Return the check that accepts octets, `most` at most."""

    def check(value: Any) -> bytes:
        if type(value) is not bytes or len(value) > most:
            raise MalformedError("expected octets")
        return value

    return check


def name(value: Any) -> str:
    """Accept a name of the language or of the lab file."""
    if type(value) is not str or NAME.fullmatch(value) is None:
        raise MalformedError("expected a name")
    return value


def lab_name(value: Any) -> str:
    """Accept the name of a lab."""
    if type(value) is not str or LAB_NAME.fullmatch(value) is None:
        raise MalformedError("expected the name of a lab")
    return value


def plain(value: Any, depth: int = 0) -> Any:
    """Accept what JSON and msgpack share, no number that is infinite or undefined; lists become tuples."""
    kind = type(value)
    if value is None or kind in {bool, int, str} or (kind is float and math.isfinite(value)):
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


def fields(required: dict[str, Check], optional: dict[str, Check] | None = None) -> Check:
    """Return the check of a record with these fields, each with its own check; others may be any plain data."""
    known = required | (optional or {})

    def check(value: Any) -> dict[str, Any]:
        if type(value) is not dict:
            raise MalformedError("expected a record")
        for key in required:
            if key not in value:
                raise MalformedError(f"expected a record with {key}")
        return {text(key): known[key](item) if key in known else plain(item) for key, item in value.items()}

    return check


def by_name(inner: Check) -> Check:
    """Return the check of a record whose values `inner` accepts."""

    def check(value: Any) -> dict[str, Any]:
        if type(value) is not dict:
            raise MalformedError("expected a record")
        return {text(key): inner(item) for key, item in value.items()}

    return check


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


def roster(value: Any) -> tuple[int, ...]:
    """Accept the ids of a lab's robots: at least one, none twice."""
    ids: tuple[int, ...] = each(robot, ROBOTS_MAX)(value)
    if not ids or len(set(ids)) < len(ids):
        raise MalformedError("expected a lab's robots")
    return ids


def lives(value: Any) -> int:
    """Accept the number of a robot's earlier incarnations."""
    told: int = count(value)
    if told > LIVES_MAX:
        raise MalformedError("expected a count of lives")
    return told


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
    kind = type(packed)
    if kind is int:
        return integer(packed)
    if kind is str:
        return text(packed)
    if kind is bool or (kind is float and not math.isnan(packed)):
        return packed  # type: ignore[no-any-return]
    if type(packed) is not list or not packed or depth > VALUE_DEPTH_MAX:
        raise MalformedError("expected a value")
    mark, *rest = packed
    if mark == "l":
        return tuple([value(item, depth + 1) for item in rest])
    if mark == "s" and len(rest) == 1:
        return Symbol(name(rest[0]))
    if mark == "r" and len(rest) == 1:
        return Robot(robot(rest[0]))
    raise MalformedError("expected a value")
