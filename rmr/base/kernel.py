"""The virtual-time kernel: a heap of calls (SimPy's way).

Calls due at the same instant run by priority, then in the order in which they were made, so that a run is one
fixed sequence. A call may be superseded: `Alarm` keeps one pending call per owner and moves it.
"""

import heapq
from collections.abc import Callable
from typing import Final

from rmr.base.time import NEVER, Instant

EVENT: Final = -1
AIR: Final = 0
RADIO: Final = 1
ROBOT: Final = 2
"""Priorities of calls at one instant, in this order: interventions from outside (EVENT), ends of transmissions (AIR),
timers of radios (RADIO), robots (ROBOT)."""


class Kernel:
    """The event queue: calls in the order of instant, priority and sequence."""

    def __init__(self) -> None:
        self.now: Instant = 0
        self._heap: list[tuple[Instant, int, int, Callable[[Instant], None]]] = []
        self._sequence = 0

    def at(self, when: Instant, priority: int, call: Callable[[Instant], None]) -> None:
        """Schedule `call(now)` at `when`; a past instant counts as the present one."""
        self._sequence += 1
        heapq.heappush(self._heap, (when if when > self.now else self.now, priority, self._sequence, call))

    @property
    def due(self) -> Instant:
        """The instant of the next call; NEVER if there is none."""
        return self._heap[0][0] if self._heap else NEVER

    def step(self) -> None:
        """Run the next call; the queue must not be empty."""
        self.now, _, _, call = heapq.heappop(self._heap)
        call(self.now)

    def run_until(self, limit: Instant) -> None:
        """Run every call due before or at `limit`, and advance to `limit`."""
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
        """Reschedule the call to `when`; NEVER cancels it."""
        if when == self.when:
            return
        self.when = when
        if when < NEVER:
            self._kernel.at(when, self._priority, self._ring)

    def _ring(self, now: Instant) -> None:
        # Lazy deletion: superseded entries stay in the heap and are ignored when they come up.
        if now >= self.when:
            self.when = NEVER
            self._call(now)
