"""The rules of `rmr.radio.phy` for all receivers of a transmission at once, vectorised with numpy.

`phy` is the specification: it decides one reception at one receiver from all frames that this receiver has heard. Here
a `Wave` has a transmission's power at every station, and a few array operations decide for all of them. The receivers
that lock on a wave are determined once, at its lock instant, from the waves before it; so no history is kept. A
property test compares verdicts and outcomes with those of `phy`.

Arrays have one entry for each station, by its index; `at` picks the stations within reach (an index array, or a
slice for all). Powers are milliwatts; a station out of reach of a wave hears 0.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rmr.base.time import Duration, Instant
from rmr.radio.air import Announcement
from rmr.radio.cells import Cell
from rmr.radio.frame import AckFrame, DataFrame
from rmr.radio.path_loss_map import Floats, Places, ReachedStations
from rmr.radio.phy import (
    BER_TERMS,
    BIT,
    CAPTURE_RATIO,
    CCA,
    CERTAIN_RATIO,
    LOCK_RATIO,
    SYNCHRONISATION,
    TURNAROUND,
    Channel,
    is_captured,
    success_probability,
)

Truths = NDArray[np.bool_]
Causes = NDArray[np.int8]
Words = NDArray[np.uint64]
NOISE: Final = 0
COLLISION: Final = 1
DEAF: Final = 2
CAUSES: Final = (NOISE, COLLISION, DEAF)
"""Causes of a loss (`phy.ReceptionVerdict.cause`)."""

_WEIGHTS: Final = np.array([weight for weight, _ in BER_TERMS])
_SLOPES: Final = np.array([slope for _, slope in BER_TERMS])


def _word(number: int) -> Words:
    """Return 64 bits as an array scalar, which numpy combines with arrays fastest."""
    return np.array(number, dtype=np.uint64)


_GAMMA: Final = _word(0x9E3779B97F4A7C15)
_FACTORS: Final = _word(0xBF58476D1CE4E5B9), _word(0x94D049BB133111EB)
_SHIFTS: Final = _word(30), _word(27), _word(31)
_HALF: Final = _word(32)
_LOWER: Final = _word(0xFFFFFFFF)


class Wave:
    """A transmission as all stations hear it."""

    __slots__ = (
        "announcement",
        "at",
        "cell",
        "end",
        "frame",
        "lock_at",
        "locks",
        "order",
        "origin",
        "power",
        "power_dbm",
        "start",
    )

    def __init__(
        self,
        announcement: Announcement,
        frame: DataFrame | AckFrame | None,
        origin: int,
        cell: Cell,
        reached: ReachedStations,
        channel: Channel,
    ) -> None:
        self.announcement = announcement
        self.frame = frame
        self.start = announcement.start
        self.end = announcement.end
        self.order = announcement.start, announcement.source
        """Which of several waves comes first, as in `phy`."""
        self.origin = origin
        """The transmitter's index."""
        self.cell = cell
        self.at, self.power_dbm, self.power = reached
        self.lock_at = announcement.start + (SYNCHRONISATION if channel.capture else 0)
        self.locks: Truths | None = None
        """Which stations have locked on it, once the lock instant has come."""

    def grow(self, room: int) -> None:
        """Make room for `room` stations: the new ones do not hear it."""
        more = room - len(self.power)
        self.power = np.concatenate([self.power, np.zeros(more)])
        self.power_dbm = np.concatenate([self.power_dbm, np.full(more, -np.inf)])
        if self.locks is not None:
            self.locks = np.concatenate([self.locks, np.zeros(more, dtype=np.bool_)])

    def before(self, other: "Wave") -> bool:
        """Whether this wave comes before `other`."""
        return self.order < other.order

    def deafens(self, start: Instant, end: Instant) -> bool:
        """Whether its transmitter, which turns around before and after it, is deaf within `start`..`end`."""
        return self.start - TURNAROUND < end and self.end + TURNAROUND > start


