"""All radios of a lab in virtual time.

Medium access (`rmr.radio.mac`), the receive filter and the rules of reception are those of a robot process, but
receptions are computed for all receivers of a frame at once (`rmr.radio.waves`): a frame costs some array operations,
whatever the number of its receivers. A frame with few receivers is decided one by one, by the same rules.
Time is the kernel's. A frame is announced at the end of an idle channel assessment, 192 us before its first symbol.
So at the instant at which receivers lock on a frame, and at its end, every frame that can interfere is known.

Order at the same instant: first the end of a frame, with its receptions and acknowledgements; then the timers of medium
access. Receivers of one frame are called in the order in which they were added.
"""

from bisect import insort
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from random import Random
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rmr.base.kernel import AIR, Kernel
from rmr.base.time import Duration, Instant
from rmr.radio.air import ACK_ATTEMPT, Announcement
from rmr.radio.cells import Cell
from rmr.radio.ether_station import BulkCounters, EtherStation, Medium, Take
from rmr.radio.frame import BROADCAST, PSDU_MAX, AckFrame, DataFrame, FrameError, encode_ack
from rmr.radio.links import Disturbance, Links
from rmr.radio.mac import Mac
from rmr.radio.path_loss_map import Floats, PathLossMap, Places
from rmr.radio.phy import (
    CCA,
    HALF_RANGE,
    TURNAROUND,
    RadioConfig,
    airtime,
    channel_of,
    draw_from,
    is_dropped,
    is_right,
    link_quality,
    mix,
)
from rmr.radio.receive_filter import Counters, ReceiveFilter, decoded
from rmr.radio.security import Security, payload_max
from rmr.radio.waves import (
    NOISE,
    Wave,
    channel_busy,
    draws,
    settle,
    verdict,
    verdicts,
)

REMEMBERED: Final[Duration] = 2 * (airtime(PSDU_MAX) + TURNAROUND)
"""Time after its end for which a wave is kept: the longest frame that overlaps it has ended by then."""

FEW: Final = 12
"""Number of receivers up to which a frame is decided one by one: fewer than this cost less than array operations."""

REACH_CELLS: Final = 2
"""Distance in cells within which the transmitters of two frames can have a receiver in common."""

_ORDER: Final = attrgetter("order")


