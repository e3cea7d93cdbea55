"""Passes what is new in a run's history to all clients: several times a second, encoded once for all of them.

While nobody is connected only the source is refreshed, and more rarely.
"""

import asyncio
import time
from typing import Any

from rmr_view.page_client import EntryBatch, PageClient, json_text
from rmr_view.run_history import KINDS, Triple
from rmr_view.run_source import RunSource

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
