"""The load of the radio over time: airtime by kind of frame, repeats, losses, summed up while frames are read."""

from collections.abc import Mapping
from itertools import chain
from typing import Any, TypeVar

BINS_MAX = 240
"""Bins that a picture has room for; of more, two and two become one."""
LOSSES = ("no_ack", "access_failure")
"""Outcomes of a frame that was given up."""


Sum = TypeVar("Sum", int, float)


ACK = "ack"
"""Kind of an acknowledgement; its attempt is that of the frame that it acknowledges."""


class RadioLoad:
    """Sums per bin of time."""

    def __init__(self) -> None:
        self.bin_s = 0.5
        """Width of a bin, seconds."""
        self.airtime: dict[str, dict[int, float]] = {}
        """Seconds on the air, by kind of frame and bin."""
        self.counts: dict[str, dict[int, int]] = {"repeats": {}, **{outcome: {} for outcome in LOSSES}}
        """Repeats, and frames given up, by bin."""
        self.frames = 0

    def add(self, at_s: float, frame: Mapping[str, Any]) -> None:
        """Take in a message of the channel `/frames`; without `start_s` the frame never went on the air."""
        begin = frame["start_s"]
        place = self._bin(at_s if begin is None else begin)
        if begin is not None:
            on_air = self.airtime.setdefault(frame["kind"], {})
            on_air[place] = on_air.get(place, 0.0) + max(0.0, (frame["end_s"] or begin) - begin)
            self.frames += 1
            if frame["attempt"] > 0 and frame["kind"] != ACK:
                self._count("repeats", place)
        if frame["outcome"] in LOSSES:
            self._count(frame["outcome"], place)

    @property
    def bins(self) -> int:
        """Number of bins up to the last one in use."""
        used = [*chain.from_iterable(self.airtime.values()), *chain.from_iterable(self.counts.values())]
        return max(used, default=-1) + 1

    def _count(self, what: str, place: int) -> None:
        self.counts[what][place] = self.counts[what].get(place, 0) + 1

    def _bin(self, at_s: float) -> int:
        while (place := int(max(0.0, at_s) / self.bin_s)) >= BINS_MAX:
            self.bin_s *= 2.0
            self.airtime = {kind: _halved(sums) for kind, sums in self.airtime.items()}
            self.counts = {what: _halved(sums) for what, sums in self.counts.items()}
        return place


def _halved(sums: dict[int, Sum]) -> dict[int, Sum]:
    found: dict[int, Sum] = {}
    for place, value in sums.items():
        found[place // 2] = found.get(place // 2, 0) + value
    return found
