"""Passes what is new in a run's history to all clients: several times a second, encoded once for all of them.

While nobody is connected only the source is refreshed, and more rarely. The queue of a client is bounded, whatever the
client does:

- Poses and the clock: the newest wins. A slow client sees fewer frames of the map, and never an old one.
- Entries of trace, radio and logs: up to `QUEUED_MAX` wait; beyond that all that wait are dropped, and the client gets
  the message `lost` with the instant from which it should fetch them.

What the server sends is compact JSON (`json_text`).
"""

import asyncio
import json
import time
from math import isfinite
from typing import Any, NamedTuple

from rmr_view.run_history import KINDS, Triple
from rmr_view.run_source import RunSource

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


PERIOD_S = 0.05
"""Period of the messages while there is a client: half of that of poses."""
BATCH_MAX = 500
"""Entries in one message at most."""


class Broadcast:
    """The clients of one server, and what they have been sent."""

    def __init__(self, source: RunSource) -> None:
        self._source = source
        self.clients: set[PageClient] = set()
        self._sent = dict.fromkeys(KINDS, 0)
        self._poses_at = -1.0
        self._clock: dict[str, Any] = {}
        self._clock_at = 0.0
        self._ended = not source.live
        self._joined = asyncio.Event()
        self._refreshing = asyncio.Lock()
        self._refreshed = 0.0
        self.left_at: float | None = time.monotonic()
        """When the last client has left, on the monotonic clock; None while there is one."""

    def join(self) -> PageClient:
        """Return a new client, which gets the newest poses and the clock at once, and all that is new from now on."""
        client = PageClient()
        if not self.clients:
            self._sent = {kind: self._source.history.count(kind) for kind in KINDS}
        client.put_newest("clock", json_text(self._source.clock.message()))
        client.put_newest("poses", _poses(*self._source.history.newest))
        if self._ended:
            client.put_last(self._end())
        self.clients.add(client)
        self.left_at = None
        self._joined.set()
        return client

    def leave(self, client: PageClient) -> None:
        """Forget a client."""
        self.clients.discard(client)
        if not self.clients:
            self.left_at = time.monotonic()

    async def refresh(self) -> None:
        """Take in what is new in the source, unless that was done a moment ago."""
        async with self._refreshing:
            now = asyncio.get_running_loop().time()
            if now >= self._refreshed + 0.04:  # 25 times a second at most
                self._refreshed = now
                await self._source.refresh()

    async def run(self) -> None:
        """Pass on what is new until it is cancelled."""
        while True:
            await self.refresh()
            if self.clients:
                self._pass_on()
                await asyncio.sleep(PERIOD_S)
                continue
            self._joined.clear()
            try:
                # Period with which the source is refreshed while there is none.
                await asyncio.wait_for(self._joined.wait(), 0.5)
            except TimeoutError:
                continue

    def _pass_on(self) -> None:
        history = self._source.history
        newest = history.newest
        if newest[0] != self._poses_at:
            self._poses_at = newest[0]
            self._put_newest("poses", _poses(*newest))
        self._pass_clock()
        for kind in KINDS:
            for batch in self._batches(kind):
                for client in self.clients:
                    client.put_entries(batch)
        if not self._source.live and not self._ended:
            self._ended = True
            for client in self.clients:
                client.put_last(self._end())

    def _pass_clock(self) -> None:
        message = self._source.clock.message()
        now = asyncio.get_running_loop().time()
        state = {key: value for key, value in message.items() if key not in {"t", "end_s"}}
        known = {key: value for key, value in self._clock.items() if key not in {"t", "end_s"}}
        # While the clock runs it is told every half second.
        if state != known or (message != self._clock and now >= self._clock_at + 0.5):
            self._clock = message
            self._clock_at = now
            self._put_newest("clock", json_text(message))

    def _put_newest(self, kind: str, text: str) -> None:
        for client in self.clients:
            client.put_newest(kind, text)

    def _batches(self, kind: str) -> list[EntryBatch]:
        history = self._source.history
        entries = history.since(kind, self._sent[kind])
        missed = history.count(kind) - self._sent[kind] - len(entries)
        self._sent[kind] += missed + len(entries)
        if missed > 0:
            for client in self.clients:
                client.put_lost(kind, 0.0)
        parts = [entries[first : first + BATCH_MAX] for first in range(0, len(entries), BATCH_MAX)]
        return [
            EntryBatch(kind, json_text({"type": kind, "entries": part}), len(part), min(each["t"] for each in part))
            for part in parts
        ]

    def _end(self) -> str:
        return json_text({"type": "end", "report": self._source.report})


def _poses(t: float, poses: dict[int, Triple], estimates: dict[int, Triple]) -> str:
    return json_text({"type": "poses", "t": round(t, 3), "robots": _rounded(poses), "estimates": _rounded(estimates)})


def _rounded(poses: dict[int, Triple]) -> dict[str, list[float]]:
    return {str(robot): [round(value, 4) for value in pose] for robot, pose in poses.items()}
