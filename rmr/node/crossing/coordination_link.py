"""What the coordination core says and hears: its frames to the radio, in their time, and its events to the crossings.

The core dates each frame, so that robots that tick on one grid do not all speak at once; a frame that is not due
yet waits here.
"""

import heapq
from collections.abc import Callable
from typing import Final

from rmr.base.time import Instant
from rmr.coord.coordination import Coordination
from rmr.coord.events import CoordEvent, Send
from rmr.node.ports import Confirmed

UNCONFIRMED_MAX: Final = 256
"""Frames whose outcome the radio still owes; beyond that the oldest are forgotten."""

Transmit = Callable[[bytes, int | None], int]
"""Hands a payload for a destination (None: broadcast) to the radio and returns the radio's handle."""


class CoordLink:
    """Joins one coordination core to the radio."""

    def __init__(self, core: Coordination, transmit: Transmit, handle: Callable[[Instant, CoordEvent], None]) -> None:
        """`handle` gets the events of the core."""
        self.core = core
        self._transmit = transmit
        self._handle = handle
        self._handles: dict[int, int] = {}
        """The radio's handle -> the core's."""
        self._later: list[tuple[Instant, int, Send]] = []
        self._sequence = 0

    @property
    def next_wake(self) -> Instant:
        """When the core or a frame is due."""
        wake = self.core.next_wake
        later = self._later
        return later[0][0] if later and later[0][0] < wake else wake

    def due(self, now: Instant) -> bool:
        """Return whether `run` has something to do."""
        core = self.core
        later = self._later
        return core.next_wake <= now or core.has_news or bool(later and later[0][0] <= now)

    def run(self, now: Instant) -> None:
        """Let the core do what is `due`, and see to what it says."""
        self.core.wake(now)
        for out in self.core.drain():
            if not isinstance(out, Send):
                self._handle(now, out)
            elif out.at > now:
                self._sequence += 1
                heapq.heappush(self._later, (out.at, self._sequence, out))
            else:
                self._send(out)
        while self._later and self._later[0][0] <= now:
            self._send(heapq.heappop(self._later)[2])

    def _send(self, out: Send) -> None:
        handle = self._transmit(out.payload, out.destination)
        if out.handle:
            self._handles[handle] = out.handle
            if len(self._handles) > UNCONFIRMED_MAX:
                del self._handles[next(iter(self._handles))]

    def awaits(self, outcome: Confirmed) -> bool:
        """Return whether the outcome is that of a frame of the core's."""
        return outcome.handle in self._handles

    def confirm(self, now: Instant, outcome: Confirmed) -> None:
        """Hand the core the outcome of a frame, if it is one of its own."""
        handle = self._handles.pop(outcome.handle, None)
        if handle is not None:
            self.core.confirmed(now, handle, outcome.status)