def strongest(begin: Instant, finish: Instant, others: Sequence[Wave], at: Places) -> Floats | float:
    """Return the greatest sum of the powers of `others` at any time within `begin`..`finish`, at each place.

    The power on the air is greatest between the last beginning and the first end of frames that overlap.
    """
    if len(others) == 1:
        return others[0].power[at]
    worst: Floats | None = None
    starts = {other.start for other in others}
    ends = {other.end for other in others}
    for since, until in pairwise(_edges(begin, finish, others)):
        # Local maxima only: a stretch at whose end no wave ends, or at whose start none begins, has a neighbour with at
        # least as much power.
        if (until == finish or until in ends) and (since == begin or since in starts):
            total = _total(since, others, at)
            worst = total if worst is None else np.maximum(worst, total)
    assert worst is not None
    return worst


def stretches(begin: Instant, finish: Instant, others: Sequence[Wave], at: Places) -> list[tuple[Duration, Floats]]:
    """Return (length, total power at each place) of each stretch in which `others` do not change; see `phy`."""
    spans = pairwise(_edges(begin, finish, others))
    return [(until - since, _total(since, others, at)) for since, until in spans]


def _edges(begin: Instant, finish: Instant, others: Sequence[Wave]) -> list[Instant]:
    """Return `begin`, `finish` and when `others` begin and end in between, in order."""
    edges = {begin, finish}
    edges.update(edge for other in others for edge in (other.start, other.end) if begin < edge < finish)
    return sorted(edges)


def _total(now: Instant, others: Sequence[Wave], at: Places) -> Any:
    """Return the sum of the powers of `others` at one instant, at each place."""
    total: Any = 0.0
    for other in others:
        if other.start <= now < other.end:
            total = total + other.power[at]
    return total


def settle(wave: Wave, air: Sequence[Wave], channel: Channel) -> None:
    """Decide which stations lock on `wave`; all that began before its lock instant is in `air`, in order."""
    at = wave.at
    start = wave.start
    lock_at = wave.lock_at
    power = wave.power[at]
    if channel.capture:
        can = power > LOCK_RATIO * channel.noise_mw
        others = [o for o in air if o.start < lock_at and o.end > start and o is not wave]
        if others:
            can &= power >= CAPTURE_RATIO * strongest(start, lock_at, others, at)
    else:
        noise: Any = channel.noise_mw
        present = [o for o in air if o.start < start < o.end]
        if present:
            total = present[0].power[at]
            for other in present[1:]:
                total = total + other.power[at]
            noise = channel.noise_mw + total
        can = power > LOCK_RATIO * noise
        for other in air:
            # Of frames that start together the strongest comes first; see `phy`.
            if other.start == start and other is not wave:
                can &= power >= other.power[at] if wave.before(other) else power > other.power[at]
    locks = np.zeros(len(wave.power), dtype=np.bool_)
    locks[at] = can
    # A receiver keeps an earlier lock until the end of that frame, and a transmitter is deaf from its turnaround on.
    for other in air:
        if other.locks is not None and other.end > lock_at and other is not wave:
            locks &= ~other.locks
        if other.start - TURNAROUND <= lock_at and other.end + TURNAROUND > start:
            locks[other.origin] = False
    wave.locks = locks


def verdicts(wave: Wave, air: Sequence[Wave], channel: Channel, at: NDArray[np.intp]) -> tuple[Floats, Causes]:
    """Return the probability of success and what a loss would be due to, at each of the stations `at`.

    `wave` is settled, and `air` holds all that was on the air during it. What `phy.reception` says, for all.
    """
    start = wave.start
    end = wave.end
    power = wave.power[at]
    others = [o for o in air if o.start < end and o.end > start and o is not wave]
    if others and channel.capture and len(power) == 1:  # of many far away, one receiver hears few
        others = [o for o in others if o.power[at][0] > 0.0]
    success = np.zeros(len(power))
    cause = np.full(len(power), NOISE, dtype=np.int8)
    near = np.flatnonzero(power >= LOCK_RATIO * channel.noise_mw)
    if others:
        success[near], cause[near] = _contended(wave, others, channel, at[near], power[near])
    else:
        success[near] = _certainty(power[near] / channel.noise_mw, end - start)
    deaf = {o.origin for o in air if o.deafens(start, end) and o is not wave}
    if deaf:
        mute = np.zeros(len(wave.power), dtype=np.bool_)
        mute[list(deaf)] = True
        mute = mute[at]
        success[mute] = 0.0
        cause[mute] = DEAF
    return success, cause


