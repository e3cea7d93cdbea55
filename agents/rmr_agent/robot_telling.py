"""What a robot process tells: its status together with its part of the report, and failures as sentences.

A part of a few kilobytes is sent with every status. A larger one would take time from the robot's frames, so it is sent
at the rate `REPORT_OCTETS_PER_S`, and always with the final status. Where it exceeds a message in parts, whole lists
are left out, and the report names them.
"""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from rmr.bus import wire
from rmr.bus.message_parts import TooLargeError
from rmr.bus.session import Bus
from rmr.node.actions.dispatcher import INTERRUPTED

REPORT_OCTETS_PER_S = 1 << 20
"""A robot spends about one per cent of its time on a report of that length each second."""

LISTS = ("actions", "assertions", "facts", "goals", "schedules")
"""Fields of the report that grow without bound, in the order in which they are left out."""

EMPTY: dict[str, Any] = {"goals": {"achieved": [], "open": []}}
"""What stands in place of a field that is no list."""


class StatusPublisher:
    """Publishes the statuses of one robot."""

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


def failure_words(entry: Mapping[str, Any]) -> str | None:
    """Return the failure that `entry` tells, in words; None if it tells none."""
    match entry.get("what"):
        case "action_ended" if entry["failure"] not in (None, *INTERRUPTED):
            return f"action {entry['action']} failed: {entry['failure']}"
        case "undelivered":
            return f"{entry['predicate']} for robot {entry['destination']} was not delivered: {entry['why']}"
        case "bound_reached":
            return f"more than {entry['bound']} {entry['kept']}: the rest is dropped"
        case "deadline_missed":
            return f"deadline missed: {entry['job']}"
        case "restless":
            return "the program does not become quiescent: some rule is always satisfied"
        case "repeats":
            return f"a goal stays open: {entry['rule']} fires again and again for the same facts"
        case "other_program":
            return f"robot {entry['source']} runs another program: neither understands the other"
        case _:
            return None
