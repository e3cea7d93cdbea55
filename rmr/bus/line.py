"""The session that the senders of one process share, and the subscriptions on it.

A process that hosts several robots has one session. It has one subscription to a key for all senders that listen on
it, and decodes each message once. zenoh does not deliver a session's own messages, so messages from one of the senders
are handed to the others here, in order of publication, on the next iteration of the loop.
"""

import asyncio
import contextlib
import random
import threading
from collections.abc import Callable
from typing import Any, Final, Protocol

import zenoh
from zenoh.handlers import Callback

from rmr.bus import wire
from rmr.bus.bridge import PATIENCE, Inbox, Take, keep_thread
from rmr.bus.checks import MalformedError
from rmr.bus.keys import WORLD, sender_place
from rmr.bus.losses import Losses
from rmr.bus.message_parts import Unfinished
from rmr.bus.rates import Rates

CLOSE_PATIENCE_S: Final = 1.0
"""Limit for closing the session: zenoh waits for its router while it reconnects, but the process must end."""

Handler = Callable[[str, wire.Envelope], None]
"""Takes a key and the message that came on it."""


class Owner(Protocol):
    """The sender to which a listener belongs."""

    losses: Losses


class Listener:
    """One subscription of a sender to a key."""

    __slots__ = ("handler", "owner", "wanted", "whole")

    def __init__(self, owner: Owner, handler: Handler, whole: bool = False) -> None:
        """`whole`: messages in parts are put together and handed to it; else it does not get them."""
        self.owner = owner
        self.handler = handler
        self.whole = whole
        self.wanted = True


