"""Which values there are, and which of them a type takes.

The one place that says so: the verifier asks it about a program's constants, the virtual machine about what
comes from outside and about what an expression yields. A value is bounded in every direction: 64 bits, finite,
texts that can be written in UTF-8, lists neither too deep nor, counted with all that is in them, too long.
"""

from collections.abc import Callable
from math import isfinite

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.program import Base, Type

NESTING_MAX = 16
"""Lists in lists, in values and types; deeper ones have no use and could exhaust a reader's stack."""

LENGTH_MAX = 65536
"""Characters of a text; items of a list, with the characters and items of its items: a robot has a small memory."""

_NUMBERS: dict[type, Callable[..., bool]] = {
    float: isfinite,
    int: lambda value: INT_MIN <= value <= INT_MAX,
    Robot: lambda value: 0 <= value <= ROBOT_ID_MAX,
    bool: lambda _: True,
}
"""Tell of values that are no texts and no lists whether they are in range."""

_CLASSES: dict[Base, type] = {
    Base.ROBOT: Robot,
    Base.INT: int,
    Base.FLOAT: float,
    Base.BOOL: bool,
    Base.STRING: str,
    Base.SYMBOL: Symbol,
}


def sound(value: Value) -> bool:
    """Tell whether `value` is one that facts may carry."""
    return length(value) <= LENGTH_MAX


def length(value: Value, nesting: int = 0) -> int:
    """Return how many characters and items `value` holds; more than LENGTH_MAX if it is not sound."""
    kind = type(value)
    if kind is tuple:
        return _list_length(value, nesting)  # type: ignore[arg-type]
    if kind is str or kind is Symbol:
        return len(value) if _is_text(value) else LENGTH_MAX + 1  # type: ignore[arg-type]
    in_range = _NUMBERS.get(kind)
    return 0 if in_range is not None and in_range(value) else LENGTH_MAX + 1


def _list_length(items: tuple[Value, ...], nesting: int) -> int:
    """Add up; stop at once when it is too much, for the same list may stand in a list many times."""
    if nesting >= NESTING_MAX:
        return LENGTH_MAX + 1
    total = len(items)
    for item in items:
        if total > LENGTH_MAX:
            break
        total += length(item, nesting + 1)
    return total


def _is_text(text: str) -> bool:
    """Tell whether UTF-8 has octets for `text`: it has none for half of a surrogate pair."""
    return text.isascii() or not any("\ud800" <= each <= "\udfff" for each in text)


def conforms(value: Value, kind: Type) -> bool:
    """Tell whether `value` may stand where `kind` is declared (an int is no float)."""
    return checker(kind)(value)


def checker(kind: Type) -> Callable[[Value], bool]:
    """Return the function that tells whether a value conforms to `kind`."""
    if kind.base is Base.OPEN:
        return sound
    if kind.base is Base.LIST:
        element = checker(kind.element or Type(Base.OPEN))
        return lambda value: type(value) is tuple and sound(value) and all(map(element, value))
    wanted = _CLASSES[kind.base]
    if wanted is str or wanted is Symbol:
        return lambda value: type(value) is wanted and len(value) <= LENGTH_MAX and _is_text(value)
    in_range = _NUMBERS[wanted]
    return lambda value: type(value) is wanted and in_range(value)


def fits(kind: Type, wanted: Type) -> bool:
    """Tell whether every value of `kind` is one of `wanted`; the names of symbol sets make no difference."""
    if wanted.base is Base.OPEN:
        return True
    if kind.base is not wanted.base:
        return False
    if kind.base is not Base.LIST or wanted.element is None:
        return True
    return kind.element is not None and fits(kind.element, wanted.element)
