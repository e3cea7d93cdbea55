"""A fault of ns-3 3.44, imitated to show what it does: it forgets interferers that end inside the locked frame.

ns-3 evaluates a frame whenever another one begins and at its own end, each time over all bits since the last time, with
the interference of that very moment. What ended in between leaves no trace. Our model counts every stretch of constant
interference, and goes on doing so in mode ``awgn``: this is for the comparison only.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np

from rmr.base.time import Duration, Instant
from rmr.radio import waves
from rmr.radio.path_loss_map import Floats, Places


@contextmanager
def forgetful() -> Iterator[None]:
    """Let the ether forget as ns-3 does."""
    right = waves.stretches
    waves.stretches = _stretches
    try:
        yield
    finally:
        waves.stretches = right


def _stretches(
    begin: Instant, finish: Instant, others: Sequence[waves.Wave], at: Places
) -> list[tuple[Duration, Floats]]:
    """Return (length, total power at each place) from one beginning of an interferer to the next."""
    edges = sorted({begin, finish} | {other.start for other in others if begin < other.start < finish})
    out = []
    for since, until in pairwise(edges):
        total: Any = np.zeros(len(others[0].power[at]))
        for other in others:
            if other.start < until <= other.end:
                total = total + other.power[at]
        out.append((until - since, total))
    return out
