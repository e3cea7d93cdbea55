"""The receive filter of a station, above the physical layer: destination, security, duplicates.

Both hosts of a station share it (`rmr.radio.station` by time stamps, `rmr.radio.ether` in virtual time). A repeat is
known by its source and sequence number (802.15.4-2006, 7.5.6.2 leaves the rule open; ns-3 has none): it was
acknowledged, the acknowledgement was lost, and it comes again within the time of four attempts.

A secured frame is judged in the order of the standard: filter, acknowledgement (before this module sees the frame),
integrity, frame counter. So an attacker can provoke acknowledgements, but nothing that is not authentic
gets further, nor leaves a trace in what is remembered. A retransmission repeats its frame counter: it is a duplicate
if it is the last frame taken from its source, and within the time of a duplicate; anything else is a replay.
"""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Final

from rmr.base.time import NS_PER_MS, Duration, Instant
from rmr.radio.air import Received
from rmr.radio.frame import BROADCAST, DataFrame, decode
from rmr.radio.security import Security, SecurityError

DUPLICATE_SOURCES_MAX: Final = 1024
"""Sources whose last sequence number is kept; the one that was silent longest is dropped first."""
DUPLICATE_WINDOW: Final[Duration] = 500 * NS_PER_MS
"""A repeat comes within the time of four attempts (170 ms); a sequence number returns after 256 frames."""

decoded = lru_cache(maxsize=256)(decode)
"""`decode` with a cache: in virtual time many stations receive the same octets."""


@dataclass(slots=True)
class Counters:
    """The counters of a station."""

    sent: int = 0
    """Transmissions of data frames, repeats included."""
    acknowledgements: int = 0
    """Transmissions of acknowledgements."""
    withheld: int = 0
    """Acknowledgements not sent because the station transmitted at that time (late announcements only), or was held
    up."""
    received: int = 0
    """Data frames received and handed on."""
    collided: int = 0
    """Frames for this station lost to interference."""
    deaf: int = 0
    """Frames for this station that came while it transmitted."""
    dropped: int = 0
    """Frames for this station lost to noise, or to the losses that the lab asks for."""
    duplicates: int = 0
    """Repeats of a frame received before: acknowledged again, not handed on."""
    malformed: int = 0
    """Frames of octets that are none."""
    forged: int = 0
    """Secured frames whose integrity code is wrong: altered, cut short, or of another key."""
    replayed: int = 0
    """Secured frames with a counter that has passed: repeated by another than their sender, or overtaken."""
    unsecured: int = 0
    """Frames without security, or of another level, where the lab has it; with security where it has none."""
    no_ack: int = 0
    """Requests that were never acknowledged."""
    access_failed: int = 0
    """Requests that found no free channel, no place in the queue or no frame counter."""
    late: int = 0
    """Announcements that arrived after their first symbol: the bus took longer than the turnaround of 192 us, or the
    robot processed them later, since nothing depended on them."""
    blind: int = 0
    """Frames sent into a busy channel, as a late announcement showed afterwards: the cost of lateness."""
    overdue: int = 0
    """Announcements processed, or made, after their reception could be decided; they are decided by their time stamps
    all the same. Most belong to frames without acknowledgement: a robot processes those when it wakes anyway."""

    def add(self, name: str) -> None:
        """Count one of what counter `name` counts."""
        setattr(self, name, getattr(self, name) + 1)

    def as_dict(self) -> dict[str, int]:
        """Return the counters by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


class _Last:
    """The last frame taken from a source."""

    __slots__ = ("end", "sequence")

    def __init__(self) -> None:
        self.sequence = 0
        self.end: Instant = 0


class ReceiveFilter:
    """The receiving side of one station, above the physical layer."""

    __slots__ = ("_last", "_security", "address", "counters", "pan")

    def __init__(self, address: int, pan: int, counters: Counters, security: Security | None = None) -> None:
        self.address = address
        self.pan = pan
        self.counters = counters
        self._security = security
        self._last: dict[int, _Last] = {}

    def concerns(self, frame: DataFrame) -> bool:
        """Whether `frame` is for this station (7.5.6.2, third level of filtering)."""
        return frame.pan == self.pan and frame.destination in (self.address, BROADCAST)

    def take(self, frame: DataFrame, rssi_dbm: float, lqi: int, end: Instant) -> Received | None:
        """Return the reception of a frame that came through and ended at `end`; None if the filter drops it."""
        opened = self._opened(frame, end)
        if opened is None:
            return None
        if self._repeats(opened, end):
            self.counters.duplicates += 1
            return None
        self._remember(opened, end)
        self.counters.received += 1
        return Received(opened.payload, opened.source, opened.destination != BROADCAST, rssi_dbm, lqi, end)

    def _opened(self, frame: DataFrame, end: Instant) -> DataFrame | None:
        """Return `frame` without its security; count what security refuses."""
        if self._security is None:
            if not frame.secured:
                return frame
            self.counters.unsecured += 1
            return None
        try:
            return self._security.open(frame)
        except SecurityError as error:
            repeat = error.reason == "replayed" and self._repeats(frame, end)
            self.counters.add("duplicates" if repeat else error.reason)
            return None

    def _repeats(self, frame: DataFrame, end: Instant) -> bool:
        """Whether the last frame of this source had the same sequence number, within the window of duplicates."""
        last = self._last.get(frame.source)
        return last is not None and last.sequence == frame.sequence and end - last.end < DUPLICATE_WINDOW

    def _remember(self, frame: DataFrame, end: Instant) -> None:
        source = frame.source
        last = self._last.get(source)
        if last is not None:
            del self._last[source]  # moves to the end of the order, which is that of the last reception
        elif len(self._last) >= DUPLICATE_SOURCES_MAX:
            del self._last[next(iter(self._last))]
        self._last[source] = last = last or _Last()
        last.sequence = frame.sequence
        last.end = end
