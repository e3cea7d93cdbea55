"""Means, shares and percentiles with their 95 % intervals, in the forms of the reference results.

    {"mean": m, "ci95": [low, high], "n_reps": n}    a mean over replications
    {"p": p, "ci95": [low, high], "k": k, "n": n}    a share: k of n trials

Few replications take Student's t, many the normal distribution, shares Wilson's interval (Journal of the American
Statistical Association 22, 1927), which is right at 0 and 1 too. One replication has no interval: `ci95` is None.
"""

from collections.abc import Sequence
from math import atan, ceil, cos, pi, sin, sqrt
from typing import Any

NORMAL_QUANTILE = 1.96
"""Quantile of the two-sided 95 % interval of a normal distribution, in standard deviations."""
DIGITS = 6
"""Decimals of results."""


def mean(values: Sequence[float]) -> float:
    """Return the mean; 0 if there are no values."""
    return sum(values) / len(values) if values else 0.0


def ratio(part: float, whole: float) -> float:
    """Return `part` of `whole`; 0 if there is no whole."""
    return part / whole if whole else 0.0


def percentile(values: Sequence[float], share: float) -> float:
    """Return the percentile by nearest rank: the least value that `share` of `values` do not exceed; 0 if empty."""
    return sorted(values)[max(0, ceil(share * len(values)) - 1)] if values else 0.0


def over_few(values: Sequence[float]) -> dict[str, Any]:
    """Return the mean over replications with Student's interval."""
    # With more degrees of freedom the normal quantile replaces Student's, which is 1.972 there.
    return _with_interval(values, student_quantile(min(len(values) - 1, 200)) if len(values) > 1 else 0.0)


def over_many(values: Sequence[float]) -> dict[str, Any]:
    """Return the mean over replications with the normal interval."""
    return _with_interval(values, NORMAL_QUANTILE)


def share(successes: int, trials: int) -> dict[str, Any]:
    """Return a share with Wilson's interval."""
    found = ratio(successes, trials)
    return {"p": round(found, DIGITS), "ci95": wilson(successes, trials), "k": successes, "n": trials}


def wilson(successes: int, trials: int) -> list[float]:
    """Return Wilson's interval for `successes` of `trials`."""
    if not trials:
        return [0.0, 1.0]
    found = successes / trials
    square = NORMAL_QUANTILE**2
    centre = found + square / (2 * trials)
    half = NORMAL_QUANTILE * sqrt(found * (1 - found) / trials + square / (4 * trials**2))
    scale = 1 + square / trials
    return [round(max(0.0, (centre - half) / scale), DIGITS), round(min(1.0, (centre + half) / scale), DIGITS)]


def student_quantile(freedom: int) -> float:
    """Return the quantile of the two-sided 95 % interval of Student's t distribution."""
    low = 0.0
    high = 16.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (middle, high) if _student(middle, freedom) < 0.95 else (low, middle)
    return (low + high) / 2


def _student(t: float, freedom: int) -> float:
    """Return the share of Student's distribution within -t..t (Abramowitz and Stegun, 26.7.3 and 26.7.4)."""
    angle = atan(t / sqrt(freedom))
    odd = freedom % 2
    term = cos(angle) if odd else 1.0
    total = 0.0
    for index in range(2 + odd, freedom + 1, 2):
        total += term
        term *= cos(angle) ** 2 * (index - 1) / index
    return 2 / pi * (angle + sin(angle) * total) if odd else sin(angle) * total


def _with_interval(values: Sequence[float], quantile: float) -> dict[str, Any]:
    middle = mean(values)
    count = len(values)
    interval = None
    if count > 1:
        half = quantile * sqrt(sum((value - middle) ** 2 for value in values) / (count - 1) / count)
        interval = [round(middle - half, DIGITS), round(middle + half, DIGITS)]
    return {"mean": round(middle, DIGITS), "ci95": interval, "n_reps": count}
