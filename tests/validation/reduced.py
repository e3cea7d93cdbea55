"""The families of checks, each in a version that takes about a second: for every run of the suite and for `mutations`.

A family is one file of the reference (or mode ``capture_3db``, which has none). The exact ones are whole; of the
measured ones a few rows are run for a short time at fixed seeds, and judged with the slack that chance needs.
"""

from collections.abc import Callable, Iterator
from itertools import chain

import constants
import curves
import judged
import overlaps
from experiments import SHORT, measure
from verdicts import Check

ROWS: dict[str, tuple[int, ...]] = {
    "psr_vs_distance": (7,),
    "latency_single_hop": (4, 5),
    "contention": (3, 11, 32, 33, 38),
    "hidden_terminal": (3, 15, 20),
    "capture_overlap": (2,),
    "reply_storm": (13, 16, 24, 40, 41, 45),
}
"""Which rows of each file."""


def measured_rows(file: str) -> Iterator[Check]:
    """Yield the checks of a file's reduced rows."""
    for index in ROWS[file]:
        ours = measure(file, index, SHORT)
        yield from judged.checks(file, index, ours, slack=True)


FAMILIES: dict[str, Callable[[], Iterator[Check]]] = {
    "constants": constants.checks,
    "per_vs_snr": curves.per_vs_snr,
    "psr_vs_distance": curves.psr_vs_distance,
    "psr_vs_distance, frames sent": lambda: measured_rows("psr_vs_distance"),
    "latency_single_hop": lambda: measured_rows("latency_single_hop"),
    "contention": lambda: measured_rows("contention"),
    "hidden_terminal": lambda: measured_rows("hidden_terminal"),
    "capture_overlap": overlaps.capture_overlap,
    "capture_overlap, frames sent": lambda: measured_rows("capture_overlap"),
    "reply_storm": lambda: measured_rows("reply_storm"),
    "capture_3db": overlaps.capture_rules,
    "capture_3db, frames sent": lambda: chain(overlaps.capture_sent(), overlaps.stations_sent()),
}
