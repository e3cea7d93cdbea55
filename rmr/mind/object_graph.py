"""The state of all objects that are reachable from a root, as octets, and back into a root that was made anew.

A *skeleton* is the graph of a root that has just been made. Construction is a function of configuration and program, so
two skeletons have the same objects in the same order, in any process of the same version: an object of one is known by
its number in the other. A *graph state* is what has changed since: the contents of skeleton objects that are others
now, and the objects that have been made meanwhile. To restore it, the contents are written into the objects of a new
skeleton, which keep their identity; functions, closures and ports are those of the new skeleton.

    value       None, bool, int, float, str, bytes as they are; all else is a list that begins with its kind:
                [number] of an object, or Symbol, Robot, member of an enumeration, class, large integer, unset attribute
    object      kind and contents (`_CONTENTS`)

The octets are msgpack. Reading them makes objects of classes of `rmr` only, by `__new__` without arguments, and sets
their attributes; it calls nothing else, and imports nothing. What cannot be told in this way (a generator, a function
made meanwhile, a class of another package) raises UnsavedError with its path, and no state is written.

The walk asks each object for its attributes, items and closure cells. So the state is complete by construction: no part
of a robot has to list what it keeps.
"""

import enum
import gc
import types
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from random import Random
from typing import Any, Final
from zlib import crc32

import msgpack  # type: ignore[import-untyped]

from rmr.base.values import INT_MIN, Robot, Symbol
from rmr.mind.graph_restoration import PACKAGE, UNSET, GeneratedFunctions, GraphMismatchError, Restoration, named

_ATOMS: Final = (type(None), bool, float, str, bytes)
_CONTAINERS: Final = (tuple, list, dict, set, frozenset, deque, bytearray, str, int, float, bytes, Random)
"""Types whose subclasses hold more than their attributes."""
_LEAF: Final = ["leaf"]


class UnsavedError(Exception):
    """The state cannot be told; the message says which object is the reason, and by which path it is reached."""


def _pack(data: Any) -> bytes:
    packed: bytes = msgpack.packb(data, strict_types=True, unicode_errors="surrogatepass")
    return packed


