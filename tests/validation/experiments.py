"""What has to be measured: the experiments of `rmr.radio.trials` at each row of the reference.

A row of the reference becomes a case with the same stations, traffic and radio, run with as many seeds and as long as
an `Effort` says. A full effort goes on with more seeds until every judged quantity is known to half its tolerance, so
that the verdict is about the model and not about luck; a short one allows for luck instead (`verdicts`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from curves import point
from judged import JUDGES, geometry, over_capacity
from reference import rows
from verdicts import Data

from rmr.radio.phy import RadioConfig
from rmr.radio.trials import REFERENCE, Runs, contention, hidden, latency, link, overlap, storm

DRAWN = (0.02, 0.98)
"""Over distance, frames are sent where their chance is neither nothing nor certainty."""

DOUBTFUL_DB = (-4.0, 4.0)
"""Pairs of frames are sent where it is not certain what becomes of the first."""

SATURATED_PAIR_FPS = 300.0
"""About what two saturated stations offer."""


class Effort(NamedTuple):
    """How much is run."""

    seeds: int
    """Replications at first."""
    frames: int
    """Of contention and hidden stations, in each replication, about."""
    storms: int
    """Replications of a storm at first, each one storm."""
    counted: int
    """Frames or pairs of a point of psr_vs_distance, capture_overlap and latency, in each replication."""
    saturated_s: float
    """Least time of a saturated replication: frames that are on their way when it ends count as lost."""
    until_narrow: bool = False
    """Whether to go on with more seeds until the intervals are narrow."""
    seeds_max: int = 640
    """Of contention and hidden stations."""
    storms_max: int = 3200


FULL = Effort(seeds=10, frames=1_000, storms=200, counted=200, saturated_s=3.0, until_narrow=True)

SHORT = Effort(seeds=10, frames=100, storms=60, counted=20, saturated_s=0.5)


class Kept:
    """Runs replications one after the other and keeps what they found, so that more seeds cost only the new ones."""

    def __init__(self) -> None:
        self._samples: dict[int, Any] = {}

    def __call__(self, trial: Callable[[int], Any], seeds: Sequence[int], /) -> Iterable[Any]:
        for seed in seeds:
            if seed not in self._samples:
                self._samples[seed] = trial(seed)
        return [self._samples[seed] for seed in seeds]


def measure(file: str, index: int, effort: Effort, config: RadioConfig = REFERENCE) -> Data:
    """Return our row for row `index` of a file of the reference."""
    return MEASURES[file](rows(file)[index], effort, config)


def _until_narrow(
    run: Callable[[Runs], Data], file: str, theirs: Data, effort: Effort, config: RadioConfig, seeds: int
) -> Data:
    kept = Kept()
    most = effort.storms_max if file == "reply_storm" else effort.seeds_max
    while True:
        ours = run(Runs(config, range(1, seeds + 1), kept))
        if not effort.until_narrow or seeds >= most or all(each.narrow for each in JUDGES[file](theirs, ours, False)):
            return ours
        seeds *= 2


def _contention(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    offered = theirs["offered_total_fps"]
    # Under saturation as many frames are offered as leave, one way or the other.
    rate = offered or theirs["throughput_sink_fps"]["mean"] / theirs["delivery_ratio_sink"]["mean"]
    case = contention.Contention(
        theirs["N_senders"],
        offered,
        theirs["payload_bytes"],
        theirs["type"] != "broadcast",
        max(effort.frames / rate, 0.0 if offered else effort.saturated_s),
        min(float(theirs["warmup_s"]), effort.saturated_s),
    )
    return _until_narrow(lambda runs: contention.run(case, runs), "contention", theirs, effort, config, effort.seeds)


def _hidden(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    load = theirs["load_per_node_fps"]
    seconds = effort.frames / (2.0 * load) if load else max(effort.frames / SATURATED_PAIR_FPS, effort.saturated_s)
    if effort.until_narrow and over_capacity(theirs):
        # The longer one looks, the longer the queue: only what was measured as long can be set beside it at all.
        seconds = theirs["measured_s_per_rep"]
    case = hidden.Hidden(theirs["case"], load, theirs["payload_bytes"], theirs["type"] != "broadcast", seconds)
    return _until_narrow(lambda runs: hidden.run(case, runs), "hidden_terminal", theirs, effort, config, effort.seeds)


def _storm(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    case = storm.Storm(
        theirs["N_members"],
        theirs["reply_jitter_ms"],
        geometry(theirs),
        theirs["payload_bytes"],
        theirs["replies"] != "broadcast",
        theirs["discovery_payload_bytes"],
    )
    # Many answers tell as much as many storms.
    seeds = max(effort.seeds, round(effort.storms * 5 / theirs["N_members"]))
    return _until_narrow(lambda runs: storm.run(case, runs), "reply_storm", theirs, effort, config, seeds)


def _latency(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    case = latency.Latency(theirs["payload_bytes"], theirs["unicast_ack"], 5 * effort.counted)
    return latency.run(case, Runs(config, range(1, effort.seeds + 1)))


def _distance(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    config = replace(config, sensitivity_dbm=theirs["rx_sensitivity_dbm"])
    octets = theirs["psdu_bytes"]
    chances = [(row["d_m"], point(row["d_m"], octets, config).success) for row in theirs["rows"]]
    kept = {distance: Kept() for distance, chance in chances if DRAWN[0] < chance < DRAWN[1]}

    def run(runs: Runs) -> Data:
        return {
            "rows": [
                link.drawn(distance, octets, Runs(config, runs.seeds, over), effort.counted)
                for distance, over in kept.items()
            ]
        }

    return _until_narrow(run, "psr_vs_distance", theirs, effort, config, effort.seeds)


def _overlap(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    kept = {row["sir_db"]: Kept() for row in theirs["rows"] if DOUBTFUL_DB[0] <= row["sir_db"] <= DOUBTFUL_DB[1]}
    cases = {
        sir_db: overlap.Overlap(float(sir_db), theirs["offset_us"], count=max(1, effort.counted // 10))
        for sir_db in kept
    }

    def run(runs: Runs) -> Data:
        return {"rows": [overlap.run(cases[sir_db], Runs(config, runs.seeds, over)) for sir_db, over in kept.items()]}

    return _until_narrow(run, "capture_overlap", theirs, effort, config, effort.seeds)


MEASURES: dict[str, Callable[[Data, Effort, RadioConfig], Data]] = {
    "psr_vs_distance": _distance,
    "latency_single_hop": _latency,
    "contention": _contention,
    "hidden_terminal": _hidden,
    "capture_overlap": _overlap,
    "reply_storm": _storm,
}
