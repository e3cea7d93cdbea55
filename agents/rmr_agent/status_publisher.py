"""How a robot tells its state with its part of the report, however large that has become.

A part of a few kilobytes goes along with every status. A larger one would take time from the robot's frames, so it is
told as often as `REPORT_OCTETS_PER_S` allows, and with the last status in any case. What does not fit a message in
parts is left out list by list, which the report says.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rmr.bus import wire
from rmr.bus.message_parts import TooLargeError
from rmr.bus.session import Bus

REPORT_OCTETS_PER_S = 1 << 20
"""A robot spends about one per cent of its time on a report of that length each second."""

LISTS = ("actions", "assertions", "facts", "goals", "schedules")
"""Fields of the report that grow without bound, in the order in which they are left out."""

EMPTY: dict[str, Any] = {"goals": {"achieved": [], "open": []}}
"""What stands in place of a field that is no list."""


class StatusPublisher:
    """Tells one robot's statuses."""

    def __init__(self, bus: Bus, warn: Callable[[str], None]) -> None:
        """`warn` takes a sentence for people."""
        self._bus = bus
        self._warn = warn
        self._report_due_s = 0.0

    async def tell(self, key: str, status: wire.Status, report: Callable[[], dict[str, Any]]) -> None:
        """Publish `status`, with what `report` returns where that is due."""
        now_s = time.monotonic()
        if now_s < self._report_due_s and not status.final:
            self._bus.publish(key, status)
            return
        octets = await self._tell_all(key, status, report())
        self._report_due_s = now_s + octets / REPORT_OCTETS_PER_S

    async def _tell_all(self, key: str, status: wire.Status, report: dict[str, Any]) -> int:
        left_out: list[str] = []
        for name in ("", *LISTS):
            if name and not report.get(name):
                continue
            if name:
                left_out.append(name)
                report = report | {name: EMPTY.get(name, []), "left_out": left_out}
                self._warn(f"the report failed to fit a message; left out of it: {', '.join(left_out)}")
            with suppress(TooLargeError):
                return await self._bus.publish_whole(key, status._replace(report=report))
        return await self._bus.publish_whole(key, status)
