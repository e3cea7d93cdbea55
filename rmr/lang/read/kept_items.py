"""Items of a text's last version that are items of the next one, for an editor that has a text parsed at each key.

An item is kept if it was read without any report or repair: then nothing but its own tokens decided about it. Of two
versions of a text the beginning and the end are equal; what changed lies between. An item of the equal beginning is the
same node. One of the equal end is made anew with other places, which takes a fifth of the time of parsing it.

The parser asks for a kept item where a token begins that it has read from the text. So a comment or a string that now
reaches over a kept item hides it, and an item before which something was added is parsed again.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import Item, Name, parts


class KeptItem(NamedTuple):
    """An item with its end, which is not that of its node: facts and goals are noted without their full stop."""

    item: Item
    end: int
    """The offset behind its full stop."""


class KeptItems:
    """The items of one file, from one version of its text to the next."""

    def __init__(self) -> None:
        self._text = ""
        self._items: dict[int, KeptItem] = {}
        """Items of the last version by their offsets."""
        self._next: dict[int, KeptItem] = {}
        self._text_next = ""
        self._first_changed = 0
        self._last_changed = 0
        self._shift = 0

    def begin(self, text: str) -> None:
        """Compare the text that is to be parsed now with the last one."""
        old = self._text
        self._first_changed = _common_start(old, text)
        same = _common_end(old, text, min(len(old), len(text)) - self._first_changed)
        self._last_changed = len(text) - same
        self._shift = len(text) - len(old)
        self._text_next = text
        self._next = {}

    def item(self, start: int) -> KeptItem | None:
        """Return the item whose first token begins at `start`, if it is that of the last version."""
        # One equal character more on the side of the change: it decides where a token begins or ends.
        if start > self._last_changed:
            kept = self._items.get(start - self._shift)
            if kept is not None and self._shift:
                kept = KeptItem(_moved(kept.item, self._shift), kept.end + self._shift)
        else:
            kept = self._items.get(start)
            if kept is not None and kept.end >= self._first_changed:
                kept = None
        if kept is not None:
            self._next[start] = kept
        return kept

    def keep(self, start: int, item: Item, end: int) -> None:
        """Take note of an item of this version that has been parsed without any report or repair."""
        self._next[start] = KeptItem(item, end)

    def end(self) -> None:
        """Make this version the last one."""
        self._text = self._text_next
        self._items = self._next


def _common_start(one: str, other: str) -> int:
    """Return how many characters of the beginnings are equal, by bisection: slices compare at the speed of memory."""
    low, high = 0, min(len(one), len(other))
    while low < high:
        middle = (low + high + 1) // 2
        if one[low:middle] == other[low:middle]:
            low = middle
        else:
            high = middle - 1
    return low


def _common_end(one: str, other: str, most: int) -> int:
    low, high = 0, most
    while low < high:
        middle = (low + high + 1) // 2
        if one[len(one) - middle : len(one) - low] == other[len(other) - middle : len(other) - low]:
            low = middle
        else:
            high = middle - 1
    return low


# ---- other places

_MOVERS: dict[type, Callable[[Any, int], Any]] = {}
"""Functions that make a node anew at another place, by node class."""


def _moved(node: Any, by: int) -> Any:
    """Return a node or a tuple of nodes with all places moved by some characters."""
    kind = type(node)
    if kind is tuple:
        return tuple([_moved(each, by) for each in node])
    if node is None:
        return None
    return (_MOVERS.get(kind) or _mover(kind))(node, by)


def _mover(kind: type) -> Callable[[Any, int], Any]:
    """Return the function for a class, made from its fields, as the constructor of a record is (`rmr.base.record`)."""
    if kind is Span:
        values = ["node.file", "node.start + by", "node.end + by"]
    else:
        inner = parts(kind)
        values = [_value(each.name, each.type, each.name in inner) for each in fields(kind)]
    made: dict[str, Any] = {"kind": kind, "Span": Span, "moved": _moved}
    exec(f"def mover(node, by):\n    return kind({', '.join(values)})", made)
    return _MOVERS.setdefault(kind, made["mover"])


def _value(name: str, kind: object, is_node: bool) -> str:
    if kind == Span:
        return f"Span(node.{name}.file, node.{name}.start + by, node.{name}.end + by)"
    return f"moved(node.{name}, by)" if is_node or kind in {Name, Name | None} else f"node.{name}"
