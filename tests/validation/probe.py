"""Constants of the radio as they show from outside: a constant that nobody obeys is worth nothing.

A `Mac` is driven with dice that always fall lowest or highest and with channels that are always clear or busy, and
its instants are read off; the rules of reception are asked at one power or length after the other until the answer
changes. So a constant may be written down rightly and applied wrongly, and it shows.
"""

from collections.abc import Callable
from math import log10
from random import Random

from rmr.base.time import NS_PER_MS, NS_PER_US
from rmr.radio.air import ACK_ATTEMPT, Announcement
from rmr.radio.frame import FCS_OCTETS, HEADER_OCTETS, DataFrame, encode_data
from rmr.radio.mac import Mac, State, Transmission
from rmr.radio.phy import (
    SYMBOL,
    Channel,
    RadioConfig,
    Signal,
    airtime,
    channel_busy,
    channel_of,
    locked_on,
    milliwatts,
    reception,
)
from rmr.radio.station import Station

PAN = 0x1234
FAR_AHEAD = 100 * NS_PER_MS


class Dice(Random):
    """Chance that always falls lowest, or always highest."""

    def __init__(self, highest: bool) -> None:
        self._highest = highest
        super().__init__(0)

    def getrandbits(self, bits: int) -> int:
        return (1 << bits) - 1 if self._highest else 0

    def random(self) -> float:
        return 1.0 - 2**-53 if self._highest else 0.0

    def randrange(self, start: int, stop: int | None = None, step: int = 1) -> int:  # type: ignore[override]
        low, high = (0, start) if stop is None else (start, stop)
        return high - 1 if self._highest else low


def mac(highest: bool = False, payload: int = 50, destination: int | None = None) -> Mac:
    """Return a MAC with one request, made at 0."""
    made = Mac(1, PAN, Dice(highest))
    made.request(0, bytes(payload), destination, 0)
    return made


def assessments(highest: bool, busy: int) -> list[int]:
    """Return the ends of the clear channel assessments of one broadcast, nanoseconds, the first `busy` of them busy."""
    machine, ends = mac(highest), []
    while machine.state is State.BACKOFF:
        ends.append(machine.next_wake)
        machine.fire(len(ends) <= busy)
    return ends


def backoff_periods(busy: int) -> int:
    """Return the most backoff periods that precede the assessment after `busy` busy ones; -1 if there is none."""
    lazy, eager = ([0, *assessments(highest, busy)] for highest in (True, False))
    if len(lazy) < busy + 2:
        return -1
    length, shortest = (ends[busy + 1] - ends[busy] for ends in (lazy, eager))
    return (length - shortest) // backoff_period()


def backoff_period() -> int:
    """Return the unit of backoffs: the difference that one bit of chance makes, nanoseconds."""

    class One(Dice):
        def getrandbits(self, bits: int) -> int:
            return 1

        def randrange(self, start: int, stop: int | None = None, step: int = 1) -> int:  # type: ignore[override]
            return 1

    machine = Mac(1, PAN, One(False))
    machine.request(0, b"", None, 0)
    return machine.next_wake - mac().next_wake


def assessments_until_failure() -> int:
    """Return how many busy assessments end a request."""
    return len(assessments(False, 1000))


def failure_after_ns() -> int:
    """Return the longest time from a request to its channel access failure."""
    return assessments(True, 1000)[-1]


def turnaround_ns() -> int:
    """Return the time from the end of an idle assessment to the first symbol."""
    machine = mac()
    clear = machine.next_wake
    sent = machine.fire(False)
    assert isinstance(sent, Transmission)
    return sent.start - clear


def assessment_ns() -> int:
    """Return how long the MAC takes for an assessment: its first end when no backoff period precedes it."""
    return mac().next_wake


def ack_wait_ns() -> int:
    """Return how long after a frame's end its acknowledgement is waited for."""
    machine = mac(destination=2)
    machine.fire(False)
    end = machine.next_wake
    machine.fire(False)
    return machine.next_wake - end


def transmissions_unanswered(destination: int | None) -> int:
    """Return how many times a frame is transmitted that nobody acknowledges."""
    machine, count = mac(destination=destination), 0
    while machine.state is not State.IDLE:
        count += isinstance(machine.fire(False), Transmission)
    return count


