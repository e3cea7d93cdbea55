"""Makes the objects of a graph state (`object_graph`) anew, and gives those of a skeleton their contents.

It makes objects of classes of `rmr` only, of modules that are loaded, by `__new__` without arguments, and sets their
attributes. It calls nothing else, and imports nothing.

A match may wait with the function that inserts what it derives, generated from the program (`rmr.vm.generate`). A state
holds the name of such a function. It is made at its first use, and has a placeholder before: both have one name, and do
the same.
"""

import enum
import sys
import types
from collections import OrderedDict, deque
from collections.abc import Callable
from random import Random
from typing import Any, Final

from rmr.base.values import Robot, Symbol


class GeneratedFunctions:
    """The generated functions of one machine's program; of an interpreted one there are none."""

    def __init__(self, machine: object) -> None:
        module: Any = getattr(type(machine), "module", None)
        self._names: dict[str, Any] = {} if module is None else module.names

    def name_of(self, function: Any) -> str | None:
        """Return the name of a generated function, or of its placeholder; None for another one."""
        # The placeholder of a function that has not been used.
        if function.__qualname__ == "Module._first.<locals>.first":
            held = dict(zip(function.__code__.co_freevars, function.__closure__, strict=True))
            name = str(held["name"].cell_contents)
        elif function.__globals__ is self._names:
            name = function.__name__
        else:
            return None
        return name if name in self._names else None

    def function(self, name: str) -> Any:
        """Return the function of that name, or its placeholder; None if the program has none."""
        return self._names.get(name)


PACKAGE: Final = "rmr."
"""Classes of which objects are made begin with it."""
UNSET: Final = ["unset"]
"""The value of an attribute that an object does not have."""


class GraphMismatchError(ValueError):
    """Octets are no graph state of this skeleton; the message says why."""


class Restoration:
    """Makes objects from their contents."""

    def __init__(self, skeleton: list[Any], made: list[Any], functions: GeneratedFunctions) -> None:
        self._functions = functions
        self._objects: list[Any] = [*skeleton, *([None] * len(made))]
        self._size = len(skeleton)
        self._made = made
        self._whole = [True] * self._size + [False] * len(made)
        for number, contents in enumerate(made, self._size):
            self._shell(number, contents)

    def _shell(self, number: int, contents: Any) -> None:
        """Make an object whose contents may follow later."""
        kind = contents[0]
        if kind == "object":
            made: Any = _class(contents[1], contents[2])
            self._objects[number] = made.__new__(made)
        elif kind in _SHELLS:
            self._objects[number] = _SHELLS[kind](contents)
        else:
            return
        self._whole[number] = True

    def _value(self, told: Any) -> Any:
        if type(told) is not list:
            return told
        head = told[0]
        if type(head) is int:
            return self._object(head)
        match head:
            case "symbol":
                return Symbol(told[1])
            case "robot":
                return Robot(told[1])
            case "int":
                return int(told[1])
            case "member":
                return _class(told[1], told[2], enum.Enum)[told[3]]  # type: ignore[index]
            case "class":
                return _class(told[1], told[2])
            case _:
                raise GraphMismatchError(f"it holds a value of the unknown kind {head!r}")

    def _object(self, number: int) -> Any:
        if not self._whole[number]:
            self._objects[number] = self._fixed(self._made[number - self._size])
            self._whole[number] = True
        return self._objects[number]

    def _fixed(self, contents: Any) -> Any:
        """Make an object that never changes. Nested ones are told first, so that the recursion is as deep as they."""
        kind = contents[0]
        match kind:
            case "tuple":
                return tuple([self._value(item) for item in contents[1]])
            case "record":
                made: Any = _class(contents[1], contents[2], tuple)
                return tuple.__new__(made, [self._value(item) for item in contents[3]])
            case "frozenset":
                return frozenset([self._value(item) for item in contents[1]])
            case "range":
                return range(*contents[1:])
            case "method":
                return _method(self._value(contents[1]), contents[2])
            case "function":
                return named(contents[1], contents[2])
            case "view":
                return types.MappingProxyType(self._value(contents[1]))
            case "generated":
                function = self._functions.function(contents[1])
                if function is None:
                    raise GraphMismatchError(f"it names a function {contents[1]} that the program does not have")
                return function
            case _:
                raise GraphMismatchError(f"it holds an object of the unknown kind {kind!r}")

    def fill(self, changed: list[Any]) -> None:
        """Give all objects their contents: attributes first, for the hashes of keys depend on them."""
        all_told = [*changed, *enumerate(self._made, self._size)]
        for wanted in (("object",), ("list", "deque", "bytearray", "random", "cell"), ("dict", "ordered", "set")):
            for number, contents in all_told:
                if contents[0] in wanted:
                    self._fill(self._object(number), contents)

    def _fill(self, thing: Any, contents: Any) -> None:
        match contents[0]:
            case "object":
                for name, told in contents[3]:
                    _set_attribute(thing, name, told, self._value)
            case "list":
                thing[:] = [self._value(item) for item in contents[1]]
            case "deque":
                thing.clear()
                thing.extend([self._value(item) for item in contents[2]])
            case "bytearray":
                thing[:] = contents[1]
            case "random":
                thing.setstate((contents[1], tuple(contents[2]), contents[3]))
            case "cell":
                thing.cell_contents = self._value(contents[1])
            case "dict" | "ordered":
                flat = contents[1]
                thing.clear()
                for place in range(0, len(flat), 2):
                    thing[self._value(flat[place])] = self._value(flat[place + 1])
            case "set":
                thing.clear()
                thing.update([self._value(item) for item in contents[1]])
            case unknown:
                raise GraphMismatchError(f"it holds an object of the unknown kind {unknown!r}")