class GraphWalk:
    """Numbers the objects that are reachable from a root, in the order in which they are found."""

    def __init__(
        self,
        leaves: Iterable[object],
        opaque: tuple[type, ...],
        functions: GeneratedFunctions,
        before: "GraphWalk | None" = None,
    ) -> None:
        """Neither `leaves` nor instances of `opaque` are looked into. Objects of `before` keep their numbers."""
        self._leaves = {id(leaf): leaf for leaf in leaves if leaf is not None}
        self._opaque = opaque
        self.functions = functions
        self.numbers: dict[int, int] = {} if before is None else dict(before.numbers)
        self.objects: list[Any] = [] if before is None else list(before.objects)
        self._found_in: list[int] = [] if before is None else list(before._found_in)
        """The object in which each was found first."""
        self._reached: set[int] = set()
        self._queue: deque[int] = deque()
        self._present = -1
        """The object whose contents are being told."""
        self._slots: dict[type, tuple[str, ...]] = {}

    def told(self, root: object) -> Iterator[tuple[int, Any]]:
        """Yield number and contents of each object that is reachable from `root`. Raises UnsavedError."""
        self.value(root)
        while self._queue:
            number = self._queue.popleft()
            yield number, self.contents(number)

    # -- values -------------------------------------------------------------------------------------------------

    def value(self, value: Any) -> Any:
        """Return `value` as plain data; an object that is new gets a number."""
        kind = type(value)
        if kind in _ATOMS:
            return value
        if kind is int:
            return value if INT_MIN <= value < 1 << 64 else ["int", str(value)]
        if kind is Symbol:
            return ["symbol", str(value)]
        if kind is Robot:
            return ["robot", int(value)]
        if isinstance(value, enum.Enum):
            return ["member", kind.__module__, kind.__qualname__, value.name]
        if isinstance(value, type):
            return ["class", value.__module__, value.__qualname__]
        number = self.numbers.get(id(value))
        if number is None:
            number = len(self.objects)
            self.numbers[id(value)] = number
            self.objects.append(value)
            self._found_in.append(self._present)
        if number not in self._reached:
            self._reached.add(number)
            self._queue.append(number)
        return [number]

    def contents(self, number: int) -> Any:
        """Return the contents of an object as plain data. Raises UnsavedError."""
        self._present = number
        thing = self.objects[number]
        kind = type(thing)
        if id(thing) in self._leaves or isinstance(thing, (*self._opaque, types.ModuleType)):
            return _LEAF
        tell = _CONTENTS.get(kind)
        if tell is not None:
            return tell(self, thing)
        if isinstance(thing, tuple) and hasattr(kind, "_fields"):
            return ["record", kind.__module__, kind.__qualname__, [self.value(item) for item in thing]]
        of_rmr = any(base.__module__.startswith(PACKAGE) for base in kind.__mro__[:2])
        if of_rmr and not isinstance(thing, _CONTAINERS):  # a class may be made at run time
            told = [self._attribute(thing, name) for name in self.slots(thing)]
            return ["object", kind.__module__, kind.__qualname__, told]
        raise UnsavedError(f"{self.path(number)} is a {kind.__module__}.{kind.__qualname__}, which has no form on disk")

    def slots(self, thing: Any) -> tuple[str, ...]:
        """Return the names of the attributes of an object, sorted."""
        kind = type(thing)
        names = self._slots.get(kind)
        if names is None:
            names = self._slots[kind] = slots_of(kind)
        return names if not hasattr(thing, "__dict__") else tuple(sorted({*names, *thing.__dict__}))

    def _attribute(self, thing: Any, name: str) -> Any:
        try:
            return [name, self.value(getattr(thing, name))]
        except AttributeError:
            return [name, UNSET]

    def path(self, number: int) -> str:
        """Return how an object is reached, in words."""
        names: list[str] = []
        while number >= 0 and len(names) < 12:
            names.append(type(self.objects[number]).__name__)
            number = self._found_in[number]
        return " of ".join(names)

    def items(self, things: Iterable[Any]) -> list[Any]:
        """Return items as plain data."""
        return [self.value(thing) for thing in things]


def slots_of(kind: type) -> tuple[str, ...]:
    """Return the names of the slots of a class and its bases, sorted; of a compiled class its attributes."""
    names: set[str] = set()
    for base in kind.__mro__:
        slots = base.__dict__.get("__slots__", ())
        names.update([slots] if isinstance(slots, str) else slots)
        names.update(base.__dict__.get("__mypyc_attrs__", ()))
    return tuple(sorted(names - {"__dict__", "__weakref__"}))


# -- contents by type -------------------------------------------------------------------------------------------


def _in_order(things: Iterable[Any]) -> list[Any]:
    """Return the items of a set in an order that is the same in each process."""
    return sorted(things, key=repr)


def _dict(walk: GraphWalk, thing: Any) -> Any:
    flat: list[Any] = []
    for key, value in thing.items():
        flat.append(walk.value(key))
        flat.append(walk.value(value))
    return ["dict" if type(thing) is dict else "ordered", flat]


def _random(_: GraphWalk, thing: Random) -> Any:
    version, numbers, gauss = thing.getstate()
    return ["random", version, list(numbers), gauss]


def _method(walk: GraphWalk, thing: Any) -> Any:
    owner = thing.__self__
    if owner is None or isinstance(owner, types.ModuleType):
        return _function(walk, thing)
    return ["method", walk.value(owner), thing.__name__]


def _function(walk: GraphWalk, thing: Any) -> Any:
    if type(thing) is types.FunctionType and (name := walk.functions.name_of(thing)) is not None:
        return ["generated", name]
    cells = getattr(thing, "__closure__", None) or ()
    module = getattr(thing, "__module__", None) or ""
    return ["function", module, thing.__qualname__, walk.items(cells)]


def _cell(walk: GraphWalk, thing: Any) -> Any:
    try:
        return ["cell", walk.value(thing.cell_contents)]
    except ValueError:
        return ["cell", UNSET]


