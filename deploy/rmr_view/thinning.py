"""Leaving out what a picture would not show: samples that lie on the straight line between others."""

import math
from collections.abc import Sequence
from itertools import pairwise


def thinned(times: Sequence[float], columns: Sequence[Sequence[float]], within: float) -> list[int]:
    """Return the indices of the samples to keep, so that interpolation in time misses no sample by more than `within`.

    A sample is one value of each column; what it is missed by is the Euclidean distance (the recursive division of
    Ramer, Douglas and Peucker, over time).
    """
    if not times:
        return []
    kept = {0, len(times) - 1}
    spans = [(0, len(times) - 1)]
    while spans:
        first, last = spans.pop()
        worst = max(range(first + 1, last), key=lambda k: _missed(times, columns, first, last, k), default=None)
        if worst is not None and _missed(times, columns, first, last, worst) > within:
            kept.add(worst)
            spans += [(first, worst), (worst, last)]
    return sorted(kept)


def _missed(times: Sequence[float], columns: Sequence[Sequence[float]], first: int, last: int, k: int) -> float:
    span = times[last] - times[first]
    share = (times[k] - times[first]) / span if span > 0.0 else 0.0
    return math.hypot(*(c[first] + share * (c[last] - c[first]) - c[k] for c in columns))


def unwrapped(angles: Sequence[float]) -> list[float]:
    """Return angles, radians, without jumps of a full turn between neighbours."""
    turned = list(angles[:1])
    for before, after in pairwise(angles):
        turned.append(turned[-1] + math.remainder(after - before, math.tau))
    return turned
