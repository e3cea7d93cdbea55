"""What is worked out of a large immutable object once and shared by all who hold that very object.

Many robots of one process run one program, and most of what a robot needs to know of it is the same for all. The
program itself is no key: comparing and hashing it means to walk all of it.
"""

from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

REMEMBERED_MAX: Final = 8
"""Objects remembered; a process seldom has to do with more than two programs at a time."""

K = TypeVar("K")
V = TypeVar("V")


class ByIdentity(Generic[K, V]):
    """A function of one object, remembered for the newest objects that it was called with."""

    def __init__(self, work_out: Callable[[K], V]) -> None:
        self._work_out = work_out
        self._known: deque[tuple[K, V]] = deque(maxlen=REMEMBERED_MAX)

    def __call__(self, key: K) -> V:
        """Return what the function makes of `key`; the same object for the same one."""
        for known, value in self._known:
            if known is key:
                return value
        value = self._work_out(key)
        self._known.append((key, value))
        return value
