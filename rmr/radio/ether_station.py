"""One robot's radio in the ether: medium access in the kernel's time, and the state of the process around it.

A radio is part of its robot's process, as in `rmr_agent`. When that is held up (a stopped process) the station stands
still: frames that come through meanwhile are handed on, as a process that goes on decides them by their stamps, but
nothing is sent, and acknowledgements have missed their time. When the process dies the station is off until a new one
begins another life.
"""

from collections.abc import Callable
from random import Random
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rmr.base.kernel import RADIO, Alarm, Kernel
from rmr.base.time import NEVER, Instant
from rmr.radio.air import Confirmed, Received
from rmr.radio.mac import Mac, State, Transmission
from rmr.radio.path_loss_map import PathLossMap
from rmr.radio.receive_filter import Counters, ReceiveFilter
from rmr.radio.security import Security
from rmr.radio.waves import CAUSES, COLLISION, DEAF, NOISE, Causes, Truths

# ---- counters of receptions and losses in the ether, incremented for all receivers of a frame at once

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


Take = Callable[[Received | Confirmed], None]


class Medium:
    """The ether as a station uses it; `rmr.radio.ether.Ether` is the one there is.

    A base class rather than a protocol: a station uses it for every frame, and mypyc calls the methods of a class
    directly.
    """

    kernel: Kernel
    bulk_counters: BulkCounters
    path_loss: PathLossMap
    awaiting: set[int]
    """Indices of the stations that transmit or wait for an acknowledgement."""
    listening: Any
    """Whether the station of each index is switched on (an array)."""

    def busy(self, station: "EtherStation", now: Instant) -> bool:
        """Return whether the channel assessment of `station` that ends `now` finds the channel busy."""
        raise NotImplementedError

    def announce(self, station: "EtherStation", psdu: bytes, sequence: int, attempt: int, start: Instant) -> None:
        """Let `station` transmit at `start`."""
        raise NotImplementedError


class EtherStation:
    """One robot's radio in the ether."""

    def __init__(
        self, ether: Medium, index: int, mac: Mac, receive_filter: ReceiveFilter, take: Take | None, payload_max: int
    ) -> None:
        self.index = index
        self.mac = mac
        self.receive_filter = receive_filter
        self.take = take
        self.payload_max = payload_max
        """Octets that fit a frame."""
        self.held = False
        """Whether its process is stopped or ended: it sends and acknowledges nothing."""
        self._ether = ether
        self._alarm = Alarm(ether.kernel, RADIO, self._fire)

    @property
    def counters(self) -> Counters:
        """Its counters, up to date."""
        return self._ether.bulk_counters.complete(self.index, self.receive_filter.counters)

    @property
    def queued(self) -> int:
        """Number of requests that wait for the channel."""
        return self.mac.queued

    def request(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Send `payload` (`payload_max` octets at most) to `destination`, None for all.

        A `Confirmed` with `handle` follows. Frames with a deadline `due` are sent earliest deadline first. Raises
        `ValueError` if the payload or the destination does not fit a frame.
        """
        kernel = self._ether.kernel
        if self.mac.request(kernel.now, payload, destination, handle, due):
            self._alarm.set(self.mac.next_wake)
        else:
            self.receive_filter.counters.access_failed += 1
            kernel.at(kernel.now, RADIO, lambda _now: self._tell(Confirmed(handle, "access_failure")))

    def move(self, x: float, y: float) -> None:
        """Set the station's true position, metres."""
        self._ether.path_loss.move(self.index, x, y)

    def acknowledged(self, end: Instant) -> None:
        """Accept the awaited acknowledgement, whose last symbol arrives at `end`, which is now."""
        confirmed = self.mac.acknowledged(end, end)
        self._go_on()
        self._tell(confirmed)

    # -- what befalls the process that it is part of -------------------------------------------------------------

    def hold(self) -> None:
        """Stop the process: frames that arrive are taken, but nothing is sent or acknowledged."""
        self.held = True
        self._alarm.set(NEVER)

    def resume(self, now: Instant) -> None:
        """Continue after `hold`: timers that were due meanwhile fire now, and backoffs start again."""
        self.held = False
        while self.mac.next_wake < now:
            # An assessment of the past cannot be made up for: the channel of that instant is gone. Deadlines can.
            if self.mac.state is State.BACKOFF:
                self.mac.back_off_again(now)
            else:
                self._fire(now)
        self._go_on()

    def switch_off(self) -> None:
        """Neither send nor receive any more, as when the process ends; `switch_on` starts the next incarnation."""
        self.hold()
        self._ether.listening[self.index] = False
        self._ether.awaiting.discard(self.index)

    def switch_on(self, rng: Random, security: Security | None) -> None:
        """Start the next incarnation in the same place, which keeps nothing of the earlier one but the counters."""
        ether = self._ether
        receive_filter = self.receive_filter
        self.mac = Mac(receive_filter.address, receive_filter.pan, rng, security=security)
        self.receive_filter = ReceiveFilter(
            receive_filter.address, receive_filter.pan, receive_filter.counters, security
        )
        self.held = False
        ether.listening[self.index] = True

    def _tell(self, confirmed: Confirmed) -> None:
        if self.take is not None:
            self.take(confirmed)

    def _fire(self, now: Instant) -> None:
        mac = self.mac
        counters = self.receive_filter.counters
        out = mac.fire(mac.state is State.BACKOFF and self._ether.busy(self, now))
        if isinstance(out, Transmission):
            counters.sent += 1
            self._ether.announce(self, out.psdu, out.sequence, out.attempt, out.start)
        self._go_on()
        if isinstance(out, Confirmed):
            counters.no_ack += out.status == "no_ack"
            counters.access_failed += out.status == "access_failure"
            self._tell(out)

    def _go_on(self) -> None:
        if not self.held:
            self._alarm.set(self.mac.next_wake)
        if self.mac.state in (State.SENDING, State.WAITING):
            self._ether.awaiting.add(self.index)
        else:
            self._ether.awaiting.discard(self.index)
