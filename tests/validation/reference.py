"""The reference: what ns-3 3.44 measured of its own IEEE 802.15.4 model, as the JSON files beside this module.

What was asked of it, in which units and with which rules stands in reference/README.md. `TOLERANCES` are how far our
model may be from it; they are fixed, a check that misses one is a finding about the model.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

Data = dict[str, Any]

FOLDER = Path(__file__).parent / "reference"
FILES = (
    "constants",
    "per_vs_snr",
    "psr_vs_distance",
    "latency_single_hop",
    "contention",
    "hidden_terminal",
    "capture_overlap",
    "reply_storm",
)

TX_POWER_DBM = 0.0
SENSITIVITY_DBM = -106.58
"""Of an ideal receiver; `psr_vs_distance` also has two real ones."""
EXPONENT = 3.0

TOLERANCES = {
    "packet error": 0.002,
    "crossing, m": 0.5,
    "idle mean, ms": 0.03,
    "delivery": 0.01,
    "access failure": 0.005,
    "access failure, part": 0.25,
    "access delay, part": 0.05,
    "saturated throughput, part": 0.04,
    "hidden terminal": 0.015,
    "storm": 0.03,
}


@cache
def load(file: str) -> Data:
    """Return a file of the reference by its name without ending."""
    data: Data = json.loads((FOLDER / f"{file}.json").read_text("utf-8"))
    return data


def rows(file: str) -> list[Data]:
    """Return a file's rows (a row of a curve has rows of its own)."""
    data = load(file)
    found: list[Data] = data["series"] if "series" in data else data["rows"]
    return found
