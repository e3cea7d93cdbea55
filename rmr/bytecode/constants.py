"""Checks of a program's constants, memoised by identity.

Decoded entries share the values of the table of constants. Checking a long list again for every entry that refers to
it would let a small forged file take hours.
"""

import re

from rmr.base.values import Symbol, Value
from rmr.bytecode.conform import conforms, sound
from rmr.bytecode.program import Base, Type

_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")


def is_name(text: str) -> bool:
    """Tell whether `text` is an identifier: of a predicate, a symbol, a symbol set or an assertion."""
    return _NAME.fullmatch(text) is not None


class Constants:
    """Memoised checks; the checked values must outlive the object, since their identities are the keys."""

    def __init__(self) -> None:
        self._proper: dict[int, bool] = {}
        self._conforming: dict[tuple[int, str], bool] = {}

    def proper(self, value: Value) -> bool:
        """Tell whether a program may hold `value`: it is sound, and its symbols are names."""
        if type(value) is not tuple:
            return _is_proper(value)
        if id(value) not in self._proper:
            self._proper[id(value)] = sound(value) and _is_proper(value)
        return self._proper[id(value)]

    def conforms(self, value: Value, kind: Type) -> bool:
        """Tell whether a program may hold `value` in the place of type `kind`."""
        if type(value) is not tuple:
            return self.proper(value) and conforms(value, kind)
        key = (id(value), _shape(kind))
        if key not in self._conforming:
            self._conforming[key] = self.proper(value) and conforms(value, kind)
        return self._conforming[key]


def _is_proper(value: Value) -> bool:
    if type(value) is tuple:
        return all(map(_is_proper, value))
    return is_name(value) if type(value) is Symbol else sound(value)


def _shape(kind: Type) -> str:
    """Return a key of the type without the names of symbol sets, which conformance ignores."""
    if kind.base is Base.LIST:
        return "list " + (_shape(kind.element) if kind.element is not None else "")
    return kind.base.name
