"""per_vs_snr.json and psr_vs_distance.json: what one frame alone has to expect, as probabilities, without chance.

ns-3's table of packet errors is computed, so ours has to be the same at each of its points. Its success over
distance is counted, 2,000 frames a point; it is judged by where the curve crosses 90, 50 and 10 %, and each point
by whether our probability is one under which ns-3's count is no outlier. Power, ratio and LQI of the rows are
computed by ns-3, too, and have to agree to the digits that it prints.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import exp, inf, lgamma, log, log10, sqrt
from typing import NamedTuple

from reference import EXPONENT, SENSITIVITY_DBM, TOLERANCES, TX_POWER_DBM, rows
from verdicts import Check, Data, Estimate, compared

from rmr.radio.phy import (
    RadioConfig,
    Signal,
    airtime,
    bit_error_rate,
    channel_of,
    link_quality,
    milliwatts,
    path_loss_db,
    reception,
    success_probability,
)

AWGN = RadioConfig(sensitivity_dbm=SENSITIVITY_DBM, interference="awgn", exponent=EXPONENT)
LEVELS = (0.9, 0.5, 0.1)
"""Where curves over distance are compared."""
POWER_DB = 0.002
"""ns-3 prints powers with four digits and the noise, and so the ratio, with three."""
LQI_STEPS = 1.0
"""A probability at the edge of a step falls to either side of it: ns-3's noise has a digit more than ours."""
WONDER = 1e-4
NO_WONDER = 3.89
"""Normal deviations within which a count stays but once in 10,000 times."""
NORMAL_FROM = 20.0
"""Expected count from which on it is as good as normal; below it is Poisson's."""

Curve = Sequence[tuple[float, float]]


class Point(NamedTuple):
    """What one frame alone has to expect at a distance."""

    rx_dbm: float
    snr_db: float
    success: float
    lqi: float


def per_vs_snr() -> Iterator[Check]:
    """Yield for each column the check of its greatest difference."""
    table = rows("per_vs_snr")
    for column in table[0]:
        if column == "snr_db":
            continue
        ours = _column(column)
        worst = max(table, key=lambda row: abs(ours(10.0 ** (row["snr_db"] / 10.0)) - row[column]))
        where = ("per_vs_snr", f"greatest difference of {len(table)}, at {worst['snr_db']:g} dB", column)
        mine = Estimate(ours(10.0 ** (worst["snr_db"] / 10.0)))
        yield compared(where, mine, Estimate(float(worst[column])), TOLERANCES["packet error"])


def _column(column: str) -> Callable[[float], float]:
    """Return our value of a column as a function of the ratio of signal to noise (linear)."""
    if column == "ber":
        return bit_error_rate
    _, part, octets = column.split("_")
    if part == "psdu":
        return lambda ratio: 1.0 - success_probability(ratio, 8 * int(octets))
    return lambda ratio: 1.0 - alone(ratio, int(octets))


def alone(ratio: float, octets: int) -> float:
    """Return the probability that a frame of `octets` is received at `ratio` over the noise (linear)."""
    channel = channel_of(AWGN)
    frame = Signal(0, airtime(octets), 1, ratio * channel.noise_mw)
    return reception(frame, [frame], [], channel).success


def point(distance_m: float, octets: int, config: RadioConfig) -> Point:
    """Return what a frame of `octets` has to expect at `distance_m`."""
    channel = channel_of(config)
    rx_dbm = TX_POWER_DBM - path_loss_db(distance_m, config.exponent)
    frame = Signal(0, airtime(octets), 1, milliwatts(rx_dbm))
    verdict = reception(frame, [frame], [], channel)
    noise_dbm = 10.0 * log10(channel.noise_mw)
    return Point(rx_dbm, rx_dbm - noise_dbm, verdict.success, link_quality(rx_dbm, verdict.success, config))


def psr_vs_distance() -> Iterator[Check]:
    """Yield the checks of each curve."""
    for series in rows("psr_vs_distance"):
        octets, sensitivity = series["psdu_bytes"], series["rx_sensitivity_dbm"]
        config = replace(AWGN, sensitivity_dbm=sensitivity)
        name = f"PSDU of {octets}, sensitivity {sensitivity:g} dBm"
        points = [point(row["d_m"], octets, config) for row in series["rows"]]
        yield from _crossings(name, series["rows"], points)
        yield from _columns(name, series["rows"], points)
        yield _outliers(name, series["rows"], points)


def _crossings(name: str, table: Sequence[Data], points: Sequence[Point]) -> Iterator[Check]:
    ours = [(row["d_m"], mine.success) for row, mine in zip(table, points, strict=True)]
    theirs = [(row["d_m"], row["success"]) for row in table]
    for level in LEVELS:
        where = ("psr_vs_distance", name, f"distance of {level:.0%}, m")
        yield compared(where, Estimate(crossing(ours, level)), uncertain(theirs, level), TOLERANCES["crossing, m"])


def _columns(name: str, table: Sequence[Data], points: Sequence[Point]) -> Iterator[Check]:
    for field, column, tolerance in (
        ("rx_dbm", "rx_dbm", POWER_DB),
        ("snr_db", "snr_db", POWER_DB),
        ("lqi", "lqi_mean_of_received", LQI_STEPS),
    ):
        pairs = [
            (getattr(mine, field), float(row[column]), row["d_m"])
            for row, mine in zip(table, points, strict=True)
            if row[column] is not None
        ]
        ours, theirs, at = max(pairs, key=lambda pair: abs(pair[0] - pair[1]))
        where = ("psr_vs_distance", name, f"{column}, greatest difference, at {at:g} m")
        yield compared(where, Estimate(ours), Estimate(theirs), tolerance)


def _outliers(name: str, table: Sequence[Data], points: Sequence[Point]) -> Check:
    outliers = [
        row["d_m"]
        for row, mine in zip(table, points, strict=True)
        if not likely(mine.success, row["success"], row["n"])
    ]
    where = ("psr_vs_distance", name, f"points of {len(table)} at which ns-3's count is an outlier")
    return compared(where, Estimate(float(len(outliers))), Estimate(0.0), 0.0)


def crossing(curve: Curve, level: float) -> float:
    """Return where a falling curve first crosses `level`, on straight lines between its points; NaN if nowhere."""
    for (x, y), (next_x, next_y) in pairwise(curve):
        if y >= level > next_y:
            return x + (next_x - x) * (y - level) / (y - next_y)
    return float("nan")


def uncertain(curve: Curve, level: float, n: int = 2000) -> Estimate:
    """Return where a counted curve crosses `level`, with the interval that counting `n` frames a point leaves."""
    deviations = 1.96 * sqrt(level * (1.0 - level) / n)
    at = crossing(curve, level)
    near, far = (crossing(curve, level + sign * deviations) for sign in (1, -1))
    return Estimate(at, (far - near) / 2.0)


def likely(probability: float, share: float, n: int) -> bool:
    """Whether a count of `share` of `n` is no outlier under `probability`: at least once in 10,000 times as far off."""
    rare = min(probability, 1.0 - probability)
    count = round(n * (share if rare == probability else 1.0 - share))
    expected = n * rare
    if expected >= NORMAL_FROM:
        return abs(count - expected) <= NO_WONDER * sqrt(expected * (1.0 - rare))
    logarithm = log(expected) if expected else -inf
    poisson = [exp(k * logarithm - expected - lgamma(k + 1)) if k else exp(-expected) for k in range(count + 1)]
    return min(sum(poisson), 1.0 - sum(poisson[:-1])) >= WONDER / 2.0
