"""Admissible values, and their conformance to types.

The single definition: the verifier applies it to a program's constants, the virtual machine to values from outside and
to the results of expressions. Every value is bounded: ints have 64 bits, floats are finite, texts are encodable in
UTF-8, lists have bounded depth and a bounded total length.
"""

from collections.abc import Callable
from math import isfinite

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.program import Base, Type

NUMBERS = (Base.INT, Base.FLOAT)

NESTING_MAX = 16
"""Depth of nested lists, in values and types; deeper ones have no use and could exhaust a reader's stack."""

LENGTH_MAX = 65536
"""Characters of a text; total items and characters of a list with all its parts: a robot has a small memory."""

_NUMBERS: dict[type, Callable[..., bool]] = {
    float: isfinite,
    int: lambda value: INT_MIN <= value <= INT_MAX,
    Robot: lambda value: 0 <= value <= ROBOT_ID_MAX,
    bool: lambda _: True,
}
"""Range checks by class, for values that are neither texts nor lists."""

CLASSES: dict[Base, type] = {
    Base.ROBOT: Robot,
    Base.INT: int,
    Base.FLOAT: float,
    Base.BOOL: bool,
    Base.STRING: str,
    Base.SYMBOL: Symbol,
}
"""The Python class of the values of each type but lists."""


def sound(value: Value) -> bool:
    """Tell whether facts may carry `value`."""
    return length(value) <= LENGTH_MAX


def length(value: Value, nesting: int = 0) -> int:
    """Return the total number of characters and items of `value`; more than LENGTH_MAX if it is not sound."""
    kind = type(value)
    if kind is tuple:
        return _list_length(value, nesting)  # type: ignore[arg-type]
    if kind is str or kind is Symbol:
        return len(value) if _is_text(value) else LENGTH_MAX + 1  # type: ignore[arg-type]
    in_range = _NUMBERS.get(kind)
    return 0 if in_range is not None and in_range(value) else LENGTH_MAX + 1


def _list_length(items: tuple[Value, ...], nesting: int) -> int:
    """Return the total length of a list; counting stops at the limit, since shared sublists multiply the total."""
    if nesting >= NESTING_MAX:
        return LENGTH_MAX + 1
    total = len(items)
    for item in items:
        if total > LENGTH_MAX:
            break
        total += length(item, nesting + 1)
    return total


def _is_text(text: str) -> bool:
    """Tell whether `text` is encodable in UTF-8, that is, contains no surrogate."""
    return text.isascii() or not any("\ud800" <= each <= "\udfff" for each in text)


def conforms(value: Value, kind: Type) -> bool:
    """Tell whether `value` is of type `kind`; an int is no float."""
    return checker(kind)(value)


def checker(kind: Type) -> Callable[[Value], bool]:
    """Return the function that tells whether a value conforms to `kind`."""
    if kind.base is Base.OPEN:
        return sound
    if kind.base is Base.LIST:
        element = checker(kind.element or Type(Base.OPEN))
        return lambda value: type(value) is tuple and sound(value) and all(map(element, value))
    wanted = CLASSES[kind.base]
    if wanted is str or wanted is Symbol:
        return lambda value: type(value) is wanted and len(value) <= LENGTH_MAX and _is_text(value)
    in_range = _NUMBERS[wanted]
    return lambda value: type(value) is wanted and in_range(value)


def comparable(one: Type, other: Type) -> bool:
    """Return whether Python's ``==`` of any values of the two types is what a program calls equal."""
    if one.base is Base.LIST and other.base is Base.LIST:
        return one.element is not None and other.element is not None and comparable(one.element, other.element)
    return one.base is not Base.OPEN and (one.base is other.base or (one.base in NUMBERS and other.base in NUMBERS))


def fits(kind: Type, wanted: Type) -> bool:
    """Tell whether `kind` is a subtype of `wanted`; the names of symbol sets are ignored."""
    if wanted.base is Base.OPEN:
        return True
    if kind.base is not wanted.base:
        return False
    if kind.base is not Base.LIST or wanted.element is None:
        return True
    return kind.element is not None and fits(kind.element, wanted.element)
