"""From zenoh's threads to the event loop: an inbox that is filled by one side and drained by the other.

zenoh calls back on threads of its own. The callback does nothing but append to a deque, with the instant of
arrival, and wake the loop if it is not awake yet; the loop drains in batches, so that a burst costs one wake-up
and other work gets its turn between batches.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import Any

INBOX_MAX = 8192
"""Items that wait for the loop. A process that is stopped for seconds finds the newest; older ones are lost, and
their numbers are missing (`rmr.bus.wire`)."""

BATCH_MAX = 256
"""Items taken before other work on the loop has its turn."""

Take = Callable[[Any, int], None]
"""Takes an item and the monotonic instant, in ns, at which it arrived."""


class Inbox:
    """Items from any thread, handed to their takers on the event loop, in the order of arrival."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._items: deque[tuple[Take, Any, int]] = deque(maxlen=INBOX_MAX)
        self._awake = False
        self.overflowed = 0
        """Items that were pushed out by newer ones."""

    def put(self, take: Take, item: Any) -> None:
        """Hand `item` to `take`, on the loop, soon. May be called on any thread."""
        if len(self._items) == INBOX_MAX:
            self.overflowed += 1
        self._items.append((take, item, time.monotonic_ns()))
        if not self._awake:
            self._awake = True
            try:
                self._loop.call_soon_threadsafe(self._drain)
            except RuntimeError:  # the loop is closed: the process is ending and nobody listens
                self._items.clear()

    def _drain(self) -> None:
        self._awake = False  # before looking: what is appended from now on wakes the loop again
        for _ in range(BATCH_MAX):
            if not self._items:
                return
            take, item, arrived = self._items.popleft()
            take(item, arrived)
        if self._items and not self._awake:
            self._awake = True
            self._loop.call_soon(self._drain)
