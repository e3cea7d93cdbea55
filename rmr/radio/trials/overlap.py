"""Overlap: two frames at one receiver, without any medium access.

The first comes from 10 m. The second begins later; its sender stands where the signal-to-interference ratio has the
requested value. The outcome shows the rules of locking and capture.
"""

from dataclasses import dataclass
from functools import partial
from math import log10

from rmr.base.time import NS_PER_MS, Instant
from rmr.radio.air import Received
from rmr.radio.frame import BROADCAST, DataFrame, encode_data
from rmr.radio.phy import TURNAROUND, RadioConfig
from rmr.radio.trials import Row, Runs
from rmr.radio.trials.places import ORIGIN, at_angle
from rmr.radio.trials.statistics import share
from rmr.radio.trials.traffic import PAN, Scene, check_count, check_psdu, octets_of

FIRST_M = 10.0
SIR_MAX_DB = 29.0
"""The second sender then stands at a metre, at exponent 3; nearer the path loss does not fall."""
OFFSET_MAX_US = 5_000.0
"""Longer than a frame of any size: there is nothing left to overlap."""

RECEIVER = 0
FIRST = 1
SECOND = 2


@dataclass(frozen=True)
class Overlap:
    """Power and delay of the second frame. Raises `ValueError` for values that cannot be run."""

    sir_db: float
    """Power of the first frame over that of the second."""
    offset_us: float
    """By how much the second begins later."""
    psdu: int = 61
    """Octets of each frame."""
    count: int = 400
    """Pairs of frames of each replication."""

    def __post_init__(self) -> None:
        check_psdu(self.psdu)
        if not -SIR_MAX_DB <= self.sir_db <= SIR_MAX_DB:
            raise ValueError(f"a ratio of {self.sir_db:g} dB: write -{SIR_MAX_DB:g} to {SIR_MAX_DB:g}")
        if not 0.0 <= self.offset_us <= OFFSET_MAX_US:
            raise ValueError(f"an offset of {self.offset_us:g} us: write 0 to {OFFSET_MAX_US:g}")
        check_count(self.count)


def second_m(case: Overlap, config: RadioConfig) -> float:
    """Return the metres from the second sender to the receiver. Raises `ValueError` if there are none."""
    metres = float(FIRST_M * 10.0 ** (case.sir_db / 10.0 / config.exponent))
    if metres < 1.0:  # where the path loss does not fall any more
        least_db = -10.0 * config.exponent * log10(FIRST_M)
        raise ValueError(f"a ratio of {case.sir_db:g} dB: at this exponent write {least_db:g} or more")
    return metres


def run(case: Overlap, runs: Runs) -> Row:
    """Return how often each of the two frames is received."""
    samples = list(runs.over(partial(_sample, case, runs.config), runs.seeds))
    pairs = case.count * len(samples)
    return {
        "sir_db": case.sir_db,
        "offset_us": case.offset_us,
        "n": pairs,
        "first_ok": share(sum(first for first, _ in samples), pairs),
        "second_ok": share(sum(second for _, second in samples), pairs),
    }


def _sample(case: Overlap, config: RadioConfig, seed: int) -> tuple[int, int]:
    """Return how many of the first and of the second frames are received."""
    scene = Scene(config, seed)
    received = {FIRST: 0, SECOND: 0}

    def hear(frame: Received) -> None:
        received[frame.source] += 1

    scene.listener(RECEIVER, ORIGIN, hear)
    scene.listener(FIRST, at_angle(FIRST_M, 0.0), None)
    scene.listener(SECOND, at_angle(second_m(case, config), 180.0), None)
    for index in range(case.count):
        start = scene.kernel.now + TURNAROUND
        _transmit(scene, FIRST, case.psdu, index, start)
        _transmit(scene, SECOND, case.psdu, index, start + round(1_000 * case.offset_us))
        # From one pair of frames to the next; longer than any pair takes.
        scene.kernel.run_until((index + 1) * (20 * NS_PER_MS))
    return received[FIRST], received[SECOND]


def _transmit(scene: Scene, source: int, psdu: int, index: int, start: Instant) -> None:
    frame = DataFrame(PAN, BROADCAST, source, index & 0xFF, False, bytes(psdu - octets_of(0)))
    scene.ether.transmit(source, encode_data(frame), start, index)
