"""The queue of one client of the WebSocket: bounded, whatever the client does.

- Poses and the clock: the newest wins. A slow client sees fewer frames of the map, and never an old one.
- Entries of trace, radio and logs: up to `QUEUED_MAX` wait; beyond that all that wait are dropped, and the client gets
  the message `lost` with the instant from which it should fetch them.

What the server sends is compact JSON (`json_text`).
"""

import asyncio
import json
from math import isfinite
from typing import Any, NamedTuple

QUEUED_MAX = 5_000
"""Entries of each kind that wait for a client at most."""


class EntryBatch(NamedTuple):
    """Entries of one kind as a message, which is encoded once for all clients."""

    kind: str
    text: str
    size: int
    """Number of entries."""
    begin_s: float
    """Instant of the oldest one."""


class PageClient:
    """What waits for one client."""

    def __init__(self) -> None:
        self._newest: dict[str, str] = {}
        self._batches: dict[str, list[EntryBatch]] = {}
        self._lost: dict[str, float] = {}
        self._last: list[str] = []
        self._news = asyncio.Event()

    def put_newest(self, kind: str, text: str) -> None:
        """Queue a message that replaces a waiting one of its kind."""
        self._newest[kind] = text
        self._news.set()

    def put_entries(self, batch: EntryBatch) -> None:
        """Queue entries."""
        waiting = self._batches.setdefault(batch.kind, [])
        waiting.append(batch)
        if sum(each.size for each in waiting) > QUEUED_MAX:
            self.put_lost(batch.kind, min(each.begin_s for each in waiting))
            waiting.clear()
        self._news.set()

    def put_lost(self, kind: str, begin_s: float) -> None:
        """Note that the client misses entries of `kind` from `begin_s` on."""
        self._lost[kind] = min(begin_s, self._lost.get(kind, begin_s))
        self._news.set()

    def put_last(self, text: str) -> None:
        """Queue a message that nothing replaces, such as the end of the run."""
        self._last.append(text)
        self._news.set()

    async def next_messages(self) -> list[str]:
        """Return the messages that wait, as soon as there are any."""
        await self._news.wait()
        self._news.clear()
        lost = [json_text({"type": "lost", "kind": kind, "begin_s": at}) for kind, at in self._lost.items()]
        entries = [batch.text for waiting in self._batches.values() for batch in waiting]
        messages = [*self._newest.values(), *entries, *lost, *self._last]
        self._newest.clear()
        self._batches.clear()
        self._lost.clear()
        self._last.clear()
        return messages


def json_text(value: Any) -> str:
    """Return `value` as compact JSON; infinities and NaN become null."""
    try:
        return json.dumps(value, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(value), separators=(",", ":"), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return value
