"""The physical layer: 2.4 GHz O-QPSK of IEEE 802.15.4-2006 (section 6.5) as pure functions.

A receiver hears each transmission with the power that log-distance path loss leaves of it. Whether it receives
one goes by four rules:

1. *Half duplex.* While it transmits, and in the 192 us of turnaround before and after, it is deaf.
2. *Lock.* It locks on the first frame that it can synchronise to and stays with it until its end; all others
   are interference. So the later of two frames is lost even if it is the stronger, once the first has locked.
3. *Interference.* In mode ``capture_3db`` (the default) a frame must be 3 dB above the sum of all interference
   in its preamble to be locked on and from then on to survive: co-channel rejection as measured on real
   radios; two frames of equal power destroy each other. In mode ``awgn`` interference is treated like noise,
   each stretch of constant interference by itself, and a frame locks if it is over -5 dB at its first bit.
   That is what the ns-3 simulator does, and what comparing with it needs.
4. *Noise.* What is left is decided by the bit error rate of the modulation; the noise floor is placed so that a
   frame at the sensitivity has the ratio of signal to noise that the standard's sensitivity implies.

The probability that comes out is turned into an outcome by `draw`, a hash of who sent what to whom, so that
every process, and the simulator, decides alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from math import comb, exp, inf, log10
from typing import Final, NamedTuple

from rmr.base.time import NS_PER_S, NS_PER_US, Duration, Instant

NETWORK: Final = "network"
"""`RadioConfig.mode` of robots that have a network: see `rmr.radio.network`."""

BIT: Final[Duration] = 4 * NS_PER_US
SYMBOL: Final[Duration] = 16 * NS_PER_US
OCTET: Final[Duration] = 32 * NS_PER_US
HEADER_OCTETS: Final = 6
"""Preamble 4, start-of-frame delimiter 1, length 1."""
SYNCHRONISATION: Final[Duration] = 5 * OCTET
"""Preamble and delimiter: a receiver has locked when they have passed."""
TURNAROUND: Final[Duration] = 12 * SYMBOL
"""aTurnaroundTime."""
CCA: Final[Duration] = 8 * SYMBOL
"""Length of a clear channel assessment (6.9.9)."""

LOSS_AT_1_M_DB: Final = 46.6777
NOISE_BELOW_SENSITIVITY_DB: Final = 0.407
"""A frame at the sensitivity is 0.4 dB over the noise (thermal -106.987 dBm against -106.58 dBm)."""
LOCK_RATIO: Final[float] = 10**-0.5
"""Least ratio of signal to noise at which a receiver locks: -5 dB."""
CAPTURE_RATIO: Final[float] = 10**0.3
"""Co-channel rejection of real radios: 3 dB."""
CERTAIN_RATIO: Final = 4.0
"""Ratio of 6 dB from which the bit error rate is below 1e-16 and taken for 0: neither computed nor drawn."""

BURST_MIN: Final[Duration] = 1_000 * NS_PER_US
BURST_MAX: Final[Duration] = 86_400 * NS_PER_S
"""Mean lengths of bursts and of the times between them."""

RELEVANCE_DB: Final = 20.0
"""Margin below the sensitivity beyond which a frame is dropped at once: it is neither received nor interferes."""
LOCK_HISTORY: Final[Duration] = 20_000 * NS_PER_US
"""History of locks that is replayed: over four of the longest frames, after which an earlier lock has no effect."""

BER_TERMS: Final = tuple(
    (8.0 / 15.0 / 16.0 * (1 - k % 2 * 2) * comb(16, k), 20.0 * (1.0 / k - 1.0)) for k in range(2, 17)
)


@dataclass(frozen=True, slots=True)
class Bursts:
    """The two-state model of Gilbert and Elliott: how links come and go; see `rmr.radio.links`."""

    good: Duration
    """Mean length of a good time."""
    bad: Duration
    """Mean length of a bad time."""
    loss: float = 1.0
    """Probability that a frame is lost in a bad time, besides the losses of all times."""

    def __post_init__(self) -> None:
        if not BURST_MIN <= min(self.good, self.bad) <= max(self.good, self.bad) <= BURST_MAX:
            raise ValueError("the mean lengths of good and bad times lie between 1 ms and a day")
        if not 0.0 <= self.loss <= 1.0:
            raise ValueError(f"loss {self.loss} in bad times: write a probability, 0 to 1")

    def __reduce__(self) -> tuple[type["Bursts"], tuple[object, ...]]:
        return Bursts, (self.good, self.bad, self.loss)  # pickled so, as nothing can be assigned to a frozen one


@dataclass(frozen=True, slots=True)
class RadioConfig:
    """The radio of one lab."""

    tx_power_dbm: float = 0.0
    sensitivity_dbm: float = -85.0
    """Power at which a frame of 20 octets is lost once in a hundred times (6.1.7); the standard demands -85."""
    exponent: float = 3.0
    """Of the path loss: 2 in the open, 3 in a room."""
    loss: float = 0.0
    """Probability of an additional loss of a frame, independent for each receiver; acknowledgements too."""
    interference: str = "capture_3db"
    """``capture_3db`` or ``awgn``."""
    energy_threshold_db: float = 10.0
    """Energy detection: how far above the sensitivity the channel counts as busy (6.9.9: at most 10)."""
    shadowing_db: float = 0.0
    """Standard deviation, dB, of the constant that each link adds to the path loss."""
    bursts: Bursts | None = None
    """Bursts of losses on each link, besides `loss`."""
    mode: str = "802.15.4"
    """``802.15.4``, or ``network``: nothing of a radio is emulated, and everybody hears everybody."""

    def __post_init__(self) -> None:
        if self.mode not in ("802.15.4", NETWORK):
            raise ValueError(f"mode {self.mode!r}: write 802.15.4 or network")
        if self.interference not in ("capture_3db", "awgn"):
            raise ValueError(f"interference {self.interference!r}: write capture_3db or awgn")
        if not 0.0 <= self.loss <= 1.0:
            raise ValueError(f"loss {self.loss}: write a probability, 0 to 1")
        if not 0.0 <= self.shadowing_db <= 30.0:
            raise ValueError(f"shadowing {self.shadowing_db}: write a deviation of 0 to 30 dB")

    def __reduce__(self) -> tuple[type["RadioConfig"], tuple[object, ...]]:
        return RadioConfig, tuple(getattr(self, field.name) for field in fields(self))


class Channel(NamedTuple):
    """What a receiver's rules need of a `RadioConfig`, in milliwatts."""

    noise_mw: float
    busy_mw: float
    """Energy from which on the channel counts as busy."""
    carrier_mw: float
    """Power from which on a frame is recognised within a clear channel assessment."""
    capture: bool
    """Mode ``capture_3db``, else ``awgn``."""


