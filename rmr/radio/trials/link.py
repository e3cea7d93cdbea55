"""One link: the received power over a distance, and the probability of reception.

Without other traffic the signal-to-noise ratio alone decides. `at_distance` computes the probability by the model's
formulas; under shadowing it is averaged over links of that length. `drawn` sends frames over one link of an ether
instead, to check that the observed share agrees with the formulas.
"""

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import erf, log10, sqrt

from rmr.base.time import NS_PER_MS, NS_PER_US, Duration
from rmr.radio.frame import BROADCAST, DataFrame, encode_data
from rmr.radio.links import SHADOWING_SIGMAS
from rmr.radio.phy import (
    BIT,
    LOCK_RATIO,
    OCTET,
    TURNAROUND,
    RadioConfig,
    airtime,
    bit_error_rate,
    channel_of,
    link_quality,
    milliwatts,
    path_loss_db,
    success_probability,
)
from rmr.radio.trials import Row, Runs
from rmr.radio.trials.places import ORIGIN, at_angle
from rmr.radio.trials.statistics import DIGITS, mean, ratio, wilson
from rmr.radio.trials.traffic import PAN, Scene, check_count, check_psdu, octets_of

DISTANCE_MAX_M = 100_000.0
PERIOD: Duration = 20 * NS_PER_MS
SHADES = 240
"""Steps in which the deviations of shadowing are averaged: finer changes nothing in six decimals."""

RECEIVER = 0
SENDER = 1


@dataclass(frozen=True)
class LinkTrial:
    """What is sent how far. Raises `ValueError` for what cannot be."""

    distance_m: float
    psdu: int = 61
    """Octets of the frame."""
    count: int | None = None
    """Frames to send and count in each replication; None: the formulas only."""

    def __post_init__(self) -> None:
        check_psdu(self.psdu)
        if not 0.0 <= self.distance_m <= DISTANCE_MAX_M:
            raise ValueError(f"a distance of {self.distance_m:g} m: write 0 to {DISTANCE_MAX_M:g}")
        if self.count is not None:
            check_count(self.count)


def run(case: LinkTrial, runs: Runs) -> Row:
    """Return what the formulas say, and then what has been counted."""
    row = at_distance(case.distance_m, case.psdu, runs.config)
    if case.count is None:
        return row
    counted = drawn(case.distance_m, case.psdu, runs, case.count)
    return row | counted | {"per": round(1.0 - counted["success"], DIGITS)}


def at_distance(distance_m: float, psdu: int, config: RadioConfig) -> Row:
    """Return the model's results for a frame of `psdu` octets over `distance_m`."""
    power_dbm = config.tx_power_dbm - path_loss_db(distance_m, config.exponent)
    snr_db = power_dbm - 10.0 * log10(channel_of(config).noise_mw)
    success = sum(
        weight * _success(snr_db + deviation_db, psdu) for deviation_db, weight in _shades(config.shadowing_db)
    ) * (1.0 - config.loss)
    unshadowed = _success(snr_db, psdu)
    return {
        "d_m": distance_m,
        "psdu_bytes": psdu,
        "rx_sensitivity_dbm": config.sensitivity_dbm,
        "rx_dbm": round(power_dbm, 4),
        "snr_db": round(snr_db, 4),
        "ber": bit_error_rate(10.0 ** (snr_db / 10.0)),
        "per": 1.0 - success,
        "success": success,
        "lqi": link_quality(power_dbm, unshadowed, config),
        "airtime_us": airtime(psdu) // NS_PER_US,
    }


def per(snr_db: float) -> Row:
    """Return the bit error rate at a ratio of signal to noise, and the packet error rates of frames of some sizes.

    ``per_psdu_N`` counts the N octets of the PSDU only, ``per_air_N`` all that is on the air, as a receiver does.
    """
    linear = 10.0 ** (snr_db / 10.0)
    row: Row = {"snr_db": snr_db, "ber": bit_error_rate(linear)}
    for psdu in (5, 20, 50, 100, 127):
        row[f"per_psdu_{psdu}"] = 1.0 - success_probability(linear, psdu * OCTET / BIT)
        row[f"per_air_{psdu}"] = 1.0 - success_probability(linear, airtime(psdu) / BIT)
    return row


def drawn(distance_m: float, psdu: int, runs: Runs, count: int = 2000) -> Row:
    """Return how many of `count` frames a replication arrive over `distance_m`."""
    qualities = [
        quality
        for sample in runs.over(partial(_sample, distance_m, psdu, count, runs.config), runs.seeds)
        for quality in sample
    ]
    total = count * len(runs.seeds)
    theory = at_distance(distance_m, psdu, runs.config)
    return {
        "d_m": distance_m,
        "rx_dbm": theory["rx_dbm"],
        "snr_db": theory["snr_db"],
        "success": round(ratio(len(qualities), total), DIGITS),
        "ci95": wilson(len(qualities), total),
        "n": total,
        "lqi_mean_of_received": int(mean(qualities)),
    }


def _sample(distance_m: float, psdu: int, count: int, config: RadioConfig, seed: int) -> list[int]:
    """Return the link qualities of the frames that arrive."""
    scene = Scene(config, seed)
    qualities: list[int] = []
    scene.listener(RECEIVER, ORIGIN, lambda frame: qualities.append(frame.lqi))
    scene.listener(SENDER, at_angle(distance_m, 0.0), None)
    for index in range(count):
        frame = DataFrame(PAN, BROADCAST, SENDER, index & 0xFF, False, bytes(psdu - octets_of(0)))
        scene.ether.transmit(SENDER, encode_data(frame), scene.kernel.now + TURNAROUND, index)
        scene.kernel.run_until((index + 1) * PERIOD)
    return qualities


def _success(snr_db: float, psdu: int) -> float:
    linear = milliwatts(snr_db)
    return 0.0 if linear < LOCK_RATIO else success_probability(linear, airtime(psdu) / BIT)


def _shades(sigma_db: float) -> list[tuple[float, float]]:
    """Return (deviation in dB, weight) of shadowing: normal, cut at `SHADOWING_SIGMAS` deviations."""
    if not sigma_db:
        return [(0.0, 1.0)]
    width = 2 * SHADOWING_SIGMAS / SHADES
    edges = [-SHADOWING_SIGMAS + width * index for index in range(SHADES + 1)]
    below = [0.0, *((1.0 + erf(edge / sqrt(2.0))) / 2.0 for edge in edges), 1.0]
    middles = [-SHADOWING_SIGMAS, *(edge + width / 2 for edge in edges[:-1]), SHADOWING_SIGMAS]
    return [(sigma_db * middle, high - low) for middle, (low, high) in zip(middles, pairwise(below), strict=True)]
