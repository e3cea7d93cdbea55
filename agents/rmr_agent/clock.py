"""Lab time in a robot process: this machine's monotonic clock plus an offset, measured by round trips.

A question leaves at T1 and reaches the world at T2, the answer leaves it at T3 and arrives at T4 (T1 and T4 by
this machine's monotonic clock, T2 and T3 in lab time). As in NTP (RFC 5905, section 8), the offset is
((T2 - T1) + (T3 - T4)) / 2, wrong by at most half the time under way; of the last few samples the one that was
under way for the shortest time stands. A sample that contradicts it by more than both can be wrong means that the
clock has jumped, and replaces them all. Lab time never goes back while the same clock runs.

A world that is stopped, or out of reach, cannot move the robot, and sets its clock back when it goes on. The robot
therefore goes ahead of what it last heard of the world by `AHEAD_MAX` at most and then lets time stand, too.
"""

from collections import deque
from typing import Final, NamedTuple

from rmr.base.time import Duration, Instant, milliseconds

SAMPLES_MAX: Final = 8
"""Samples among which the fastest is chosen (RFC 5905: the clock filter's eight stages)."""

DRIFT_MAX: Final[Duration] = milliseconds(2)
"""What two clocks may drift apart while a sample stands (16 s at 100 ppm, and some)."""

AHEAD_MAX: Final[Duration] = milliseconds(500)
"""How far a robot goes on without hearing of its world: as long as a body does that gets no command."""


class Sample(NamedTuple):
    """One round trip."""

    delay: Duration
    offset: Duration
    """Lab time minus monotonic time."""


class LabClock:
    """Lab time as a function of the monotonic clock."""

    def __init__(self) -> None:
        self.state = "unknown"
        """``unknown`` before the first sample, then one of `rmr.bus.wire.CLOCK_STATES`."""
        self._samples: deque[Sample] = deque(maxlen=SAMPLES_MAX)
        self._offset: Duration = 0
        self._standing: Instant = 0
        self._last: Instant | None = None
        self._heard: Instant | None = None

    @property
    def running(self) -> bool:
        """Whether lab time goes on."""
        return self.state == "running"

    @property
    def delay(self) -> Duration | None:
        """Time under way of the sample that stands; None without one."""
        return min(self._samples).delay if self._samples else None

    def forget(self) -> None:
        """Start afresh with another clock, which may show an earlier time, or stand."""
        self.state = "unknown"
        self._samples.clear()
        self._last = self._heard = None

    def doubt(self) -> None:
        """Believe no sample so far: the clock may have jumped. If it went back, lab time stands until it is up."""
        self._samples.clear()

    def hear(self, stamp: Instant, monotonic: int) -> None:
        """Note, at a monotonic instant, that the world was alive at `stamp`; not later than now, whatever it says."""
        if self.state == "running":
            stamp = min(stamp, monotonic + self._offset)
            self._heard = stamp if self._heard is None else max(self._heard, stamp)

    def sample(self, state: str, asked: int, arrived: Instant, stamp: Instant, received: int) -> None:
        """Take in a round trip: T1 `asked` and T4 `received` monotonic, T2 `arrived` and T3 `stamp` in lab time."""
        if state != self.state:
            self.forget()
            self.state = state
        self._standing = stamp
        if state != "running":
            return
        delay = (received - asked) - (stamp - arrived)
        offset = ((arrived - asked) + (stamp - received)) // 2
        self._add(Sample(max(0, delay), offset))
        self._offset = min(self._samples).offset

    def _add(self, sample: Sample) -> None:
        if self._samples:
            standing = min(self._samples)
            wrong = (sample.delay + standing.delay) // 2 + DRIFT_MAX
            if abs(sample.offset - standing.offset) > wrong:
                self.doubt()
        self._samples.append(sample)

    def at(self, monotonic: int) -> Instant:
        """Return lab time at a monotonic instant: negative before a start that is set for a moment ahead."""
        if self.state != "running":
            return self._standing
        now = monotonic + self._offset
        if self._heard is not None:
            now = min(now, self._heard + AHEAD_MAX)
        if self._last is not None and now < self._last:
            return self._last
        self._last = now
        return now