class Signal:
    """A transmission as one receiver hears it. Half open: it is on the air from `start` until before `end`."""

    __slots__ = ("end", "power_mw", "source", "start")

    def __init__(self, start: Instant, end: Instant, source: int, power_mw: float) -> None:
        self.start = start
        self.end = end
        self.source = source
        self.power_mw = power_mw


class ReceptionVerdict(NamedTuple):
    """The result of the rules for one reception, before the random draw."""

    success: float
    """Probability that all bits are received right."""
    cause: str
    """Cause of a loss: ``deaf``, ``collision`` or ``noise``."""


Interval = tuple[Instant, Instant]

_DEAF: Final = ReceptionVerdict(0.0, "deaf")
_COLLISION: Final = ReceptionVerdict(0.0, "collision")
_TOO_WEAK: Final = ReceptionVerdict(0.0, "noise")
_CERTAIN: Final = ReceptionVerdict(1.0, "noise")


def airtime(octets: int) -> Duration:
    """Return how long a PSDU of `octets` is on the air: 32 us an octet, with 6 octets of PHY header."""
    return OCTET * (HEADER_OCTETS + octets)


def milliwatts(dbm: float) -> float:
    """Return a power in dBm as milliwatts."""
    return float(10.0 ** (dbm / 10.0))


def path_loss_db(distance_m: float, exponent: float) -> float:
    """Return the log-distance path loss, 46.68 dB at 1 m (the reference distance; nearer costs the same)."""
    return LOSS_AT_1_M_DB + 10.0 * exponent * log10(max(distance_m, 1.0))


def channel_of(config: RadioConfig) -> Channel:
    """Return the powers that `config` implies."""
    capture = config.interference == "capture_3db"
    return Channel(
        noise_mw=milliwatts(config.sensitivity_dbm - NOISE_BELOW_SENSITIVITY_DB),
        busy_mw=milliwatts(config.sensitivity_dbm + config.energy_threshold_db),
        carrier_mw=milliwatts(config.sensitivity_dbm) if capture else inf,
        capture=capture,
    )


