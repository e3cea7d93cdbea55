"""A run for Foxglove and Lichtblick, live: the channels of its recording over a WebSocket.

The protocol is Foxglove's (github.com/foxglove/ws-protocol), under both names that programs ask for. The server tells
each client the channels with their schemas; a client subscribes to some, and only what it has subscribed to is built
and sent. A client that is too slow loses its oldest messages and is told their number; nobody waits for it.

All clients see the same instant. A recording begins when the first client subscribes, and begins anew after the last
one has left.
"""

import asyncio
import json
import logging
import os
import re
import signal
import struct
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from socket import SO_SNDBUF, SOL_SOCKET, create_server, socket
from time import monotonic
from typing import Any, Final, Protocol

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.typing import Origin, Subprotocol

from rmr.base.time import in_seconds, seconds
from rmr.entry import ExitCode
from rmr.record.channels import CHANNELS, schema_of
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import RUN_FILE, GrowingRecording, Message, RawMessage, Recording, open_recording

# ---- what the Foxglove server sends, and when: a recording played from its begin, or a run under way as it is recorded
#
# A feed is asked again and again for the messages that are due at an instant of wall time, in order of lab time.
# Their contents are built by the server, and only for channels that somebody has subscribed to.

LAG_S = 1.5
"""A run under way is shown so much later than it happens: its files grow once a second."""
LATE_S = 3.0
"""A run under way that is shown so much too late, because its lab time is faster than time, is caught up with."""
LATCHED = frozenset({"/scene", "/floor"})
"""Channels written once: who comes later needs the newest message nevertheless."""


class FoxgloveFeed(Protocol):
    """A source of messages."""

    recording: Recording
    waits: bool
    """Whether it stands still while nobody watches."""
    over: bool
    """Whether nothing will be due any more."""

    def due(self, wall_s: float) -> Iterator[Message | RawMessage]:
        """Yield what has become due at `wall_s`, seconds of a clock that never goes back."""

    def rewind(self) -> None:
        """Begin anew with the next call, where that is possible."""


class RecordedFeed:
    """A recording, played from its begin."""

    def __init__(self, recording: Recording, speed: float) -> None:
        """`speed` is lab time over wall time."""
        self.recording = recording
        self.waits = True
        self._speed = speed
        self.rewind()

    def rewind(self) -> None:
        """Begin anew with the next call."""
        self.over = False
        self._began_s: float | None = None
        self._messages = self.recording.raw_messages()
        self._next = next(self._messages, None)

    def due(self, wall_s: float) -> Iterator[RawMessage]:
        """Yield what has become due; the first call begins."""
        if self._began_s is None:
            self._began_s = wall_s
        now = self.recording.span[0] + seconds((wall_s - self._began_s) * self._speed)
        while self._next is not None and self._next.at <= now:
            message = self._next
            self._next = next(self._messages, None)
            yield message
        self.over = self._next is None


class LiveFeed:
    """The recording of a run under way, a little later than it is written."""

    def __init__(self, folder: Path) -> None:
        """Raise RecordingError while there is no file that can be read."""
        self._growing = GrowingRecording(folder)
        self.recording: Recording = self._growing
        self.waits = False
        self._run_file = folder / RUN_FILE
        self._waiting: deque[Message] = deque()
        self._looked_s: float | None = None
        self._offset_s: float | None = None
        """Wall time less lab time of what is due."""
        self.over = False

    def rewind(self) -> None:
        """Go on: nothing of a run under way is shown twice."""

    def due(self, wall_s: float) -> Iterator[Message]:
        """Yield what has become due."""
        # Period with which the files of a run under way are looked at.
        if self._looked_s is None or wall_s - self._looked_s >= 0.2:
            self._looked_s = wall_s
            self._look(wall_s)
        while self._waiting and in_seconds(self._waiting[0].at) <= wall_s - (self._offset_s or 0.0):
            yield self._waiting.popleft()

    def _look(self, wall_s: float) -> None:
        ended = self._run_file.exists()  # looked for first: what was written before it is in the news
        news = self._growing.news()
        if news:
            newest_s = in_seconds(max(message.at for message in (*self._waiting, *news)))
            if self._offset_s is None:  # what was before this began is not shown
                news = [each for each in news if in_seconds(each.at) >= newest_s - LATE_S or each.topic in LATCHED]
            self._waiting = deque(sorted((*self._waiting, *news), key=lambda message: message.at))
            if self._offset_s is None or newest_s - (wall_s - self._offset_s) > LATE_S:
                self._offset_s = wall_s - newest_s + LAG_S
        self.over = ended and not news and not self._waiting


