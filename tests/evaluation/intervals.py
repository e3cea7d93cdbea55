"""Estimates with 95 % intervals, and how a table shows them.

- A quantile: between order statistics. How many of n values lie below the true quantile is binomial, whatever the
  distribution; the limits are the values whose ranks leave at most 2.5 % on each side. Of too few values there is no
  limit on one side or both: it is None.
- A share: Wilson's score interval, which is good for shares near 0 and 1 and for few trials.
- A mean: percentile bootstrap over resamples of a named stream, so that the same values give the same interval.
"""

import math
import statistics
from collections.abc import Sequence
from typing import Any

from rmr.base.streams import stream

OUTSIDE = 0.025
"""Probability on each side of an interval."""
Z = statistics.NormalDist().inv_cdf(1.0 - OUTSIDE)
RESAMPLES = 1000

Estimate = dict[str, Any]


def quantile(values: Sequence[float], q: float) -> Estimate:
    """Return the `q` quantile of `values` with its interval; of 0.5 the median."""
    ordered, n = sorted(values), len(values)
    low, high = ranks(n, q)
    return {
        "value": statistics.median(ordered) if q == 0.5 else ordered[min(n - 1, math.ceil(q * n) - 1)],
        "low": None if low is None else ordered[low],
        "high": None if high is None else ordered[high],
        "n": n,
    }


def ranks(n: int, q: float) -> tuple[int | None, int | None]:
    """Return the indices of the order statistics that enclose the `q` quantile of `n` values; None where none does."""
    below, low, high = 0.0, None, None
    for index in range(n):
        if below <= OUTSIDE and below + _binomial(n, index, q) > OUTSIDE and index:
            low = index - 1
        below += _binomial(n, index, q)
        if high is None and below >= 1.0 - OUTSIDE:
            high = index
    return low, high


def _binomial(n: int, k: int, p: float) -> float:
    log = math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
    return math.exp(log + k * math.log(p) + (n - k) * math.log1p(-p))


def share(successes: int, n: int) -> Estimate:
    """Return the share of `successes` among `n` trials with Wilson's interval."""
    p = successes / n
    middle = (p + Z * Z / (2 * n)) / (1 + Z * Z / n)
    half = Z / (1 + Z * Z / n) * math.sqrt(p * (1 - p) / n + Z * Z / (4 * n * n))
    low = 0.0 if successes == 0 else middle - half
    high = 1.0 if successes == n else middle + half
    return {"value": p, "low": low, "high": high, "n": n}


def mean(values: Sequence[float]) -> Estimate:
    """Return the mean of `values` with its bootstrap interval."""
    rng, n = stream("evaluation/bootstrap"), len(values)
    means = sorted(statistics.fmean(rng.choices(values, k=n)) for _ in range(RESAMPLES))
    cut = round(OUTSIDE * RESAMPLES)
    return {"value": statistics.fmean(values), "low": means[cut], "high": means[-1 - cut], "n": n}


def text(estimate: Estimate, digits: int = 2, unit: str = "") -> str:
    """Return an estimate as a table shows it: ``1.42 (1.40 to 1.45)``; a limit that does not exist is a dash."""
    low, high = ("-" if estimate[side] is None else f"{estimate[side]:.{digits}f}" for side in ("low", "high"))
    return f"{estimate['value']:.{digits}f}{unit} ({low} to {high})"


def percent(estimate: Estimate, digits: int = 1) -> str:
    """Return a share in percent."""
    sides = {side: None if estimate[side] is None else 100.0 * estimate[side] for side in ("value", "low", "high")}
    return text(sides, digits, " %")
