"""What the Foxglove server sends, and when: a recording played from its begin, or a run under way as it is recorded.

A feed is asked again and again for the messages that are due at an instant of wall time, in order of lab time. Their
contents are built by the server, and only for channels that somebody has subscribed to.
"""

from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from rmr.base.time import in_seconds, seconds
from rmr.record.growing_recording import GrowingRecording
from rmr.record.recording import RUN_FILE, Message, RawMessage, Recording

LAG_S = 1.5
"""A run under way is shown so much later than it happens: its files grow once a second."""
LATE_S = 3.0
"""A run under way that is shown so much too late, because its lab time is faster than time, is caught up with."""
LATCHED = frozenset({"/scene", "/floor"})
"""Channels written once: who comes later needs the newest message nevertheless."""
LOOK_S = 0.2
"""Period with which the files of a run under way are looked at."""


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
        if self._looked_s is None or wall_s - self._looked_s >= LOOK_S:
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
