"""Counters of messages that the middleware lost and of malformed ones, kept apart from radio loss."""

from collections.abc import Callable
from typing import Final

from rmr.base.time import NS_PER_S
from rmr.bus.checks import MalformedError
from rmr.bus.wire import Envelope

STREAMS_MAX: Final = 4096
"""Bound of the streams whose last number a `Losses` keeps: more than senders times keys of one process."""

SENT_PER_S: Final = 2000
"""Messages that one sender sends on one key in a second, at most: the shortest frame takes half a millisecond."""

SENT_AT_ONCE: Final = 1000
"""Messages beyond that rate: a sender or receiver that was held up sends, or sees, many at once."""


class _Stream:
    """The messages of one sender on one key."""

    __slots__ = ("doubted", "lost", "number", "run", "since")

    def __init__(self, run: int, number: int, since: int) -> None:
        self.run = run
        self.number = number
        """That of the last message."""
        self.since = since
        """Monotonic instant of the first message, ns."""
        self.lost = 0
        self.doubted = -1
        """The newest number that was too great to be believed."""


class Losses:
    """Counts what the middleware lost: gaps in the numbers of each sender's messages on each key.

    A gap is counted only up to what can have been sent since the first message. A greater one is a forged number; only
    if the next message goes on from it, it is the sender's own, and counting begins anew there (as in RFC 3550, A.1).
    """

    def __init__(self) -> None:
        self.lost = 0
        self.repeated = 0
        """Messages whose number was not above the last one: repeated or overtaken."""
        self.malformed = 0
        self.malformed_last = ""
        """What was wrong with the last malformed message."""
        self._streams: dict[tuple[str, int], _Stream] = {}

    def note(self, key: str, message: Envelope, arrived: int) -> None:
        """Take note of a message that arrived at this monotonic instant (ns).

        The first of a stream, or of a sender's new run, sets its origin. Raises MalformedError for a number that cannot
        have been reached yet.
        """
        stream = self._streams.get((key, message.sender))
        if stream is None:
            if len(self._streams) < STREAMS_MAX:
                self._streams[key, message.sender] = _Stream(message.run, message.number, arrived)
        elif stream.run != message.run:
            stream.run = message.run
            stream.number = message.number
        elif message.number <= stream.number:
            self.repeated += 1
        else:
            self._advance(stream, message.number, arrived)

    def _advance(self, stream: _Stream, number: int, arrived: int) -> None:
        gap = number - stream.number - 1
        if gap and stream.lost + gap > SENT_AT_ONCE + SENT_PER_S * (arrived - stream.since) // NS_PER_S:
            if number != stream.doubted + 1:
                stream.doubted = number
                raise MalformedError("a number that its sender cannot have reached yet")
            gap = 0
        stream.lost += gap
        self.lost += gap
        stream.number = number

    def drop(self, error: MalformedError) -> None:
        """Count a message that is malformed."""
        self.malformed += 1
        self.malformed_last = str(error)

    def forget(self, on: Callable[[str], bool]) -> None:
        """Forget the streams of the keys `on` holds for: what is sent without a subscription is not lost."""
        self._streams = {stream: last for stream, last in self._streams.items() if not on(stream[0])}
