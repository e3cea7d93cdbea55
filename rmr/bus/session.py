"""One session on the bus for each process: a star around a router, no scouting.

The router is the world, or one of several that are joined, a host each (`rmr router`, or a zenohd).

Rules, each bought by a measurement:

- Congestion control is always DROP: with BLOCK one stopped robot froze all others for seconds.
- Never `express`: it loses messages under load.
- Callbacks run on zenoh's own threads and only fill the inbox: an indirect callback costs a thread of its own and
  hangs at exit.
- Everything is undeclared before the session is closed.
- No process forks once a session is open.

A stopped process counts as gone after a lease of three seconds. A client whose router has gone sees every liveliness
token vanish, so a watcher of liveliness checks `Bus.connected` before it takes a robot for dead. zenoh reconnects by
itself and declares again what was declared; before the first connection `open_when_there` retries.

`Bus` is used on the event loop alone.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh.handlers import Callback

from rmr.bus import wire
from rmr.bus.certificates import Certificate, Credentials
from rmr.bus.checks import MalformedError
from rmr.bus.endpoint import BusError
from rmr.bus.keys import sender_place
from rmr.bus.line import Handler, Line, Listener, check_sender
from rmr.bus.losses import Losses
from rmr.bus.message_parts import cut
from rmr.bus.middleware import (
    RETRY_FIRST_MS,
    RETRY_MAX_MS,
    NobodyThereError,
    NotAdmittedError,
    close_without_waiting,
    open_client,
    open_router,
)

EXCESS_MAX = 16
"""Senders with messages beyond their rate that a process tells of."""

Answer = Callable[[wire.Envelope, int], wire.Message | None]
"""Takes a query and the monotonic instant (ns) of its arrival; returns the reply, or None for no reply."""

REFUSED_PATIENCE_S = 2.0
"""Time for which a refused client retries: a router that is starting or ending refuses for a moment."""


def open_bus(
    sender: int, *, listen: str | None = None, connect: str | None = None, secret: Credentials | None = None
) -> "Bus":
    """Open the process's session: a router at `listen`, or else a client of the router at `connect`.

    `sender` is written into every message. With a `secret` a router lets in only clients that know it, and a client
    uses only a router that does; with a certificate in its place, those that have one of the same CA. Must run on the
    event loop. Raises BusError (a bad endpoint, an address in use), `NobodyThereError` when no router answers at
    `connect` and `NotAdmittedError` when it does not let this client in.
    """
    if listen is not None:
        return Bus(Line(open_router(listen, (), secret)), sender, is_client=False)
    assert connect is not None, "a client has a router"
    line = Line(open_client(connect, secret), keyed=isinstance(secret, Certificate))
    return Bus(line, sender, is_client=True)


async def open_when_there(
    sender: int, connect: str, waiting: Callable[[], None], secret: Credentials | None = None
) -> "Bus":
    """Open a client's session as soon as a router answers; `waiting` is called after each failed attempt.

    Raises NotAdmittedError when the router has refused it for `REFUSED_PATIENCE_S`.
    """
    tries = 0
    pause_ms = RETRY_FIRST_MS
    refused_s = None
    while True:
        try:
            return open_bus(sender, connect=connect, secret=secret)
        except NotAdmittedError:
            now_s = time.monotonic()
            refused_s = now_s if refused_s is None else refused_s
            if now_s - refused_s >= REFUSED_PATIENCE_S:
                raise
            await asyncio.sleep(0.4)  # pause between the attempts of a refused client
            continue
        except NobodyThereError:
            refused_s = None
            waiting()
        await asyncio.sleep(pause_ms / 1000)
        tries += 1
        # Attempts with the first pause before it doubles: processes that start together connect without delay.
        if tries > 50:
            pause_ms = min(2 * pause_ms, RETRY_MAX_MS)


async def watch_admission(bus: "Bus", connect: str, secret: Credentials | None, refused: Callable[[str], None]) -> None:
    """Call `refused` with the reason, once, whenever a router that has come back does not let this client in again.

    zenoh reconnects by itself, but does not report a refusal: the world may have been restarted with another
    secret. Ends only when it is cancelled.
    """
    refusals = 0
    admitted_by = bus.router
    while True:
        await asyncio.sleep(REFUSED_PATIENCE_S)
        router = bus.router
        # One that came back may let a revoked certificate in, and deny it everything.
        if bus.connected and (router == admitted_by or not isinstance(secret, Certificate)):
            refusals = 0
            continue
        try:
            (await asyncio.to_thread(open_client, connect, secret)).close()
            admitted_by = router
        except NotAdmittedError as error:
            refusals += 1
            if refusals == 2:  # refusals in a row after which a client that has lost its router is notified
                refused(str(error))
        except BusError:
            refusals = 0


class Bus:
    """An open session: publish, subscribe, query, reply, liveliness."""

    def __init__(self, line: Line, sender: int, *, is_client: bool) -> None:
        self.is_client = is_client
        """Whether its router is another process."""
        self._line = line
        self._session = line.session
        self._inbox = line.inbox
        self._sender = sender
        self._publishers: dict[str, Any] = {}
        self._numbers: dict[str, int] = {}
        self._declared: list[Any] = []
        self._serial = 0
        """Number of messages that were sent in parts."""
        self._transports = 0
        self._closed = False
        self.losses = Losses()
        """Counts of the received messages that were lost or malformed."""
        self.on_transport: Callable[[bool], None] | None = None
        """Called when the first transport comes up and when the last one has gone."""
        self._counts = line.join() == 1
        listener = line.session.info.declare_transport_events_listener(line.callback(self._transport), history=True)
        self._declared.append(listener)

    def seat(self, sender: int) -> "Bus":
        """Return the bus of another sender over the same session, to be closed like this one.

        What one of them publishes reaches the others that listen on that very key, too.
        """
        return Bus(self._line, sender, is_client=self.is_client)

    @property
    def run(self) -> int:
        """The random number of this session, as its messages carry it."""
        return self._line.run

    @property
    def keyed(self) -> bool:
        """Whether certificates prove who speaks on it."""
        return self._line.keyed

    @property
    def excess(self) -> list[list[int]]:
        """[sender, messages of it that were dropped beyond its rate], those with most; a process's first seat tells."""
        dropped = self._line.rates.dropped if self._counts else {}
        most = sorted(dropped.items(), key=lambda each: (-each[1], each[0]))
        return [list(each) for each in most[:EXCESS_MAX]]

    @property
    def router(self) -> str:
        """The id of the router that this client is connected to; empty when there is none."""
        return next(map(str, self._session.info.routers_zid()), "")

    def go_on_as(self, run: int) -> None:
        """Speak under the number of an earlier session, before anything is sent: that of a world that goes on."""
        self._line.run = run

    @property
    def connected(self) -> bool:
        """Whether any transport is up."""
        return self._transports > 0

    def _transport(self, event: Any, _arrived: int) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            close_without_waiting()
        before = self._transports
        self._transports += 1 if event.kind == zenoh.SampleKind.PUT else -1
        if (before > 0) != (self._transports > 0) and self.on_transport and not self._closed:
            self.on_transport(self.connected)

    def _envelope(self, key: str, body: wire.Message) -> wire.Envelope:
        number = self._numbers[key] = self._numbers.get(key, 0) + 1
        return wire.Envelope(self._sender, self.run, number, body)

    def publish(self, key: str, body: wire.Message) -> None:
        """Send `body` to the subscribers of `key`. Never blocks; a congested connection loses the message."""
        if self._closed:
            return
        message = self._envelope(key, body)
        self._publisher(key).put(wire.encode(*message))
        self._line.hand_round(self, key, message)

    async def publish_whole(self, key: str, body: wire.Message) -> int:
        """Send `body`, in parts if it is too large to travel as one; return its length in octets.

        Parts reach those that subscribe to `key` for whole messages. A pause between two parts keeps the connection
        from congestion and lets other tasks run. Raises TooLargeError.
        """
        if self._closed:
            return 0
        message = wire.Envelope(self._sender, self.run, 0, body)  # its parts are numbered, the whole is not
        data = wire.encode(*message)
        if len(data) <= wire.PART_OCTETS_MAX:
            message = self._envelope(key, body)
            self._publisher(key).put(wire.encode(*message))
        else:
            self._serial += 1
            for part in cut(data, self._serial):
                if self._closed:
                    break
                self._publisher(key).put(wire.encode(*self._envelope(key, part)))
                # Pause between the parts of a large message: 24 MB/s at most, which the middleware's queue takes
                # without loss.
                await asyncio.sleep(0.002)
        self._line.hand_round(self, key, message)
        return len(data)

    def _publisher(self, key: str) -> Any:
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._publishers[key] = self._session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.DROP, express=False
            )
        return publisher

    def retire(self, key: str) -> None:
        """Free the publisher of `key`. The message numbers continue if something is published there again."""
        if key in self._publishers and not self._closed:
            self._publishers.pop(key).undeclare()

    def _decode(self, payload: Any, key: str = "", place: int = 0) -> wire.Envelope | None:
        """Return the message in `payload`; None if it is none, or not of the sender that `key` names at `place`."""
        try:
            message = wire.decode(payload.to_bytes())
            if place:
                check_sender(key, place, message.sender)
        except MalformedError as error:
            self.losses.drop(error)
            return None
        return message

    def subscribe(self, key: str, handler: Handler, *, whole: bool = False) -> Callable[[], None]:
        """Hand every message on `key` (wild cards allowed) to `handler`; not this session's own.

        Messages in parts are put together for those that want them `whole`, and else dropped.
        Returns the call that withdraws the subscription: nothing more is handed on, not even what has arrived.
        """
        expression = zenoh.KeyExpr(key)
        end = self._line.listen(key, Listener(self, handler, whole))

        def withdraw() -> None:
            end()
            self.losses.forget(expression.includes)

        return withdraw

    def _withdrawal(self, declared: Any) -> Callable[[], None]:
        """Return the call that undeclares `declared`; it may be called again."""

        def withdraw() -> None:
            if declared in self._declared and not self._closed:
                self._declared.remove(declared)
                declared.undeclare()

        return withdraw

    def serve(self, key: str, answer: Answer) -> None:
        """Reply to queries on `key` with what `answer` returns; one that ends with a wild card, under what is asked."""
        place = sender_place(key)

        def take(query: Any, arrived: int) -> None:
            asked = str(query.key_expr)
            message = None if self._closed or query.payload is None else self._decode(query.payload, asked, place)
            reply = None if message is None else answer(message, arrived)
            if reply is not None:
                own = key.removesuffix("*") + asked.rpartition("/")[2] if key.endswith("/*") else key
                query.reply(own, wire.encode(*self._envelope(f"{own}?", reply)))
            query.drop()

        self._declared.append(self._session.declare_queryable(key, self._line.asked(key, take), complete=True))

    async def ask(self, key: str, body: wire.Message, timeout_s: float) -> list[tuple[wire.Envelope, int]]:
        """Return the replies to `body` of all who serve `key`, each with its instant of arrival (monotonic ns).

        Waits until all have answered, `timeout_s` at most; without an answer the list is empty.
        """
        replies: list[tuple[wire.Envelope, int]] = []
        done = asyncio.get_running_loop().create_future()

        def take(reply: Any, arrived: int) -> None:
            message = None if reply is None or reply.ok is None else self._decode(reply.ok.payload)
            if message is not None:
                replies.append((message, arrived))
            if reply is None and not done.done():
                done.set_result(None)

        put = self._inbox.put
        self._session.get(
            key,
            Callback(lambda reply: put(take, reply), drop=lambda: put(take, None), indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
            congestion_control=zenoh.CongestionControl.DROP,
            express=False,
            payload=wire.encode(*self._envelope(f"{key}?", body)),
        )
        # The end of the replies may be lost where the inbox overflows; hence a limit, of twice the time.
        await asyncio.wait([done], timeout=2 * timeout_s)
        return replies

    def declare_alive(self, key: str) -> Callable[[], None]:
        """Declare the liveliness token `key` of this process; return the call that withdraws it."""
        token = self._session.liveliness().declare_token(key)
        self._declared.append(token)
        return self._withdrawal(token)

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Hand every token on `key` (wild cards allowed) that is there, appears or vanishes to `handler`."""

        def take(sample: Any, _arrived: int) -> None:
            if not self._closed:
                handler(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        callback = self._line.callback(take)
        self._declared.append(self._session.liveliness().declare_subscriber(key, callback, history=True))

    def close(self) -> None:
        """Undeclare everything; with the last sender of the session close that. May be called again."""
        if self._closed:
            return
        self._closed = True
        self._line.leave(self, [*self._publishers.values(), *reversed(self._declared)])
