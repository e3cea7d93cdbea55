"""Latency: one sender alone on the channel.

Nothing is left but the backoff, 0 to 7 periods of 320 us, so all times take one of 8 values. *Access* is from the
request to the first symbol on the air, *oneway* to the last symbol at the receiver, *confirm* to the confirmation,
which of a unicast is its acknowledgement's end.
"""

from collections import Counter
from dataclasses import dataclass
from functools import partial
from math import sqrt

from rmr.base.kernel import ROBOT
from rmr.base.time import NS_PER_MS, NS_PER_US, Duration
from rmr.radio.frame import ACK_OCTETS
from rmr.radio.mac import BACKOFF_PERIOD, BE_MIN
from rmr.radio.phy import CCA, TURNAROUND, RadioConfig, airtime
from rmr.radio.trials import Row, Runs
from rmr.radio.trials.places import ORIGIN, at_angle
from rmr.radio.trials.statistics import DIGITS, NORMAL_QUANTILE, mean, percentile
from rmr.radio.trials.traffic import Frame, Scene, check_count, check_payload, in_ms, octets_of

PERIOD: Duration = 50 * NS_PER_MS
"""From one request to the next: the channel has long been idle again."""

BACKOFFS = (1 << BE_MIN) - 1
"""Most backoff periods of a first attempt."""
FIRST: Duration = CCA + TURNAROUND
LAST: Duration = FIRST + BACKOFFS * BACKOFF_PERIOD
"""The shortest and the longest access."""

RECEIVER = 0
SENDER = 1


@dataclass(frozen=True)
class Latency:
    """What is sent how often. Raises `ValueError` for what cannot be run."""

    payload: int = 50
    unicast: bool = False
    count: int = 10_000
    """Frames of each replication."""

    def __post_init__(self) -> None:
        check_payload(self.payload)
        check_count(self.count)


def run(case: Latency, runs: Runs) -> Row:
    """Return the distributions of the times of access, of the way, and to the confirmation."""
    samples = runs.over(partial(_sample, case, runs.config), runs.seeds)
    frames = [frame for sample in samples for frame in sample]
    psdu = octets_of(case.payload)
    mean_us = (FIRST + LAST) // 2 // NS_PER_US
    air_us = airtime(psdu) // NS_PER_US
    answer_us = (TURNAROUND + airtime(ACK_OCTETS)) // NS_PER_US if case.unicast else 0
    access = [frame.aired - frame.offered for frame in frames if frame.attempts]
    oneway = [frame.delivered - frame.offered for frame in frames if frame.has_arrived]
    confirm = [frame.confirmed - frame.offered for frame in frames if frame.status == "ok"]
    return {
        "payload_bytes": case.payload,
        "psdu_bytes": psdu,
        "unicast_ack": case.unicast,
        "n": len(frames),
        "delivered": len(oneway),
        "airtime_us": air_us,
        "theory_access_us": _theory(),
        "theory_oneway_us_mean": mean_us + air_us,
        "theory_confirm_us_mean": mean_us + air_us + answer_us,
        "access_ms": _summary(access),
        "oneway_ms": _summary(oneway),
        "confirm_ms": _summary(confirm),
        "hist_access_us": _histogram(access),
        "hist_oneway_us": _histogram(oneway),
        "hist_confirm_us": _histogram(confirm),
        "ci95_mean_halfwidth_ms": round(_half_width(access), 5),
    }


def _sample(case: Latency, config: RadioConfig, seed: int) -> list[Frame]:
    scene = Scene(config, seed)
    scene.listener(RECEIVER, ORIGIN, scene.note_delivery)
    sender = scene.sender(SENDER, at_angle(10.0, 0.0), RECEIVER if case.unicast else None, case.payload)
    for index in range(case.count):
        scene.kernel.at(index * PERIOD, ROBOT, sender.offer)
        scene.kernel.run_until((index + 1) * PERIOD - 1)
    return sender.frames


def _theory() -> str:
    """Return the distribution of the access times as text, us."""
    cca, turnaround, step, first, last = (t // NS_PER_US for t in (CCA, TURNAROUND, BACKOFF_PERIOD, FIRST, LAST))
    values = f"{{{first},{first + step},...,{last}}}"
    return f"{step}*U{{0..{BACKOFFS}}}+{cca}+{turnaround} => {values}, mean {(first + last) // 2}"


def _summary(times: list[Duration]) -> dict[str, float]:
    values = [in_ms(time) for time in times]
    ranks = {f"p{rank}": percentile(values, rank / 100) for rank in (50, 95, 99)}
    return {"n": len(values), "mean": round(mean(values), DIGITS), **ranks, "max": max(values, default=0.0)}


def _histogram(times: list[Duration]) -> dict[str, int]:
    return {str(us): count for us, count in sorted(Counter(time // NS_PER_US for time in times).items())}


def _half_width(times: list[Duration]) -> float:
    """Return half the normal interval of the mean, ms."""
    if len(times) < 2:
        return 0.0
    middle = mean(times)
    variance = sum((time - middle) ** 2 for time in times) / (len(times) - 1)
    return NORMAL_QUANTILE * sqrt(variance / len(times)) / NS_PER_MS