class Line:
    """A session and its listeners. Used on the event loop alone."""

    def __init__(self, session: Any, *, keyed: bool = False) -> None:
        self.session = session
        self.keyed = keyed
        """Whether certificates prove who speaks on it: keys of radio frames say it then."""
        self.inbox = Inbox(asyncio.get_running_loop())
        self.run = random.SystemRandom().getrandbits(48)
        """The random number of this session, as its messages carry it."""
        self.rates = Rates()
        self._topics: dict[str, tuple[Any, list[Listener]]] = {}
        self._unfinished = Unfinished()
        self._senders = 0
        self._leaving: list[threading.Thread] = []

    def join(self) -> int:
        """Count one more sender, and return how many there are: the session is closed with the last one."""
        self._senders += 1
        return self._senders

    def callback(self, take: Take) -> Any:
        """Return the callback that hands an item to `take` on the loop."""
        put = self.inbox.put

        def called(item: Any) -> None:
            keep_thread()
            put(take, item)

        return Callback(called, indirect=False)

    def asked(self, key: str, take: Take) -> Any:
        """Return the callback that hands queries on `key` to `take` on the loop, within the rates of those who ask."""
        put = self.inbox.put
        bound = self.rates.bounded(key)

        def called(query: Any) -> None:
            keep_thread()
            data = b"" if query.payload is None else query.payload.to_bytes()
            if bound.admits(query.key_expr, data):
                put(take, query)
            else:
                query.drop()

        return Callback(called, indirect=False)

    def listen(self, key: str, listener: Listener) -> Callable[[], None]:
        """Hand every message on `key` (wild cards allowed) to `listener`; return the call that ends it."""
        subscriber, listeners = self._topics.get(key, (None, []))
        listeners.append(listener)
        if subscriber is None:
            callback = Callback(self._subscribed(key, self._taker(key, listeners)), indirect=False)
            subscriber = self.session.declare_subscriber(key, callback, allowed_origin=zenoh.Locality.REMOTE)
            self._topics[key] = subscriber, listeners

        def withdraw() -> None:
            if not listener.wanted:
                return
            listener.wanted = False
            listeners.remove(listener)
            if not listeners:
                del self._topics[key]
                subscriber.undeclare()

        return withdraw

    def _subscribed(self, topic: str, take: Take) -> Callable[[Any], None]:
        """Return the callback that hands a sample and its octets to `take`, at once or with others.

        What is beyond the rate of its sender is dropped here, before it takes the place of others' in the inbox.
        """
        put = self.inbox.put
        bound = self.rates.bounded(topic)

        def called(sample: Any) -> None:
            keep_thread()
            data = sample.payload.to_bytes()
            if bound.admits(sample.key_expr, data):
                put(take, (sample, data), PATIENCE if wire.is_patient(data) else 0)

        return called

    def _taker(self, topic: str, listeners: list[Listener]) -> Take:
        place = sender_place(topic)
        unfinished = self._unfinished

        def take(item: tuple[Any, bytes], arrived: int) -> None:
            sample, data = item
            if not listeners or sample.kind != zenoh.SampleKind.PUT:
                return
            # A loss on the shared session is counted once, by its first listener, not by each.
            key = str(sample.key_expr)
            losses = listeners[0].owner.losses
            try:
                message = wire.decode(data)
                if place:
                    check_sender(key, place, message.sender)
                losses.note(key, message, arrived)
                if isinstance(message.body, wire.Part):
                    patient = [listener for listener in listeners if listener.whole]
                    whole = unfinished.add(key, message) if patient else None
                    if whole is not None:
                        hand_on(tuple(patient), key, whole)
                    return
            except MalformedError as error:
                losses.drop(error)
                return
            hand_on(tuple(listeners), key, message)

        return take

    def hand_round(self, sender: Owner, key: str, message: wire.Envelope) -> None:
        """Hand what `sender` publishes on `key` to the others of this process that listen on that very key.

        Where the key says who speaks, these are the listeners to any speaker.
        """
        topic = f"{key.rpartition('/')[0]}/*" if self.keyed and sender_place(key) == -1 else key
        _, listeners = self._topics.get(topic, (None, ()))
        others = tuple([listener for listener in listeners if listener.owner is not sender])
        if others:
            asyncio.get_running_loop().call_soon(hand_on, others, key, message)

    def leave(self, sender: Owner, declared: list[Any]) -> None:
        """Undeclare what `sender` has declared; with the last one close the session, within `CLOSE_PATIENCE_S`."""
        self._senders -= 1
        declared += self._unheard(sender)
        last = self._senders == 0
        leaving = threading.Thread(target=self._undeclare, args=(declared, last), name="bus-close", daemon=True)
        before = self._leaving
        self._leaving = [*self._leaving, leaving]
        leaving.start()
        if last:
            leaving.join(CLOSE_PATIENCE_S)
        elif not any(thread.is_alive() for thread in before):
            self._leaving = [leaving]

    def _unheard(self, gone: Owner) -> list[Any]:
        """End the subscriptions of `gone`; return the subscribers that no sender uses any more."""
        unheard = []
        for key, (_, listeners) in list(self._topics.items()):
            for listener in [one for one in listeners if one.owner is gone]:
                listener.wanted = False
                listeners.remove(listener)
            if not listeners:
                unheard.append(self._topics.pop(key)[0])
        return unheard

    def _undeclare(self, declared: list[Any], last: bool) -> None:
        with contextlib.suppress(zenoh.ZError):
            for one in declared:
                one.undeclare()
            if last:
                for thread in self._leaving[:-1]:
                    thread.join()
                self.session.close()


def check_sender(key: str, place: int, sender: int) -> None:
    """Raise MalformedError for a message of another sender than the robot, or world, that its key names at `place`.

    Routers hold a process with keys to the keys of its robots, but do not read what it says there.
    """
    if key.split("/")[place] != (WORLD if sender == wire.WORLD_ID else str(sender)):
        raise MalformedError("not of the sender whose key it came on")


def hand_on(listeners: tuple[Listener, ...], key: str, message: wire.Envelope) -> None:
    """Hand a message to those of `listeners` whose subscription has not ended."""
    for listener in listeners:
        if listener.wanted:
            listener.handler(key, message)
