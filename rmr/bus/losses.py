"""Counters of messages that the middleware lost and of malformed ones, kept apart from radio loss."""

from collections.abc import Callable
from typing import Final

from rmr.bus.checks import MalformedError
from rmr.bus.wire import Envelope

STREAMS_MAX: Final = 4096
"""Bound of the streams whose last number a `Losses` keeps: more than senders times keys of one process."""

LOST_MAX: Final = 1 << 53
"""Greatest value of `Losses.lost`: forged numbers must not add up to a count that no message can carry."""


class Losses:
    """Counts what the middleware lost: gaps in the numbers of each sender's messages on each key."""

    def __init__(self) -> None:
        self.lost = 0
        self.repeated = 0
        """Messages whose number was not above the last one: repeated or overtaken."""
        self.malformed = 0
        self.malformed_last = ""
        """What was wrong with the last malformed message."""
        self._streams: dict[tuple[str, int], tuple[int, int]] = {}

    def note(self, key: str, message: Envelope) -> None:
        """Take note of a message that arrived. The first of a stream, or of a sender's new run, sets its origin."""
        stream = (key, message.sender)
        run, number = self._streams.get(stream, (None, 0))
        if run != message.run:
            if run is None and len(self._streams) >= STREAMS_MAX:
                return
        elif message.number <= number:
            self.repeated += 1
            return
        else:
            self.lost = min(LOST_MAX, self.lost + message.number - number - 1)
        self._streams[stream] = (message.run, message.number)

    def drop(self, error: MalformedError) -> None:
        """Count a message that is malformed."""
        self.malformed += 1
        self.malformed_last = str(error)

    def forget(self, on: Callable[[str], bool]) -> None:
        """Forget the streams of the keys `on` holds for: what is sent without a subscription is not lost."""
        self._streams = {stream: last for stream, last in self._streams.items() if not on(stream[0])}