def space_ns(psdu: int) -> int:
    """Return the space between a broadcast of `psdu` octets and the backoff of the next one."""
    payload = psdu - HEADER_OCTETS - FCS_OCTETS
    machine = mac(payload=payload)
    machine.request(0, b"", None, 1)
    machine.fire(False)
    end = machine.next_wake
    machine.fire(False)
    return machine.next_wake - end - assessment_ns()


def empty_frame() -> bytes:
    """Return a data frame without payload."""
    return encode_data(DataFrame(PAN, 2, 1, 0, True, b""))


def acknowledgement() -> tuple[int, int]:
    """Return how long after a unicast its acknowledgement starts, nanoseconds, and its octets."""
    station = Station(2, PAN, 0, Random(0))
    psdu = encode_data(DataFrame(PAN, 2, 1, 7, True, b"x"))
    start = FAR_AHEAD
    end = start + airtime(len(psdu))
    station.hear(Announcement(1, 7, 0, start, end, 0.0, 1.0, 0.0, psdu))
    for output in station.advance(end + FAR_AHEAD, 0.0, 0.0):
        if isinstance(output, Announcement) and output.attempt & ACK_ATTEMPT:
            return output.start - end, len(output.psdu)
    return -1, -1


def threshold(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return where, between `low` (does not hold) and `high` (holds), `holds` begins to; to 0.001."""
    while high - low > 0.0005:
        middle = (low + high) / 2.0
        low, high = (low, middle) if holds(middle) else (middle, high)
    return (low + high) / 2.0


def alone(dbm: float, octets: int = 61, start: int = 0, source: int = 1) -> Signal:
    """Return a frame of `octets` as a receiver hears it."""
    return Signal(start, start + airtime(octets), source, milliwatts(dbm))


def noise_dbm(channel: Channel) -> float:
    """Return the noise of a receiver."""
    return 10.0 * log10(channel.noise_mw)


def least_ratio_to_lock_db(config: RadioConfig) -> float:
    """Return the least ratio of signal to noise at which a receiver locks, dB."""
    channel = channel_of(config)

    def locks(ratio_db: float) -> bool:
        frame = alone(noise_dbm(channel) + ratio_db)
        return locked_on(frame.end - 1, [frame], [], channel) is frame

    return threshold(locks, -20.0, 20.0)


def least_energy_dbm(config: RadioConfig) -> float:
    """Return the energy from which on a channel is busy on which nothing can be locked on.

    The energy is that of eleven frames together whose beginnings were missed, the receiver having been deaf.
    """
    channel = channel_of(config)

    def busy(dbm: float) -> bool:
        parts = [alone(dbm - 10.0 * log10(11), source=source) for source in range(11)]
        return channel_busy(1_000_000, parts, [(0, 200_000)], channel)

    return threshold(busy, -130.0, 0.0)


def assessed_ns(config: RadioConfig) -> int:
    """Return how long before the end of an assessment a frame may begin, that was missed, and still make it busy.

    Measured with a frame that begins inside the window and goes on, in symbols from the window's end.
    """
    channel = channel_of(config)
    end = FAR_AHEAD
    for symbols in range(64):
        # The frame ends `symbols` before the assessment does: it is noticed while that is inside the window.
        frame = Signal(end - symbols * SYMBOL - airtime(61), end - symbols * SYMBOL, 1, milliwatts(-20.0))
        if not channel_busy(end, [frame], [], channel):
            return symbols * SYMBOL
    return -1


def least_ratio_to_survive_db(config: RadioConfig) -> float:
    """Return how far a frame must be above another that starts together with it to be received for certain, dB."""
    channel = channel_of(config)

    def survives(ratio_db: float) -> bool:
        frame, other = alone(-50.0, source=2), alone(-50.0 - ratio_db, source=1)
        return reception(frame, [other, frame], [], channel).success > 0.5

    return threshold(survives, -20.0, 20.0)


def microseconds(nanoseconds: int) -> float:
    """Return a duration in microseconds."""
    return nanoseconds / NS_PER_US
