"""The virtual-time kernel: a heap of calls (SimPy's way).

Calls due at the same instant run by priority, then in the order in which they were made, so that a run is one
fixed sequence. A call may be superseded: `Alarm` keeps one pending call per owner and moves it.
"""

import heapq
from collections.abc import Callable

from rmr.base.time import NEVER, Instant

EVENT = -1
AIR = 0
RADIO = 1
ROBOT = 2
"""Priorities: what is done to the run from outside, then what ends on the air, then what radios do of themselves, then
what robots make of it."""


class Kernel:
    """Runs calls in the order of their instants."""

    def __init__(self) -> None:
        self.now: Instant = 0
        self._heap: list[tuple[Instant, int, int, Callable[[Instant], None]]] = []
        self._sequence = 0

    def at(self, when: Instant, priority: int, call: Callable[[Instant], None]) -> None:
        """Make `call(now)` at `when`; what is due already is made at the present instant."""
        self._sequence += 1
        heapq.heappush(self._heap, (when if when > self.now else self.now, priority, self._sequence, call))

    @property
    def due(self) -> Instant:
        """When the next call is due; NEVER if there is none."""
        return self._heap[0][0] if self._heap else NEVER

    def step(self) -> None:
        """Make the next call, of which there must be one."""
        self.now, _, _, call = heapq.heappop(self._heap)
        call(self.now)

    def run_until(self, limit: Instant) -> None:
        """Make every call due before or at `limit`."""
        heap = self._heap
        while heap and heap[0][0] <= limit:
            self.now, _, _, call = heapq.heappop(heap)
            call(self.now)
        self.now = max(self.now, limit)


class Alarm:
    """One owner's next call: setting it again replaces it."""

    __slots__ = ("_call", "_kernel", "_priority", "when")

    def __init__(self, kernel: Kernel, priority: int, call: Callable[[Instant], None]) -> None:
        self._kernel = kernel
        self._priority = priority
        self._call = call
        self.when: Instant = NEVER

    def set(self, when: Instant) -> None:
        """Ring at `when` instead of whenever it was to ring; NEVER cancels."""
        if when == self.when:
            return
        self.when = when
        if when < NEVER:
            self._kernel.at(when, self._priority, self._ring)

    def _ring(self, now: Instant) -> None:
        if now >= self.when:
            self.when = NEVER
            self._call(now)