HOST: Final = "127.0.0.1"
PORT: Final = 8765
"""The port that Foxglove proposes."""
SUBPROTOCOLS: Final = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
ORIGINS: Final = (
    None,
    Origin("file://"),
    re.compile(r"https://([a-z]+\.)?foxglove\.dev"),
    re.compile(r"https?://(localhost|127\.0\.0\.1)(:\d+)?"),
)
"""Pages whose scripts may connect: Foxglove's, and those of this machine; programs that are no browser name none."""
ADVERTISED: Final = tuple(channel for channel in CHANNELS if channel.encoding == "json")
"""Channels that Foxglove can show; the number of a channel is its place here."""
NUMBERS: Final = {channel.topic: number for number, channel in enumerate(ADVERTISED)}
PERIOD_S: Final = 0.02
"""Period with which messages that have become due are sent."""
CLIENTS_MAX: Final = 100
QUEUE_MAX: Final = 500
"""Messages that wait for a client at most, a second of 50 robots or more."""
TEXTS_MAX: Final = 100
"""Answers that wait for a client at most: one that asks and does not read gets no more."""
SUBSCRIPTIONS_MAX: Final = 1_000
"""Subscriptions of a client at most."""
WARNING: Final = 1
TRY_AGAIN_LATER: Final = 1013


class FoxgloveClient:
    """One connection."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.channels: dict[int, int] = {}
        """Subscription -> channel."""
        self.dropped = 0
        """Messages dropped since the client was told last."""
        self._texts: deque[str] = deque()
        self._queue: deque[bytes] = deque()
        self._filled = asyncio.Event()

    def tell(self, text: str) -> None:
        """Queue a message of the protocol, which goes before data."""
        if len(self._texts) < TEXTS_MAX:
            self._texts.append(text)
        self._filled.set()

    def put(self, octets: bytes) -> None:
        """Queue data; of too much the oldest is dropped."""
        if len(self._queue) >= QUEUE_MAX:
            self._queue.popleft()
            self.dropped += 1
        self._queue.append(octets)
        self._filled.set()

    async def send_all(self) -> None:
        """Send what is queued, for ever."""
        while True:
            await self._filled.wait()
            while self._texts or self._queue:
                await self.connection.send(self._texts.popleft() if self._texts else self._queue.popleft())
            self._filled.clear()
            if self.dropped:
                self.tell(_status(f"{self.dropped} messages were dropped: the connection is too slow"))
                self.dropped = 0


class FoxgloveServer:
    """The server of one run."""

    def __init__(self, feed: FoxgloveFeed, clock: Callable[[], float] = monotonic) -> None:
        """`clock` returns wall time, seconds; it never goes back."""
        self._feed = feed
        self._clock = clock
        self._clients: list[FoxgloveClient] = []
        self._latest: dict[str, Message | RawMessage] = {}
        self._now = 0
        self._over_told = False

    async def run(self, sock: socket) -> None:
        """Serve on a listening socket until cancelled."""
        # Octets that the system holds for a client: with its own choice, megabytes, a slow client would be far behind.
        sock.setsockopt(SOL_SOCKET, SO_SNDBUF, 1 << 17)
        # Connections that fail or are refused are no matter for the terminal.
        options: Any = {
            "subprotocols": SUBPROTOCOLS,
            "origins": ORIGINS,
            "max_size": 1 << 16,  # octets of a client's request
            "compression": None,
            "logger": logging.Logger("rmr.foxglove", logging.CRITICAL),
        }
        async with serve(self._serve, sock=sock, **options):
            told = self._clock()
            while True:
                await asyncio.sleep(PERIOD_S)
                self._send_due()
                if self._clock() - told >= 0.1:  # period with which clients are told the time
                    told = self._clock()
                    for client in self._clients:
                        client.put(struct.pack("<BQ", 2, self._now))

    # -- clients -------------------------------------------------------------------------------------------------

    async def _serve(self, connection: ServerConnection) -> None:
        if len(self._clients) >= CLIENTS_MAX:
            await connection.close(TRY_AGAIN_LATER, f"{CLIENTS_MAX} clients are connected already")
            return
        client = FoxgloveClient(connection)
        client.tell(json.dumps(self._server_info()))
        client.tell(json.dumps({"op": "advertise", "channels": _advertised()}))
        self._clients.append(client)
        sending = asyncio.create_task(client.send_all())
        try:
            async for request in connection:
                self._take(client, request)
        except ConnectionClosed:
            pass  # without a farewell
        finally:
            sending.cancel()
            with suppress(asyncio.CancelledError, ConnectionClosed):
                await sending
            self._clients.remove(client)
            if not self._watched:
                self._feed.rewind()
                self._over_told = False

    def _server_info(self) -> dict[str, Any]:
        about = self._feed.recording.about
        name = f"rmr: {about.lab}, {about.mode}, seed {about.seed}"
        return {"op": "serverInfo", "name": name, "capabilities": ["time"], "supportedEncodings": [], "metadata": {}}

    @property
    def _watched(self) -> bool:
        return any(client.channels for client in self._clients)

    def _take(self, client: FoxgloveClient, request: str | bytes) -> None:
        """Carry out a client's request; one that is wrong gets an answer and changes nothing."""
        try:
            wanted = json.loads(request)
            operation = wanted["op"]
            if operation == "subscribe":
                self._subscribe(client, {int(each["id"]): int(each["channelId"]) for each in wanted["subscriptions"]})
            elif operation == "unsubscribe":
                for subscription in wanted["subscriptionIds"]:
                    client.channels.pop(int(subscription), None)
            else:
                client.tell(_status(f"this server does not know the operation {operation!r:.40}"))
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            client.tell(_status(f"that request cannot be read: {type(error).__name__}: {error!s:.80}"))

    def _subscribe(self, client: FoxgloveClient, wanted: Mapping[int, int]) -> None:
        for subscription, channel in wanted.items():
            if not 0 <= channel < len(ADVERTISED) or not 0 <= subscription < 1 << 32:
                client.tell(_status(f"there is no channel {channel}, or {subscription} is no number of a subscription"))
            elif len(client.channels) >= SUBSCRIPTIONS_MAX:
                client.tell(_status(f"{SUBSCRIPTIONS_MAX} subscriptions are the most"))
            else:
                client.channels[subscription] = channel
                latest = self._latest.get(ADVERTISED[channel].topic)
                if latest is not None:
                    client.put(_data(subscription, latest.at, _octets(latest)))

    # -- messages ------------------------------------------------------------------------------------------------

    def _send_due(self) -> None:
        if self._feed.waits and not self._watched:
            return
        for message in self._feed.due(self._clock()):
            self._now = message.at
            if message.topic in LATCHED:
                self._latest[message.topic] = message
            number = NUMBERS.get(message.topic)
            subscribed = [(c, s) for c in self._clients for s, channel in c.channels.items() if channel == number]
            if subscribed and number is not None:
                octets = _octets(message)
                for client, subscription in subscribed:
                    client.put(_data(subscription, message.at, octets))
        if self._feed.over and not self._over_told:
            self._over_told = True
            for client in self._clients:
                client.tell(_status("the run is over; to see a recording again, close the connection and open it", 0))


