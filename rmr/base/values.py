"""The values that facts carry, and how they are written.

A value is a bool, an int (64-bit signed), a float, a string, a symbol, a robot, or a list of values (a
tuple). Symbols and robots are subclasses of str and int without behaviour of their own, so that comparing
and hashing them costs what it costs for str and int; the checker keeps the types apart.
"""

from collections.abc import Iterable
from typing import Final

INT_MIN: Final = -(1 << 63)
INT_MAX: Final = (1 << 63) - 1

ROBOT_ID_MAX: Final = 65533
"""Robot ids are 16-bit short addresses of 802.15.4; 0xFFFE and 0xFFFF are reserved by the standard."""


class Symbol(str):
    """A lower-case name used as a value, such as an area: ``middle``."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


class Robot(int):
    """A robot, written ``@4``."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"@{int(self)}"


Value = bool | int | float | str | Symbol | Robot | tuple["Value", ...]


def format_value(value: Value) -> str:
    """Return `value` in program syntax: a float always with a point or an exponent."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Robot):
        return f"@{int(value)}"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        text = repr(value)
        return text if any(mark in text for mark in ".en") else text + ".0"
    if isinstance(value, Symbol):
        return str(value)
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    return "[" + ", ".join(format_value(item) for item in value) + "]"


def format_fact(predicate: str, args: Iterable[Value], mark: str = "") -> str:
    """Return a fact in program syntax, for example ``!edge(@1, @2)``; `mark` is ``!``, ``?`` or empty."""
    return f"{mark}{predicate}({', '.join(format_value(arg) for arg in args)})"