_CONTENTS: Final[dict[type, Callable[[GraphWalk, Any], Any]]] = {
    tuple: lambda walk, thing: ["tuple", walk.items(thing)],
    list: lambda walk, thing: ["list", walk.items(thing)],
    dict: _dict,
    OrderedDict: _dict,
    set: lambda walk, thing: ["set", walk.items(_in_order(thing))],
    frozenset: lambda walk, thing: ["frozenset", walk.items(_in_order(thing))],
    deque: lambda walk, thing: ["deque", thing.maxlen, walk.items(thing)],
    bytearray: lambda _, thing: ["bytearray", bytes(thing)],
    range: lambda _, thing: ["range", thing.start, thing.stop, thing.step],
    Random: _random,
    types.CellType: _cell,
    types.MethodType: _method,
    types.BuiltinMethodType: _method,
    types.FunctionType: _function,
    types.MappingProxyType: lambda walk, thing: ["view", walk.value(gc.get_referents(thing)[0])],
}
_FIXED: Final = ("tuple", "record", "frozenset", "range", "method", "function", "view", "generated", "leaf")
"""Kinds whose contents never change."""


class Skeleton:
    """The graph of a root that has just been made."""

    def __init__(
        self, root: object, leaves: Iterable[object], opaque: tuple[type, ...], functions: GeneratedFunctions
    ) -> None:
        """Raise UnsavedError if it holds what has no form on disk."""
        self._leaves = tuple(leaves)
        self._opaque = opaque
        self._root = root
        self._functions = functions
        self._walk = walk = GraphWalk(self._leaves, opaque, functions)
        self._initial: list[bytes] = []
        crc = 0
        for _, contents in walk.told(root):
            self._initial.append(_pack(contents))
            crc = crc32(_pack(_shape(contents)), crc)
        self.size = len(self._initial)
        """Number of objects."""
        self.digest = crc
        """Check sum of the objects' kinds and classes, in their order."""

    def state(self) -> bytes:
        """Return what has changed since the skeleton was made, as octets. Raises UnsavedError."""
        walk = GraphWalk(self._leaves, self._opaque, self._functions, self._walk)
        changed: list[Any] = []
        made: dict[int, Any] = {}
        for number, contents in walk.told(self._root):
            if number >= self.size:
                if contents[0] in ("leaf", "cell") or (contents[0] == "function" and not _is_named(walk, number)):
                    raise UnsavedError(f"{walk.path(number)} was made meanwhile and has no form on disk")
                made[number] = contents
            elif _pack(contents) != self._initial[number]:
                if contents[0] in _FIXED:
                    raise UnsavedError(f"{walk.path(number)} is another one than at the begin")
                changed.append([number, contents])
        return _pack([self.size, self.digest, changed, [made[number] for number in sorted(made)]])

    def restore(self, data: bytes) -> None:
        """Bring the root to the state in `data`. Raises GraphMismatchError; then the root is of no use."""
        try:
            size, digest, changed, made = msgpack.unpackb(data, unicode_errors="surrogatepass", strict_map_key=False)
        except Exception as error:
            raise GraphMismatchError(f"it is no msgpack of a state ({error})") from None
        if (size, digest) != (self.size, self.digest):
            raise GraphMismatchError("it is of a robot that is put together in another way")
        try:
            Restoration(self._walk.objects[:size], made, self._functions).fill(changed)
        except GraphMismatchError:
            raise
        except Exception as error:
            raise GraphMismatchError(f"it does not fit ({type(error).__name__}: {error})") from None


def _is_named(walk: GraphWalk, number: int) -> bool:
    """Return whether a module of rmr has the function under its name."""
    function = walk.objects[number]
    try:
        return named(getattr(function, "__module__", None) or "", function.__qualname__) is function
    except GraphMismatchError:
        return False


def _shape(contents: Any) -> Any:
    """Return what two processes agree in: kind, class, and the numbers of the objects that are held."""
    if contents[0] == "object":
        return contents[:3] + [name for name, _ in contents[3]]
    if contents[0] == "record":
        return contents[:3]
    return contents[:1] if contents[0] != "function" else contents[:3]
