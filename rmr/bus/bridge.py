"""The inbox between zenoh's threads, which fill it, and the event loop, which drains it.

zenoh calls back on threads of its own. The callback appends to a deque, with the instant of arrival, and wakes the
loop where that is due. The loop drains in batches: a burst costs one wake-up, and other work runs between batches.

A wake-up costs more than the handling of most messages. Hence *patient* messages (low priority): a `PreciseLoop` polls
its inbox whenever it wakes for any cause, and a patient message waits for that, `PATIENCE` at most; it causes no
wake-up of its own where a timer is due within that time. After a poll that found something the loop sleeps no longer
than `PATIENCE`. So a stream of patient messages costs one wake-up for each `PATIENCE`, and a single one after a
silence is taken at once.
"""

import asyncio
import ctypes
import selectors
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rmr.base.time import NEVER, NS_PER_S, TICK_HZ, Duration

INBOX_MAX = 8192
"""Capacity of an inbox. A process that was stopped for seconds finds the newest items; older ones are lost, and
the gap in their numbers is counted (`rmr.bus.wire`)."""

BATCH_MAX = 256
"""Items taken before other work on the loop has its turn."""

PATIENCE: Duration = 2 * NS_PER_S // TICK_HZ
"""Delay of a patient message at most: two frames. A robot that drives polls once a frame anyway. For one that stands it
is well below the transmission time that coordination allows (90 ms: the frozen zone less a lease and two clock
errors)."""

Take = Callable[[Any, int], None]
"""Takes an item and the monotonic instant, in ns, at which it arrived."""


class Sleep(selectors.SelectSelector):
    """The selector of a loop: publishes until when the loop sleeps, and polls the inbox when it wakes."""

    def __init__(self) -> None:
        super().__init__()
        self.until: int = 0
        """The monotonic instant at which it ends by itself; 0 while the loop is awake."""
        self.inbox: Inbox | None = None

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Sleep until a descriptor is ready, a timer is due, or the inbox must be polled."""
        inbox = self.inbox
        if inbox is None or (timeout is not None and timeout <= 0):
            return super().select(timeout)
        if inbox.lively and (timeout is None or timeout * NS_PER_S > PATIENCE):
            timeout = PATIENCE / NS_PER_S
        # Order matters: publish `until` before the inbox is read. An item put after the read then finds the loop asleep
        # and wakes it; with the order reversed it would wait for the end of the sleep.
        self.until = NEVER if timeout is None else time.monotonic_ns() + round(timeout * NS_PER_S)
        found = super().select(0 if inbox.waiting else timeout)
        self.until = 0
        inbox.poll()
        return found


class PreciseLoop(asyncio.SelectorEventLoop):
    """An event loop with timers that are precise to microseconds, which polls its inbox whenever it wakes.

    The usual loop on Linux waits in whole milliseconds, rounded up: a radio that assesses the channel and turns around
    within 320 us would always announce its frames too late. The number of descriptors that `select` can watch (1,024)
    is no matter here: the bus has its own.
    """

    def __init__(self) -> None:
        self.sleep = Sleep()
        super().__init__(self.sleep)


class Inbox:
    """Items from any thread, handed to their takers on the event loop, in the order of arrival."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._items: deque[tuple[Take, Any, int]] = deque(maxlen=INBOX_MAX)
        self._awake = False
        self._sleep: Sleep | None = None
        if isinstance(loop, PreciseLoop):
            self._sleep = loop.sleep
            loop.sleep.inbox = self
        self.lively = False
        """Whether the last poll found something."""
        self.overflowed = 0
        """Items that were pushed out by newer ones."""

    @property
    def waiting(self) -> bool:
        """Whether there is something to take."""
        return bool(self._items)

    def put(self, take: Take, item: Any, patience: Duration = 0) -> None:
        """Hand `item` to `take`, on the loop, soon, or within `patience`. May be called on any thread."""
        if len(self._items) == INBOX_MAX:
            self.overflowed += 1
        arrived = time.monotonic_ns()
        self._items.append((take, item, arrived))
        sleep = self._sleep
        if not self._awake and (sleep is None or sleep.until > arrived + patience):
            self._awake = True
            try:
                self._loop.call_soon_threadsafe(self._drain)
            except RuntimeError:  # the loop is closed: the process is ending
                self._items.clear()

    def poll(self) -> None:
        """Take what is there on the loop's next round. Called on the loop."""
        self.lively = bool(self._items)
        if self._items and not self._awake:
            self._awake = True
            self._loop.call_soon(self._drain)

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


_known = threading.local()


def keep_thread() -> None:
    """Make Python keep the thread state of the calling thread, which Python did not start; else each call makes one.

    A callback on a thread of zenoh begins with the making of a thread state and ends with its freeing, 16 KiB of
    memory mapped and unmapped, which takes longer than the callback itself. Ensured once more than released, it stays.
    """
    if not hasattr(_known, "kept"):
        _known.kept = True
        ctypes.pythonapi.PyGILState_Ensure()