def bit_error_rate(ratio: float) -> float:
    """Return the bit error rate of 2.4 GHz O-QPSK at `ratio` of signal to noise (linear; E.4.1.8)."""
    return max(0.0, sum(weight * exp(slope * ratio) for weight, slope in BER_TERMS))


def success_probability(ratio: float, bits: float) -> float:
    """Return the probability that `bits` bits in a row are right at `ratio` of signal to noise (linear)."""
    return 1.0 if ratio >= CERTAIN_RATIO else float((1.0 - bit_error_rate(ratio)) ** bits)


def interference(begin: Instant, finish: Instant, others: Sequence[Signal]) -> list[tuple[Duration, float]]:
    """Return (length, total milliwatts) of each stretch of `begin`..`finish` in which `others` do not change."""
    edges = {begin, finish}
    edges.update(at for other in others for at in (other.start, other.end) if begin < at < finish)
    marks = sorted(edges)
    return [
        (to - at, sum(other.power_mw for other in others if other.start <= at < other.end))
        for at, to in pairwise(marks)
    ]


def reception(frame: Signal, air: Sequence[Signal], deaf: Sequence[Interval], channel: Channel) -> ReceptionVerdict:
    """Return the verdict on `frame` at a receiver.

    `air` is all that the receiver hears, `frame` included, sorted by (start, source) and reaching back
    `LOCK_HISTORY` before it; `deaf` are the times when it transmits or turns around.
    """
    start = frame.start
    end = frame.end
    for begin, finish in deaf:
        if begin < end and finish > start:
            return _DEAF
    if frame.power_mw < LOCK_RATIO * channel.noise_mw:
        return _TOO_WEAK
    others = [other for other in air if other.start < end and other.end > start and other is not frame]
    if not others:
        ratio = frame.power_mw / channel.noise_mw
        if ratio >= CERTAIN_RATIO:
            return _CERTAIN
        return ReceptionVerdict(success_probability(ratio, (end - start) / BIT), "noise")
    return _contended(frame, others, air, deaf, channel)


def _contended(
    frame: Signal, others: Sequence[Signal], air: Sequence[Signal], deaf: Sequence[Interval], channel: Channel
) -> ReceptionVerdict:
    locked = locked_on(frame.start + (SYNCHRONISATION if channel.capture else 0), air, deaf, channel)
    if locked is not frame:
        return _COLLISION
    stretches = interference(frame.start, frame.end, others)
    if channel.capture:
        if not is_captured(frame.power_mw, True, max(power for _, power in stretches)):
            return _COLLISION
        ratio = frame.power_mw / channel.noise_mw
        return ReceptionVerdict(success_probability(ratio, (frame.end - frame.start) / BIT), "noise")
    success = 1.0
    for length, power in stretches:
        success *= success_probability(frame.power_mw / (channel.noise_mw + power), length / BIT)
    return ReceptionVerdict(success, "collision")


def is_captured(power_mw: float, locked: bool, strongest_mw: float) -> bool:
    """Return whether a frame prevails over others in mode ``capture_3db``.

    `locked` says whether the receiver is locked on it; `strongest_mw` is the greatest power of all others together at
    any time during it.
    """
    return locked and power_mw >= CAPTURE_RATIO * strongest_mw


def is_right(bits: int, success: float) -> bool:
    """Return whether all bits are right of a frame with the probability `success`; `bits` is its `draw`."""
    return (bits >> 32) < success * HALF_RANGE


def is_dropped(bits: int, loss: float) -> bool:
    """Return whether a frame that is right is lost all the same, with the probability `loss`; `bits` is its `draw`."""
    return (bits & 0xFFFF_FFFF) < loss * HALF_RANGE


def locked_on(at: Instant, air: Sequence[Signal], deaf: Sequence[Interval], channel: Channel) -> Signal | None:
    """Return the signal that the receiver is locked on at `at`, if any; `air` is sorted by (start, source)."""
    delay = SYNCHRONISATION if channel.capture else 0
    holder: Signal | None = None
    free_from = at - LOCK_HISTORY
    for signal in air:
        locks_at = signal.start + delay
        if locks_at > at:
            break
        if locks_at >= free_from and _can_lock(signal, locks_at, air, deaf, channel):
            holder = signal
            free_from = min([signal.end, *(begin for begin, _ in deaf if begin >= locks_at)])
    return holder if holder is not None and free_from > at else None


