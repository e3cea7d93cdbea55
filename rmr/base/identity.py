"""Memoisation by object identity, for functions of large immutable objects.

Many robots of one process run one program, and most data derived from it is equal for all. The program itself is no
key: comparing and hashing it would traverse all of it.
"""

from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

REMEMBERED_MAX: Final = 8
"""Size of the cache; a process seldom uses more than two programs at a time."""

K = TypeVar("K")
V = TypeVar("V")


class ByIdentity(Generic[K, V]):
    """A function of one object with a cache of its newest results."""

    def __init__(self, work_out: Callable[[K], V]) -> None:
        self._work_out = work_out
        self._known: deque[tuple[K, V]] = deque(maxlen=REMEMBERED_MAX)

    def __call__(self, key: K) -> V:
        """Return the function's result for `key`; a cached key gives the same result object."""
        for known, value in self._known:
            if known is key:
                return value
        value = self._work_out(key)
        self._known.append((key, value))
        return value
