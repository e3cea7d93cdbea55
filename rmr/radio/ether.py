"""All radios of a lab in virtual time.

The same medium access (`rmr.radio.mac`), the same intake and the same rules of reception as in a robot process, but
for all receivers of a frame at once (`rmr.radio.waves`): a frame costs some array operations, whoever hears it; those
out of reach only have their places in the arrays. Where few hear it they are judged one by one, by the same rules.
Time is the kernel's. A frame is announced at the end of an idle channel assessment, 192 us before its first symbol;
so when a lock instant or an end comes, all that bears on it is known.

What is due at the same instant happens in this order: a frame's end, with its receptions and acknowledgements;
then the timers of medium access. Receivers of one frame are told in the order in which they were added.
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
from rmr.radio.etherstation import EtherStation, Medium, Take
from rmr.radio.floor import Floats, Floor, Places
from rmr.radio.frame import ACK_OCTETS, BROADCAST, PSDU_MAX, AckFrame, DataFrame, FrameError, encode_ack
from rmr.radio.intake import Counters, Intake, decoded
from rmr.radio.links import Disturbance, Links
from rmr.radio.mac import Mac
from rmr.radio.phy import CCA, TURNAROUND, RadioConfig, airtime, channel_of, link_quality, mix
from rmr.radio.security import Security, payload_max
from rmr.radio.tallies import Tallies
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
"""How long after its end a wave may still bear on another: on one as long as can be that began before it ended."""

FEW: Final = 12
"""Up to so many receivers of a frame are judged one by one, which costs less than the arrays of any number."""

REACH_CELLS: Final = 2
"""Two frames can meet at a receiver when their transmitters are at most so many cells apart."""

_ACK_AIRTIME: Final = airtime(ACK_OCTETS)
_WORD: Final = 4294967296.0
_ORDER: Final = attrgetter("order")


class Ether(Medium):
    """The stations of one lab and what is on the air."""

    def __init__(
        self, kernel: Kernel, config: RadioConfig, seed: int, pan: int, disturbances: Iterable[Disturbance] = ()
    ) -> None:
        """`seed` decides receptions, as in `phy.draw`. Raises `ValueError` for a disturbance that cannot be one."""
        self.kernel = kernel
        self.config = config
        self.pan = pan
        self.links = Links(config, seed, disturbances)
        self.floor = Floor(config, self.links)
        self.stations: list[EtherStation] = []
        self.tallies = Tallies(self.floor.room)
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
        self.listening = np.zeros(self.floor.room, dtype=np.bool_)
        """Whether the station of each index is switched on; data frames are for no others."""

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
        index = self.floor.add(address, x, y)
        if len(self.listening) < self.floor.room:
            self._grow()
        intake = Intake(address, self.pan, Counters(), security)
        mac = Mac(address, self.pan, rng, security=security)
        station = EtherStation(self, index, mac, intake, take, payload_max(security))
        self.stations.append(station)
        self._by_address[address] = station
        self.listening[index] = True
        if take is None:
            self.tallies.bulk[index] = self.tallies.bulky = True
        return station

    def _grow(self) -> None:
        room = self.floor.room
        self.listening = np.concatenate([self.listening, np.zeros(room - len(self.listening), dtype=np.bool_)])
        self.tallies.grow(room)
        for waves in self._air.values():
            for wave in waves:
                wave.grow(room)

    # -- transmissions ----------------------------------------------------------------------------------------

    def transmit(self, address: int, psdu: bytes, start: Instant, sequence: int = 0) -> None:
        """Put octets on the air at `start`, without medium access: for experiments, and for what is no frame.

        Raises `ValueError` if `start` is not at least the turnaround of 192 us away.
        """
        if start < self.kernel.now + TURNAROUND:
            raise ValueError("a transmission is announced 192 us before its first symbol at the latest")
        self.announce(self._by_address[address], psdu, sequence, 0, start)

    def announce(self, station: EtherStation, psdu: bytes, sequence: int, attempt: int, start: Instant) -> None:
        """Let `station` transmit at `start`; it is deaf from now until 192 us after the end."""
        now, index = self.kernel.now, station.index
        cell = self.floor.cell(index)
        self._settle(now)
        for wave in self._near(cell, now):
            if wave.locks is not None:
                wave.locks[index] = False
        x, y = self.floor.place(index)
        announcement = Announcement(
            station.intake.address,
            sequence,
            attempt,
            start,
            start + airtime(len(psdu)),
            self.config.tx_power_dbm,
            x,
            y,
            psdu,
        )
        reached = self.floor.reached(index, start)
        wave = Wave(announcement, self._frame(psdu, reached.power), index, cell, reached, self._channel)
        air = self._air.get(cell)
        if air is None:
            air = self._air[cell] = deque()
            self._near_cells.clear()
        air.append(wave)
        insort(self._unsettled, wave, key=_by_lock)
        self.kernel.at(wave.end, AIR, lambda _now: self._ended(wave))
        if self.on_air is not None:
            self.on_air(announcement)

    def _frame(self, psdu: bytes, power: Floats) -> DataFrame | AckFrame | None:
        """Return the frame in `psdu`; None, counted at all who hear it, if it is none."""
        try:
            return decoded(psdu)
        except FrameError:
            for index in np.flatnonzero(power).tolist():
                self.stations[index].intake.counters.malformed += 1
            return None

    def _near(self, cell: Cell, since: Instant) -> list[Wave]:
        """Return the waves that may meet one from `cell` at a receiver and end after `since`, in order of start."""
        near = self._near_cells.get(cell)
        if near is None:
            reach = range(-REACH_CELLS, REACH_CELLS + 1)
            cells = [Cell(cell.x + dx, cell.y + dy) for dx in reach for dy in reach]
            near = self._near_cells[cell] = [self._air[one] for one in cells if one in self._air]
        forgotten = self.kernel.now - REMEMBERED
        found: list[Wave] = []
        for air in near:
            while air and air[0].end < forgotten:
                air.popleft()
            if air:
                found += [wave for wave in air if wave.end > since]
        if len(found) > 1:
            found.sort(key=_ORDER)
        return found

    def _during(self, wave: Wave) -> list[Wave]:
        """Return the waves that may bear on the reception of `wave`, which ends now, in order of start."""
        return self._near(wave.cell, wave.start - TURNAROUND)

    def _settle(self, now: Instant) -> None:
        """Settle who locks on the waves whose lock instants have come, in order."""
        unsettled = self._unsettled
        while unsettled and unsettled[0].lock_at <= now:
            wave = unsettled.pop(0)
            settle(wave, self._near(wave.cell, wave.start - TURNAROUND), self._channel)

    # -- receptions -------------------------------------------------------------------------------------------

    def busy(self, station: EtherStation, now: Instant) -> bool:
        """Return what the channel assessment of `station` says that ends `now`."""
        self._settle(now)
        near = self._near(self.floor.cell(station.index), now - CCA - TURNAROUND)
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
        """Let those take note who wait for just this acknowledgement; it bears no address."""
        for index in sorted(self.awaiting):
            station = self.stations[index]
            if not wave.power[index] or not station.mac.awaits_ack(frame.sequence, wave.start):
                continue
            if self._comes_through(wave, index, self._during(wave)):
                station.acknowledged(wave.end)

    def _arrive(self, wave: Wave, frame: DataFrame, at: NDArray[np.intp]) -> None:
        """Hand `frame`, which is for all, to those of the stations `at` that receive it."""
        if len(at) <= FEW and self._channel.capture:
            air = self._during(wave)
            for index in [index for index in at.tolist() if self._comes_through(wave, index, air)]:
                self._hand(wave, frame, self.stations[index])
            return
        indices, qualities = self._come_through(wave, at)
        if self.tallies.bulky:
            bulk = self.tallies.bulk[indices]
            self.tallies.received[indices] += bulk
            indices, qualities = indices[~bulk], qualities[~bulk]
        hearers: list[int] = indices.tolist()
        powers_dbm: list[float] = wave.power_dbm[indices].tolist()
        lqi: list[int] = qualities.astype(np.int64).tolist()
        for place, index in enumerate(hearers):
            station = self.stations[index]
            received = station.intake.take(frame, powers_dbm[place], lqi[place], wave.end)
            if received is not None and station.take is not None:
                station.take(received)

    def _arrive_at(self, wave: Wave, frame: DataFrame, station: EtherStation) -> None:
        """Hand `frame` to the one station that it is for, if that receives it."""
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
            self.tallies.received[station.index] += 1
            return
        rssi_dbm = wave.power_dbm.item(station.index)
        quality = link_quality(rssi_dbm, success, self.config)
        received = station.intake.take(frame, rssi_dbm, quality, wave.end)
        if received is not None and station.take is not None:
            station.take(received)

    def _acknowledge(self, wave: Wave, frame: DataFrame, station: EtherStation) -> None:
        """Let `station` acknowledge `wave`, unless it is held up.

        That it transmits at that time cannot be: it would be deaf.
        """
        if station.held:
            station.intake.counters.withheld += 1
            return
        start = wave.end + TURNAROUND
        station.intake.counters.acknowledgements += 1
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
            upper, lower = draws(self._mixed_seed, wave.announcement, self.floor.addresses[at[open_]])
            comes = upper < success[open_] * _WORD
            if loses:
                lost = comes & (lower < self._losses(wave, at[open_]) * _WORD)
                comes &= ~lost
                cause[open_[lost]] = NOISE
            kept[open_] = comes
        self.tallies.note(at, ~kept, cause)
        through = at[kept]
        return through, self._quality(wave, through, success[kept])

    def _comes_through(self, wave: Wave, index: int, air: Sequence[Wave]) -> float:
        """Return with what probability `wave` was to come through to the station `index`; 0, and count it, if lost.

        `air` is all that was on the air during it.
        """
        success, cause = verdict(wave, air, self._channel, index)
        loses = self.links.loses
        if loses or 0.0 < success < 1.0:
            one, receiver = wave.announcement, int(self.floor.addresses[index])
            bits = mix(mix(self._mixed_seed ^ (one.source << 16 | receiver)) ^ (one.sequence << 8 | one.attempt))
            kept = (bits >> 32) < success * _WORD
            if loses and kept and (bits & 0xFFFF_FFFF) < self._loss(wave, receiver) * _WORD:
                kept, cause = False, NOISE
            success = success if kept else 0.0
        if success == 0.0:
            self.tallies.note_one(index, cause)
        return success

    def _loss(self, wave: Wave, receiver: int) -> float:
        """Return the probability that the frame is lost to `receiver` whatever its power."""
        if self.links.even:
            return self.config.loss
        return self.links.loss(wave.announcement.source, receiver, wave.start)

    def _losses(self, wave: Wave, at: Places) -> Floats | float:
        """Return the probability that the frame is lost whatever its power, at each of the stations `at`."""
        if self.links.even:
            return self.config.loss
        source, start = wave.announcement.source, wave.start
        return np.array([self.links.loss(source, other, start) for other in self.floor.addresses[at].tolist()])

    def _quality(self, wave: Wave, places: Places, success: Floats) -> Any:
        """Return the LQI at each of the places; see `phy.link_quality`."""
        if not self._channel.capture:
            return np.floor(255.0 * success)
        over_db = wave.power_dbm[places] - self.config.sensitivity_dbm
        return np.minimum(np.maximum(np.rint(over_db * (255.0 / 40.0)), 0.0), 255.0)


def _by_lock(wave: Wave) -> tuple[Instant, int]:
    return wave.lock_at, wave.announcement.source