def verdict(wave: Wave, air: Sequence[Wave], channel: Channel, index: int) -> tuple[float, int]:
    """Return the verdict of `verdicts` for the station `index` alone: used where few stations hear a frame."""
    if not channel.capture:
        success, cause = verdicts(wave, air, channel, np.array([index], dtype=np.intp))
        return float(success[0]), int(cause[0])
    start = wave.start
    end = wave.end
    power = wave.power.item(index)
    meet = [o for o in air if o.start < end + TURNAROUND and o.end > start - TURNAROUND and o is not wave]
    if meet and any(other.origin == index and other.deafens(start, end) for other in meet):
        return 0.0, DEAF
    if power < LOCK_RATIO * channel.noise_mw:
        return 0.0, NOISE
    others = [o for o in meet if o.start < end and o.end > start and o.power[index] > 0.0] if meet else meet
    if others:
        assert wave.locks is not None, "a wave is settled before it ends"
        locked = bool(wave.locks[index])
        if not locked or not is_captured(power, locked, float(strongest(start, end, others, index))):
            return 0.0, COLLISION
    return success_probability(power / channel.noise_mw, (end - start) / BIT), NOISE


def _contended(
    wave: Wave, others: Sequence[Wave], channel: Channel, at: Places, power: Floats
) -> tuple[Floats, Causes]:
    assert wave.locks is not None, "a wave is settled before it ends"
    start = wave.start
    end = wave.end
    locked = wave.locks[at]
    heard = others[0].power[at] > 0.0
    for other in others[1:]:
        heard |= other.power[at] > 0.0
    if channel.capture:
        clear = power >= CAPTURE_RATIO * strongest(start, end, others, at)
        success = _certainty(power / channel.noise_mw, end - start)
        lost = heard & ~(locked & clear)
        cause = lost.astype(np.int8)
    else:
        success = np.ones(len(power))
        for length, total in stretches(start, end, others, at):
            success *= _certainty(power / (channel.noise_mw + total), length)
        lost = heard & ~locked
        cause = heard.astype(np.int8)
    success[lost] = 0.0
    return success, cause


def _certainty(ratio: Floats, length: Duration) -> Floats:
    """Return `phy.success_probability` of each of the ratios for all bits of a stretch of `length`."""
    doubtful = ratio < CERTAIN_RATIO
    success = np.ones(len(ratio))
    if doubtful.any():
        rates = np.exp(np.multiply.outer(ratio[doubtful], _SLOPES)) @ _WEIGHTS
        success[doubtful] = (1.0 - np.maximum(rates, 0.0)) ** (length / BIT)
    return success


def channel_busy(station: int, end: Instant, air: Sequence[Wave], channel: Channel) -> bool:
    """Return what `phy.channel_busy` says at one station."""
    begin = end - CCA
    energy = 0.0
    carrier = False
    for wave in air:
        if wave.origin == station:
            if wave.start - TURNAROUND <= end and wave.end + TURNAROUND > begin:
                return True
        elif wave.start < end and wave.end > begin:
            if not channel.capture and wave.end < end and wave.start < begin:
                continue  # as ns-3 misses it
            power = float(wave.power[station])
            energy += power
            carrier = carrier or power >= channel.carrier_mw
            if wave.locks is not None and wave.end > end and wave.locks[station]:
                carrier = True
    return carrier or energy >= channel.busy_mw


def _mixed(words: Words) -> Words:
    words = words + _GAMMA
    words ^= words >> _SHIFTS[0]
    words *= _FACTORS[0]
    words ^= words >> _SHIFTS[1]
    words *= _FACTORS[1]
    words ^= words >> _SHIFTS[2]
    return words


def draws(mixed_seed: int, announcement: Announcement, receivers: Words) -> tuple[Floats, Floats]:
    """Return `phy.draw` at the addresses `receivers`, as two numbers of 0 .. 2**32 - 1: its upper and lower half."""
    source, sequence, attempt, *_ = announcement
    words = receivers | _word(source << 16)
    words ^= _word(mixed_seed)
    words = _mixed(words)
    words ^= _word(sequence << 8 | attempt)
    words = _mixed(words)
    return (words >> _HALF).astype(np.float64), (words & _LOWER).astype(np.float64)