def serve_foxglove(path: Path, *, live: bool, port: int | None = None, speed: float = 1.0) -> int:
    """Serve the run in `path` until Ctrl-C; return the exit code.

    A `live` one is followed, where `path` is its folder; a recording is played, `speed` times as fast as it was.
    """
    try:
        feed: FoxgloveFeed = LiveFeed(path) if live else RecordedFeed(open_recording(path), speed)
        sock = create_server((HOST, PORT if port is None else port))
    except RecordingError as error:
        print(f"rmr view: {error}", file=sys.stderr)
        return ExitCode.INVALID
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        print(f"rmr view: port {PORT if port is None else port}: {why}; name another one: --port", file=sys.stderr)
        return ExitCode.FAILED
    for problem in feed.recording.problems:
        print(f"rmr view: {problem}", file=sys.stderr)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        print(f"for Foxglove or Lichtblick, open the connection: ws://{HOST}:{sock.getsockname()[1]}", flush=True)
        asyncio.run(FoxgloveServer(feed).run(sock))
    return ExitCode.OK


def _octets(message: Message | RawMessage) -> bytes:
    return message.octets if isinstance(message, RawMessage) else json.dumps(message.data).encode()


def _data(subscription: int, at: int, octets: bytes) -> bytes:
    return struct.pack("<BIQ", 1, subscription, at) + octets


def _status(message: str, level: int = WARNING) -> str:
    return json.dumps({"op": "status", "level": level, "message": message})


def _advertised() -> list[dict[str, Any]]:
    channels = []
    for number, channel in enumerate(ADVERTISED):
        encoding, schema = schema_of(channel.topic)
        named = {"id": number, "topic": channel.topic, "encoding": channel.encoding, "schemaName": channel.schema}
        channels.append({**named, "schema": schema.decode(), "schemaEncoding": encoding})
    return channels