class Ether(Medium):
    """The stations of one lab and the transmissions on the air."""

    def __init__(
        self, kernel: Kernel, config: RadioConfig, seed: int, pan: int, disturbances: Iterable[Disturbance] = ()
    ) -> None:
        """`seed` decides receptions, as in `phy.draw`. Raises `ValueError` for a disturbance that cannot be one."""
        self.kernel = kernel
        self.config = config
        self.pan = pan
        self.links = Links(config, seed, disturbances)
        self.path_loss = PathLossMap(config, self.links)
        self.stations: list[EtherStation] = []
        self.bulk_counters = BulkCounters(self.path_loss.room)
        self.awaiting: set[int] = set()
        """Indices of the stations that transmit or wait for an acknowledgement."""
        self.on_air: Callable[[Announcement], None] | None = None
        """Called with each announcement, acknowledgements too."""
        self._mixed_seed = mix(seed & 0xFFFF_FFFF_FFFF_FFFF)
        self._channel = channel_of(config)
        self._by_address: dict[int, EtherStation] = {}
        self._air: dict[Cell, deque[Wave]] = {}
        self._near_cells: dict[Cell, list[deque[Wave]]] = {}
        self._unsettled: list[Wave] = []
        self.listening = np.zeros(self.path_loss.room, dtype=np.bool_)
        """Whether the station of each index is switched on; others receive no data frames."""

    def add(
        self,
        address: int,
        rng: Random,
        take: Take | None,
        x: float = 0.0,
        y: float = 0.0,
        *,
        security: Security | None = None,
    ) -> EtherStation:
        """Return a new station at (x, y), metres; `rng` is its own, for backoffs.

        `take` is called with each reception and outcome; with None they are only counted. Raises `ValueError` if the
        address is taken.
        """
        if address in self._by_address:
            raise ValueError(f"two stations with the address {address}")
        index = self.path_loss.add(address, x, y)
        if len(self.listening) < self.path_loss.room:
            self._grow()
        receive_filter = ReceiveFilter(address, self.pan, Counters(), security)
        mac = Mac(address, self.pan, rng, security=security)
        station = EtherStation(self, index, mac, receive_filter, take, payload_max(security))
        self.stations.append(station)
        self._by_address[address] = station
        self.listening[index] = True
        if take is None:
            self.bulk_counters.bulk[index] = self.bulk_counters.bulky = True
        return station

    def _grow(self) -> None:
        room = self.path_loss.room
        self.listening = np.concatenate([self.listening, np.zeros(room - len(self.listening), dtype=np.bool_)])
        self.bulk_counters.grow(room)
        for waves in self._air.values():
            for wave in waves:
                wave.grow(room)

    # -- transmissions ----------------------------------------------------------------------------------------

    def transmit(self, address: int, psdu: bytes, start: Instant, sequence: int = 0) -> None:
        """Put octets on the air at `start` without medium access: for experiments, and for octets that are no frame.

        Raises `ValueError` if `start` is not at least the turnaround of 192 us away.
        """
        if start < self.kernel.now + TURNAROUND:
            raise ValueError("a transmission is announced 192 us before its first symbol at the latest")
        self.announce(self._by_address[address], psdu, sequence, 0, start)

    def announce(self, station: EtherStation, psdu: bytes, sequence: int, attempt: int, start: Instant) -> None:
        """Let `station` transmit at `start`; it is deaf from now until 192 us after the end."""
        now = self.kernel.now
        index = station.index
        cell = self.path_loss.cell(index)
        # Half duplex: the transmitter loses its lock on whatever it was receiving. Locks that were due before now are
        # decided first, while it still listened.
        self._settle(now)
        for wave in self._near(cell, now):
            if wave.locks is not None:
                wave.locks[index] = False
        x, y = self.path_loss.place(index)
        announcement = Announcement(
            station.receive_filter.address,
            sequence,
            attempt,
            start,
            start + airtime(len(psdu)),
            self.config.tx_power_dbm,
            x,
            y,
            psdu,
        )
        reached = self.path_loss.reached(index, start)
        wave = Wave(announcement, self._frame(psdu, reached.power), index, cell, reached, self._channel)
        air = self._air.get(cell)
        if air is None:  # a first wave in this cell: neighbourhoods that were looked up without it are stale
            air = self._air[cell] = deque()
            self._near_cells.clear()
        air.append(wave)
        insort(self._unsettled, wave, key=_by_lock)
        self.kernel.at(wave.end, AIR, lambda _now: self._ended(wave))
        if self.on_air is not None:
            self.on_air(announcement)

    def _frame(self, psdu: bytes, power: Floats) -> DataFrame | AckFrame | None:
        """Return the frame in `psdu`; None if it is none, which all stations within reach count as malformed."""
        try:
            return decoded(psdu)
        except FrameError:
            for index in np.flatnonzero(power).tolist():
                self.stations[index].receive_filter.counters.malformed += 1
            return None

    def _near(self, cell: Cell, since: Instant) -> list[Wave]:
        """Return the waves that may interfere with one from `cell` and end after `since`, in order of start."""
        near = self._near_cells.get(cell)
        if near is None:
            reach = range(-REACH_CELLS, REACH_CELLS + 1)
            cells = [Cell(cell.x + dx, cell.y + dy) for dx in reach for dy in reach]
            near = self._near_cells[cell] = [self._air[one] for one in cells if one in self._air]
        forgotten = self.kernel.now - REMEMBERED
        found: list[Wave] = []
        for air in near:
            while air and air[0].end < forgotten:  # each cell is trimmed when it is read: there is no clean-up timer
                air.popleft()
            if air:
                found += [wave for wave in air if wave.end > since]
        if len(found) > 1:
            found.sort(key=_ORDER)
        return found

    def _during(self, wave: Wave) -> list[Wave]:
        """Return the waves that may interfere with `wave`, which ends now, in order of start."""
        return self._near(wave.cell, wave.start - TURNAROUND)

    def _settle(self, now: Instant) -> None:
        """Decide which stations lock on the waves whose lock instants have come, in order of those instants."""
        unsettled = self._unsettled
        while unsettled and unsettled[0].lock_at <= now:
            wave = unsettled.pop(0)
            settle(wave, self._near(wave.cell, wave.start - TURNAROUND), self._channel)

    # -- receptions -------------------------------------------------------------------------------------------

    def busy(self, station: EtherStation, now: Instant) -> bool:
        """Return whether the channel assessment of `station` that ends `now` finds the channel busy."""
        self._settle(now)
        near = self._near(self.path_loss.cell(station.index), now - CCA - TURNAROUND)
        return channel_busy(station.index, now, near, self._channel)

    def _ended(self, wave: Wave) -> None:
        frame = wave.frame
        if frame is None:
            return
        self._settle(wave.end)
        if isinstance(frame, AckFrame):
            self._end_of_ack(wave, frame)
        elif frame.pan != self.pan:
            return
        elif frame.destination == BROADCAST:
            self._arrive(wave, frame, np.flatnonzero(self.listening & (wave.power > 0.0)))
        else:
            receiver = self._by_address.get(frame.destination)
            if receiver is not None and self.listening[receiver.index] and wave.power[receiver.index] > 0.0:
                self._arrive_at(wave, frame, receiver)

    def _end_of_ack(self, wave: Wave, frame: AckFrame) -> None:
        """Deliver an acknowledgement to the stations that wait for its sequence number: it has no address (7.2.2.3)."""
        for index in sorted(self.awaiting):
            station = self.stations[index]
            if not wave.power[index] or not station.mac.awaits_ack(frame.sequence, wave.start):
                continue
            if self._comes_through(wave, index, self._during(wave)):
                station.acknowledged(wave.end)

    def _arrive(self, wave: Wave, frame: DataFrame, at: NDArray[np.intp]) -> None:
        """Hand the broadcast `frame` to those of the stations `at` that receive it."""
        if len(at) <= FEW and self._channel.capture:
            air = self._during(wave)
            for index in [index for index in at.tolist() if self._comes_through(wave, index, air)]:
                self._hand(wave, frame, self.stations[index])
            return
        indices, qualities = self._come_through(wave, at)
        if self.bulk_counters.bulky:
            bulk = self.bulk_counters.bulk[indices]
            self.bulk_counters.received[indices] += bulk
            indices = indices[~bulk]
            qualities = qualities[~bulk]
        receivers: list[int] = indices.tolist()
        powers_dbm: list[float] = wave.power_dbm[indices].tolist()
        lqi: list[int] = qualities.astype(np.int64).tolist()
        for place, index in enumerate(receivers):
            station = self.stations[index]
            received = station.receive_filter.take(frame, powers_dbm[place], lqi[place], wave.end)
            if received is not None and station.take is not None:
                station.take(received)

    def _arrive_at(self, wave: Wave, frame: DataFrame, station: EtherStation) -> None:
        """Hand the unicast `frame` to its destination if that receives it."""
        index = station.index
        success = self._comes_through(wave, index, self._during(wave))
        if not success:
            return
        if frame.wants_ack:
            self._acknowledge(wave, frame, station)
        self._hand(wave, frame, station, success)

    def _hand(self, wave: Wave, frame: DataFrame, station: EtherStation, success: float = 1.0) -> None:
        """Hand `frame`, which has come through with probability `success`, to `station`."""
        if station.take is None and not frame.wants_ack:
            self.bulk_counters.received[station.index] += 1
            return
        rssi_dbm = wave.power_dbm.item(station.index)
        quality = link_quality(rssi_dbm, success, self.config)
        received = station.receive_filter.take(frame, rssi_dbm, quality, wave.end)
        if received is not None and station.take is not None:
            station.take(received)

    def _acknowledge(self, wave: Wave, frame: DataFrame, station: EtherStation) -> None:
        """Let `station` acknowledge `wave`, unless its process is held up.

        It cannot be transmitting itself at that time: it would have been deaf and not received the frame.
        """
        if station.held:
            station.receive_filter.counters.withheld += 1
            return
        start = wave.end + TURNAROUND
        station.receive_filter.counters.acknowledgements += 1
        original = wave.announcement
        attempt = ACK_ATTEMPT | original.attempt
        self.announce(station, encode_ack(frame.sequence), original.sequence, attempt, start)

    def _come_through(self, wave: Wave, at: NDArray[np.intp]) -> tuple[NDArray[np.intp], Floats]:
        """Return the indices of the stations among `at` that receive `wave`, and its link quality there.

        For all others the loss is counted.
        """
        success, cause = verdicts(wave, self._during(wave), self._channel, at)
        kept = success > 0.0
        loses = self.links.loses
        open_ = np.flatnonzero(kept if loses else kept & (success < 1.0))
        if len(open_):
            upper, lower = draws(self._mixed_seed, wave.announcement, self.path_loss.addresses[at[open_]])
            comes = upper < success[open_] * HALF_RANGE
            if loses:
                lost = comes & (lower < self._losses(wave, at[open_]) * HALF_RANGE)
                comes &= ~lost
                cause[open_[lost]] = NOISE
            kept[open_] = comes
        self.bulk_counters.note(at, ~kept, cause)
        through = at[kept]
        return through, self._quality(wave, through, success[kept])

    def _comes_through(self, wave: Wave, index: int, air: Sequence[Wave]) -> float:
        """Return the probability with which `wave` was received by the station `index`; 0 for a loss, which is counted.

        `air` holds all waves during it.
        """
        success, cause = verdict(wave, air, self._channel, index)
        loses = self.links.loses
        if loses or 0.0 < success < 1.0:
            one = wave.announcement
            receiver = int(self.path_loss.addresses[index])
            bits = draw_from(self._mixed_seed, one.source, one.sequence, one.attempt, receiver)
            if not is_right(bits, success):
                success = 0.0
            elif loses and is_dropped(bits, self._loss(wave, receiver)):
                success = 0.0
                cause = NOISE
        if success == 0.0:
            self.bulk_counters.note_one(index, cause)
        return success

    def _loss(self, wave: Wave, receiver: int) -> float:
        """Return the probability that `receiver` loses the frame independently of its power."""
        if self.links.even:
            return self.config.loss
        return self.links.loss(wave.announcement.source, receiver, wave.start)

    def _losses(self, wave: Wave, at: Places) -> Floats | float:
        """Return the probability that the frame is lost independently of its power, at each of the stations `at`."""
        if self.links.even:
            return self.config.loss
        source = wave.announcement.source
        start = wave.start
        return np.array([self.links.loss(source, other, start) for other in self.path_loss.addresses[at].tolist()])

    def _quality(self, wave: Wave, places: Places, success: Floats) -> Any:
        """Return the LQI at each of the places; see `phy.link_quality`."""
        if not self._channel.capture:
            return np.floor(255.0 * success)
        over_db = wave.power_dbm[places] - self.config.sensitivity_dbm
        return np.minimum(np.maximum(np.rint(over_db * (255.0 / 40.0)), 0.0), 255.0)


def _by_lock(wave: Wave) -> tuple[Instant, int]:
    return wave.lock_at, wave.announcement.source
