"""Which constants a program may hold, found out once for each however many entries share it.

Decoded entries share the values of the table of constants, so a value is known by its identity: looking at a
long list again for each of the entries that name it would make a small file take hours.
"""

import re

from rmr.base.values import Symbol, Value
from rmr.bytecode.conform import conforms, sound
from rmr.bytecode.program import Base, Type

_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")


def is_name(text: str) -> bool:
    """Tell whether `text` names something: a predicate, a symbol, a symbol set, an assertion."""
    return _NAME.fullmatch(text) is not None


class Constants:
    """Remembers what it was asked; the values live as long as it does."""

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
        """Tell whether `value` may stand where `kind` is declared."""
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
    """Return what of a type a value can contradict: not the name of a symbol set."""
    if kind.base is Base.LIST:
        return "list " + (_shape(kind.element) if kind.element is not None else "")
    return kind.base.name
