"""What one sender may cause at a receiver: one table of rates, by kind of message, and the counts of what is beyond.

A member of a lab whose key was stolen, or whose program is wrong, says what it may as often as it likes. Each receiver
therefore drops what is beyond the rate of a sender before anything is decoded or waits for the event loop: there the
rest of the lab would wait behind it, and the newest of the inbox pushes out what others have sent.

A bucket of tokens for each sender on a topic: `at_once` messages, refilled with `per_s`. Both are some times what a
robot can send in order, and a receiver that was stopped for seconds finds the messages of seconds at once. Whose a
message is says its key where that names the sender, which the routers' rules bind to a certificate; else the message
says it.
"""

import logging
import time
from typing import Final, NamedTuple

from rmr.base.time import NS_PER_S
from rmr.bus.keys import WORLD, sender_place

log = logging.getLogger("rmr")


class Rate(NamedTuple):
    """The messages of one sender and kind that a receiver takes."""

    per_s: int
    at_once: int
    """Beyond that rate, after a silence."""
    reason: str


RATES: Final[dict[str, Rate]] = {
    "radio": Rate(600, 3000, "a frame with its backoff takes 1.7 ms of the air at least; one of a load takes 4.3 ms"),
    "call": Rate(600, 3000, "as radio: each is a frame that is announced a second time"),
    "act": Rate(240, 1000, "a robot decides 60 times a second"),
    "sense": Rate(240, 1000, "a body is sensed 60 times a second"),
    "status": Rate(600, 1000, "two a second, but a long report in parts of 48 KiB, one each 2 ms"),
    "load": Rate(2000, 2000, "an operator sends four fragments each 2 ms"),
    "clock": Rate(20, 60, "a robot asks for lab time five times at once, and again each half second"),
    "map": Rate(10, 30, "a robot asks for its place four times a second"),
    "disturbances": Rate(100, 200, "rmr load asks 20 times a second until lab time runs; all operators are one sender"),
    "silence": Rate(20, 60, "a person asks"),
    "stop": Rate(20, 60, "a person asks"),
    "hosts": Rate(200, 400, "each launcher once a second, rmr logs for 128 KiB at a time; all are one sender"),
    "truth": Rate(30, 120, "the world tells of all poses ten times a second"),
    "other": Rate(20, 60, "nothing else is said often"),
}
"""Kind of message -> the bound, and why it is enough."""

SENDERS_MAX: Final = 1024
"""Senders on one topic that are told apart: more than any lab has robots; all beyond share one bucket."""

NOBODY: Final = -3
"""A sender that could not be read, and all beyond `SENDERS_MAX`."""


def kind_of(key: str) -> str:
    """Return the kind of the messages on `key`, a row of `RATES`."""
    chunks = key.split("/")
    kind = chunks[-1] if chunks[2:3] in (["body"], ["ops"]) else chunks[2] if len(chunks) > 2 else ""
    return kind if kind in RATES else "other"


def claimed_sender(data: bytes) -> int:
    """Return who `data` says has sent it, without decoding it: the second item of a msgpack array.

    No other spelling of the number than that of `rmr.bus.wire.encode` is read, so that nobody has two.
    """
    head = data[2:5]
    if not head or not 0x90 <= data[0] <= 0x9F:
        return NOBODY
    if head[0] < 0x80:
        return head[0]
    if head[0] >= 0xE0:
        return head[0] - 0x100
    if head[0] == 0xCC and len(head) > 1 and head[1] >= 0x80:
        return head[1]
    if head[0] == 0xCD and len(head) > 2 and head[1]:
        return head[1] << 8 | head[2]
    return NOBODY


class _Bucket:
    __slots__ = ("at", "tokens")

    def __init__(self, at: int, tokens: float) -> None:
        self.at = at
        self.tokens = tokens


class Rates:
    """The bounds of one receiver, and what it has dropped. Used on the threads of the middleware."""

    def __init__(self) -> None:
        self.dropped: dict[int, int] = {}
        """Number of messages beyond the bounds, by sender."""

    def bounded(self, topic: str) -> "Bound":
        """Return the bound of what is received on `topic` (wild cards allowed).

        Each topic has its own: the world speaks to each of the robots of a process.
        """
        return Bound(self, kind_of(topic), sender_place(topic))

    def drop(self, sender: int, kind: str) -> None:
        """Count a message that is dropped; the first one of a sender is told."""
        if sender not in self.dropped:
            log.warning("%s", told(sender, kind))
        self.dropped[sender] = self.dropped.get(sender, 0) + 1


class Bound:
    """The bound of one topic. A race of two threads costs a token."""

    __slots__ = ("_buckets", "_kind", "_place", "_rates")

    def __init__(self, rates: Rates, kind: str, place: int) -> None:
        self._rates = rates
        self._kind = kind
        self._place = place
        self._buckets: dict[int, _Bucket] = {}

    def admits(self, key: object, data: bytes) -> bool:
        """Return whether the message `data` on `key` is to be taken."""
        sender = _named(str(key), self._place) if self._place else claimed_sender(data)
        return self.takes(sender, time.monotonic_ns())

    def takes(self, sender: int, now: int) -> bool:
        """Return whether one more message of `sender` is within the bound at this monotonic instant (ns)."""
        rate = RATES[self._kind]
        bucket = self._buckets.get(sender)
        if bucket is None:
            if len(self._buckets) >= SENDERS_MAX and sender != NOBODY:
                return self.takes(NOBODY, now)
            bucket = self._buckets[sender] = _Bucket(now, rate.at_once)
        refilled = bucket.tokens + (now - bucket.at) * rate.per_s / NS_PER_S
        bucket.at = now
        bucket.tokens = min(refilled, rate.at_once)
        if bucket.tokens < 1:
            self._rates.drop(sender, self._kind)
            return False
        bucket.tokens -= 1
        return True


def told(sender: int, kind: str) -> str:
    """Return that `sender` says more of a kind than is taken, for people."""
    rate = RATES[kind]
    return (
        f"{sender_name(sender)} sends more than {rate.per_s} {kind} messages a second: what is beyond is dropped; its "
        "program is wrong, or somebody has its keys"
    )


def sender_name(sender: int) -> str:
    """Return who a sender is, for people."""
    return {-1: "the world", -2: "an operator", NOBODY: "somebody without a name"}.get(sender, f"robot {sender}")


def _named(key: str, place: int) -> int:
    """Return the sender that `key` names at a place from the end."""
    text = key.rsplit("/", 2)[place]
    if text == WORLD:
        return -1
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 5 else NOBODY