def _can_lock(
    signal: Signal, locks_at: Instant, air: Sequence[Signal], deaf: Sequence[Interval], channel: Channel
) -> bool:
    """Whether an unoccupied receiver locks on `signal` at `locks_at`."""
    start = signal.start
    for begin, finish in deaf:
        if begin <= locks_at and finish > start:
            return False
    if not channel.capture:
        # Of frames that start together the strongest, from the nearest sender, is first: in ns-3 signals take their
        # time. If it does not lock, no weaker one does.
        rank = (signal.power_mw, -signal.source)
        if any(o.start == start and (o.power_mw, -o.source) > rank for o in air):
            return False
        noise = sum(o.power_mw for o in air if o.start < start < o.end)
        return signal.power_mw > LOCK_RATIO * (channel.noise_mw + noise)
    if signal.power_mw <= LOCK_RATIO * channel.noise_mw:
        return False
    others = [o for o in air if o.start < locks_at and o.end > start and o is not signal]
    if any(signal.power_mw < CAPTURE_RATIO * o.power_mw for o in others):  # spares a crowd the sums
        return False
    return not others or signal.power_mw >= CAPTURE_RATIO * max(p for _, p in interference(start, locks_at, others))


def channel_busy(end: Instant, air: Sequence[Signal], deaf: Sequence[Interval], channel: Channel) -> bool:
    """Return the result of the clear channel assessment that ends at `end` (6.9.9, mode 3: energy or carrier).

    Carrier is a frame at the sensitivity or above, or one that the receiver is locked on. A station that
    transmits or turns around within the window cannot assess it and takes it for busy. Mode ``awgn`` is that
    of ns-3: energy, or locked on a frame; a frame that ends inside the window is missed.
    """
    begin = end - CCA
    for since, until in deaf:
        if since <= end and until > begin:  # it turns around to acknowledge what ended this instant
            return True
    present = [s for s in air if s.start < end and s.end > begin]
    if not channel.capture:
        present = [s for s in present if s.end >= end or s.start >= begin]
    if not present:
        return False
    energy = sum(s.power_mw for s in present)
    if energy >= channel.busy_mw or any(s.power_mw >= channel.carrier_mw for s in present):
        return True
    locked = locked_on(end, air, deaf, channel)
    return locked is not None and locked.start < end


def link_quality(rssi_dbm: float, success: float, config: RadioConfig) -> int:
    """Return the LQI, 0..255 (6.9.8 leaves its scale free).

    In mode ``capture_3db`` it is linear in the power from the sensitivity to 40 dB above it, in mode ``awgn``
    the probability of success (`ReceptionVerdict`), as in ns-3.
    """
    if config.interference == "awgn":
        return int(255 * success)
    quality = round((rssi_dbm - config.sensitivity_dbm) * (255 / 40))
    return 0 if quality < 0 else 255 if quality > 255 else quality


_MASK: Final = (1 << 64) - 1
HALF_RANGE: Final = 4294967296.0
"""2**32: each half of a draw is a number from 0 below this."""


def mix(word: int) -> int:
    """Return the finaliser of SplitMix64 (Steele, Lea, Flood 2014) of a 64-bit `word`."""
    word = (word + 0x9E3779B97F4A7C15) & _MASK
    word = ((word ^ word >> 30) * 0xBF58476D1CE4E5B9) & _MASK
    word = ((word ^ word >> 27) * 0x94D049BB133111EB) & _MASK
    return word ^ word >> 31


def draw(seed: int, source: int, sequence: int, attempt: int, receiver: int) -> int:
    """Return 64 random bits that depend on nothing but the arguments; every process agrees on them."""
    return draw_from(mix(seed & _MASK), source, sequence, attempt, receiver)


def draw_from(mixed_seed: int, source: int, sequence: int, attempt: int, receiver: int) -> int:
    """Return `draw` of a seed that is mixed already, as is done once for all frames of a run."""
    return mix(mix(mixed_seed ^ (source << 16 | receiver)) ^ (sequence << 8 | attempt))
