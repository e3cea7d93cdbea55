"""Counters of receptions and losses in the ether, incremented for all receivers of a frame at once."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rmr.radio.receive_filter import Counters
from rmr.radio.waves import CAUSES, COLLISION, DEAF, NOISE, Causes, Truths

_Kind = TypeVar("_Kind", bound=np.generic)


def _grown(array: NDArray[_Kind], room: int) -> NDArray[_Kind]:
    return np.concatenate([array, np.zeros(room - len(array), dtype=array.dtype)])


class BulkCounters:
    """Receptions and losses of each station, by index."""

    __slots__ = ("bulk", "bulky", "lost", "received")

    def __init__(self, room: int) -> None:
        self.received = np.zeros(room, dtype=np.int64)
        self.lost = np.zeros((len(CAUSES), room), dtype=np.int64)
        """Lost frames by cause and station."""
        self.bulk = np.zeros(room, dtype=np.bool_)
        """Stations without a `take`: their receptions of broadcasts are counted here alone."""
        self.bulky = False
        """Whether any station is one of `bulk`."""

    def grow(self, room: int) -> None:
        """Make room for `room` stations."""
        self.received = _grown(self.received, room)
        self.bulk = _grown(self.bulk, room)
        self.lost = np.stack([_grown(of_one_cause, room) for of_one_cause in self.lost])

    def note(self, at: NDArray[np.intp], lost: Truths, cause: Causes) -> None:
        """Count the frame that is `lost` to some of the stations `at`."""
        self.lost[cause[lost], at[lost]] += 1

    def note_one(self, index: int, cause: int) -> None:
        """Count a frame that is lost to the station `index`."""
        self.lost[cause, index] += 1

    def complete(self, index: int, counters: Counters) -> Counters:
        """Bring `counters` of station `index` up to date and return them."""
        counters.collided = int(self.lost[COLLISION, index])
        counters.deaf = int(self.lost[DEAF, index])
        counters.dropped = int(self.lost[NOISE, index])
        if self.bulk[index]:
            counters.received += int(self.received[index])
            self.received[index] = 0
        return counters