_SHELLS: Final[dict[str, Callable[[Any], Any]]] = {
    "list": lambda _: [],
    "dict": lambda _: {},
    "ordered": lambda _: OrderedDict(),
    "set": lambda _: set(),
    "deque": lambda contents: deque(maxlen=contents[1]),
    "bytearray": lambda _: bytearray(),
    "random": lambda _: Random(0),
}


def _set_attribute(thing: Any, name: str, told: Any, value: Callable[[Any], Any]) -> None:
    setter = object.__setattr__ if "__mypyc_attrs__" not in type(thing).__dict__ else setattr
    if told != UNSET:
        setter(thing, name, value(told))
    elif hasattr(thing, name):
        object.__delattr__(thing, name)


def named(module: str, name: str) -> Any:
    """Return the class or function that a module of rmr defines so. Raises GraphMismatchError.

    Not what it imports: by names such as `os.system` a crafted file could have any command executed.
    """
    if not module.startswith(PACKAGE):
        raise GraphMismatchError(f"it names {module}.{name}, which is not of rmr")
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None) if part in getattr(found, "__dict__", ()) else None
        if found is None:
            raise GraphMismatchError(f"it names {module}.{name}, which is not there")
        if not isinstance(found, (type, types.FunctionType)) or found.__module__ != module:
            raise GraphMismatchError(f"it names {module}.{name}, which is not defined there")
    return found


def _method(owner: Any, name: str) -> Any:
    """Return a method bound to `owner`. Raises GraphMismatchError for any other attribute."""
    found = None if name.startswith("__") else getattr(owner, name, None)
    if getattr(found, "__self__", None) is not owner or not callable(found):
        raise GraphMismatchError(f"it names a method {name} of a {type(owner).__qualname__}, which has none")
    return found


def _class(module: str, name: str, base: type = object) -> type:
    found = named(module, name)
    if not isinstance(found, type) or not issubclass(found, base):
        raise GraphMismatchError(f"it takes {module}.{name} for a class")
    return found
