"""What has to be measured: the experiments of `rmr.radio.trials` at each row of the reference, and how it is judged.

A row of the reference becomes a case with the same stations, traffic and radio, run with as many seeds and as long as
an `Effort` says. A full effort goes on with more seeds until every judged quantity is known to half its tolerance, so
that the verdict is about the model and not about luck; a short one allows for luck instead (`verdicts`).

Which quantities are judged, and how closely, are the tables below; everything else that ns-3 measured is shown.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from math import sqrt
from typing import Any, NamedTuple

from curves import crossing, likely, point
from reference import TOLERANCES, rows
from verdicts import NARROW, Check, Data, Estimate, compared, equal, estimate, proportion

from rmr.radio.phy import RadioConfig
from rmr.radio.trials import REFERENCE, Runs, contention, hidden, latency, link, overlap, storm

FILES = ("psr_vs_distance", "latency_single_hop", "contention", "hidden_terminal", "capture_overlap", "reply_storm")

NO_TOLERANCE = "no tolerance is stated"
OVER_CAPACITY = "over capacity: the queue grows with the time that is measured"
NEAR_CAPACITY = "so near capacity that the delay hangs on the last half percent of load that chance offers"
BLURRED = "ns-3's own interval is wider than half the tolerance: all such rows are judged together"
TIGHT = 1.0 / 8.0
"""Share of each of the eight backoffs of an idle channel."""
RARE = 3.72
"""Normal deviations that are exceeded once in 10,000 times."""
DRAWN = (0.02, 0.98)
"""Over distance, frames are sent where their chance is neither nothing nor certainty."""


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

Rule = float | tuple[float, float] | None
"""A tolerance: absolute, or the greater of an absolute and a relative one, or None."""

CONTENTION: dict[str, Rule] = {
    "delivery_ratio_sink": TOLERANCES["delivery"],
    "delivery_ratio_all_receivers": TOLERANCES["delivery"],
    "channel_access_failure_ratio": (TOLERANCES["access failure"], TOLERANCES["access failure, part"]),
    "mean_access_delay_ms": (0.0, TOLERANCES["access delay, part"]),
    "throughput_sink_fps": (0.0, TOLERANCES["saturated throughput, part"]),
}
HIDDEN: dict[str, Rule] = {
    "delivery_ratio": TOLERANCES["hidden terminal"],
    "caf_ratio": TOLERANCES["hidden terminal"],
    "no_ack_ratio": TOLERANCES["hidden terminal"],
}
STORM: dict[str, Rule] = {
    "discovery_heard_ratio": TOLERANCES["storm"],
    "reply_delivery_ratio": TOLERANCES["storm"],
    "channel_access_failure_ratio": TOLERANCES["storm"],
    "no_ack_ratio": TOLERANCES["storm"],
    "all_replies_received_prob": TOLERANCES["storm"],
    "member_hears_other_reply_ratio": TOLERANCES["storm"],
}
COUNTED_BY_NS3 = ("events_per_rep",)
"""What says how much ns-3 worked and nothing about the radio."""


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


def checks(file: str, index: int, ours: Data, slack: bool = False) -> Iterator[Check]:
    """Yield the checks of our row against row `index` of a file of the reference."""
    return JUDGES[file](rows(file)[index], ours, slack)


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


def _compare(where: tuple[str, str, str], ours: Data, theirs: Data, rule: Rule, unjudged: str, slack: bool) -> Check:
    """Return the check of a field of the reference's form by its rule."""
    known = estimate(theirs)
    absolute, part = rule if isinstance(rule, tuple) else (rule, 0.0)
    tolerance = None if absolute is None or unjudged else max(absolute, part * abs(known.mean))
    reason = unjudged or ("" if tolerance is not None else NO_TOLERANCE)
    return compared(where, estimate(ours), known, tolerance, reason, slack)


# -- contention ---------------------------------------------------------------------------------------------------


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


def label_contention(row: Data) -> str:
    """Return which scenario of contention.json a row is."""
    load = "saturated" if row["saturated"] else f"{row['offered_total_fps']:g} frames/s"
    return f"{row['type'].partition('_')[0]}, {row['N_senders']} senders, {load}"


def _judge_contention(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    unicast = theirs["type"] != "broadcast"
    near_capacity = unicast and theirs["N_senders"] <= 2 and theirs["offered_total_fps"] == 200
    for name, field in theirs.items():
        if not isinstance(field, dict) or name in COUNTED_BY_NS3:
            continue
        rule = CONTENTION.get(name)
        if name == "throughput_sink_fps" and not theirs["saturated"]:
            rule = None
        unjudged = NEAR_CAPACITY if near_capacity and name.endswith("_ms") else ""
        where = ("contention", label_contention(theirs), name)
        yield _compare(where, ours[name], field, rule, unjudged, slack)


# -- hidden stations ----------------------------------------------------------------------------------------------


def _hidden(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    load = theirs["load_per_node_fps"]
    seconds = effort.frames / (2.0 * load) if load else max(effort.frames / SATURATED_PAIR_FPS, effort.saturated_s)
    case = hidden.Hidden(theirs["case"], load, theirs["payload_bytes"], theirs["type"] != "broadcast", seconds)
    return _until_narrow(lambda runs: hidden.run(case, runs), "hidden_terminal", theirs, effort, config, effort.seeds)


SATURATED_PAIR_FPS = 300.0
"""About what two saturated stations offer."""


def label_hidden(row: Data) -> str:
    """Return which scenario of hidden_terminal.json a row is."""
    load = "saturated" if row["saturated"] else f"{row['load_per_node_fps']:g} frames/s each"
    return f"{row['case']}, {row['type'].partition('_')[0]}, {load}"


def _judge_hidden(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    over = theirs["type"] != "broadcast" and theirs["case"] != "exposed_control" and theirs["load_per_node_fps"] == 100
    unjudged = OVER_CAPACITY if over else ""
    label = label_hidden(theirs)
    for station in ("A", "C"):
        for name, field in theirs[station].items():
            where = ("hidden_terminal", label, f"{station}: {name}")
            yield _compare(where, ours[station][name], field, HIDDEN.get(name), unjudged, slack)
    where = ("hidden_terminal", label, "both_delivery_ratio")
    both = "both_delivery_ratio"
    yield _compare(where, ours[both], theirs[both], TOLERANCES["hidden terminal"], unjudged, slack)


# -- storms -------------------------------------------------------------------------------------------------------


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


def label_storm(row: Data) -> str:
    """Return which scenario of reply_storm.json a row is."""
    kind = row["replies"].partition("_")[0]
    return f"{kind}, {row['N_members']} members, {row['reply_jitter_ms']:g} ms, {geometry(row)}"


def geometry(row: Data) -> str:
    """Return where the members of a row of reply_storm.json stand: ``circle`` or ``disk``."""
    return "circle" if row["geometry"].startswith("circle") else "disk"


def _judge_storm(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    for name, field in theirs.items():
        if not isinstance(field, dict):
            continue
        blurred = name == "all_replies_received_prob" and estimate(field).half > TOLERANCES["storm"] * NARROW
        where = ("reply_storm", label_storm(theirs), name)
        yield _compare(where, ours[name], field, STORM.get(name), BLURRED if blurred else "", slack)


def together(blurred: Sequence[Check], file: str) -> Check:
    """Return the one check of many whose reference is too uncertain to judge each: their mean square deviation.

    Each difference is divided by its standard deviation; if the model is right the mean of the squares is 1.
    """
    squares = [_square(check) for check in blurred if check.ours_half or check.theirs_half]
    where = (file, f"{len(squares)} rows whose interval is wide", "mean square of the standard deviations off")
    bound = RARE * sqrt(2.0 / len(squares))
    # Fewer differences than chance makes are no fault: only what is over 1 counts.
    return compared(where, Estimate(max(1.0, sum(squares) / len(squares))), Estimate(1.0), bound)


def _square(check: Check) -> float:
    assert check.difference is not None
    variance = (check.ours_half**2 + check.theirs_half**2) / 1.96**2
    return check.difference**2 / variance


# -- one sender alone ---------------------------------------------------------------------------------------------


def _latency(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    case = latency.Latency(theirs["payload_bytes"], theirs["unicast_ack"], 5 * effort.counted)
    return latency.run(case, Runs(config, range(1, effort.seeds + 1)))


def _judge_latency(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    label = f"payload of {theirs['payload_bytes']}, {'unicast' if theirs['unicast_ack'] else 'broadcast'}"
    yield equal(("latency_single_hop", label, "all delivered"), ours["delivered"] == ours["n"], True)
    for part in ("access", "oneway", "confirm"):
        mine, other = ours[f"hist_{part}_us"], theirs[f"hist_{part}_us"]
        where = ("latency_single_hop", label, f"{part}: values, us")
        yield equal(where, [int(us) for us in mine], sorted(int(us) for us in other))
        means = [Estimate(row[f"{part}_ms"]["mean"], row["ci95_mean_halfwidth_ms"]) for row in (ours, theirs)]
        where = ("latency_single_hop", label, f"{part}: mean, ms")
        yield compared(where, *means, TOLERANCES["idle mean, ms"], slack=slack)
    total = sum(ours["hist_access_us"].values())
    odd = sum(not likely(TIGHT, count / total, total) for count in ours["hist_access_us"].values())
    where = ("latency_single_hop", label, "access: values that do not come an eighth of the times")
    yield compared(where, Estimate(float(odd)), Estimate(0.0), 0.0)


# -- frames drawn over distance, and in pairs -----------------------------------------------------------------------


def _distance(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    config = replace(config, sensitivity_dbm=theirs["rx_sensitivity_dbm"])
    octets = theirs["psdu_bytes"]
    runs = Runs(config, range(1, effort.seeds + 1))
    chances = [(row["d_m"], point(row["d_m"], octets, config).success) for row in theirs["rows"]]
    asked = [distance for distance, chance in chances if DRAWN[0] < chance < DRAWN[1]]
    return {"rows": [link.drawn(distance, octets, runs, effort.counted) for distance in asked]}


def _judge_distance(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    name = f"PSDU of {theirs['psdu_bytes']}, sensitivity {theirs['rx_sensitivity_dbm']:g} dBm"
    curves = [[(row["d_m"], row["success"]) for row in side["rows"]] for side in (ours, theirs)]
    means = [crossing(curve, 0.5) for curve in curves]
    # Where the curve is steepest, one deviation of the count is so many metres.
    slope = max(abs(b[1] - a[1]) / (b[0] - a[0]) for a, b in zip(curves[1], curves[1][1:], strict=False))
    halves = [proportion(side["rows"][0]["n"] // 2, side["rows"][0]["n"]).half / slope for side in (ours, theirs)]
    pair = [Estimate(mean, half) for mean, half in zip(means, halves, strict=True)]
    where = ("psr_vs_distance", name, "distance of 50% of frames sent, m")
    yield compared(where, *pair, TOLERANCES["crossing, m"], slack=slack)


def _overlap(theirs: Data, effort: Effort, config: RadioConfig) -> Data:
    runs = Runs(config, range(1, effort.seeds + 1))
    found = []
    for row in theirs["rows"]:
        if not DOUBTFUL_DB[0] <= row["sir_db"] <= DOUBTFUL_DB[1]:
            continue
        case = overlap.Overlap(float(row["sir_db"]), theirs["offset_us"], count=max(1, effort.counted // 10))
        found.append(overlap.run(case, runs))
    return {"rows": found}


def _judge_overlap(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    name = f"second frame {theirs['offset_us']:g} us later"
    curves = [sorted((-row["sir_db"], row["first_ok"]["p"]) for row in side["rows"]) for side in (ours, theirs)]
    halves = [proportion(side["rows"][0]["n"] // 2, side["rows"][0]["n"]).half for side in (ours, theirs)]
    steep = max(a[1] - b[1] for a, b in zip(curves[1], curves[1][1:], strict=False)) / SIR_STEP_DB
    pair = [Estimate(-crossing(curve, 0.5), half / steep) for curve, half in zip(curves, halves, strict=True)]
    where = ("capture_overlap", name, "SIR at which half of the first frames sent survive, dB")
    yield compared(where, *pair, SIR_STEP_DB / 2.0, slack=slack)
    seconds = sum(row["second_ok"]["k"] for row in ours["rows"])
    where = ("capture_overlap", name, "second frames received of all that are sent")
    yield equal(where, seconds, sum(row["second_ok"]["k"] for row in theirs["rows"]))


SIR_STEP_DB = 0.5
"""From one point of capture_overlap.json to the next."""
DOUBTFUL_DB = (-4.0, 4.0)
"""Pairs of frames are sent where it is not certain what becomes of the first."""

MEASURES: dict[str, Callable[[Data, Effort, RadioConfig], Data]] = {
    "psr_vs_distance": _distance,
    "latency_single_hop": _latency,
    "contention": _contention,
    "hidden_terminal": _hidden,
    "capture_overlap": _overlap,
    "reply_storm": _storm,
}
JUDGES: dict[str, Callable[[Data, Data, bool], Iterator[Check]]] = {
    "psr_vs_distance": _judge_distance,
    "latency_single_hop": _judge_latency,
    "contention": _judge_contention,
    "hidden_terminal": _judge_hidden,
    "capture_overlap": _judge_overlap,
    "reply_storm": _judge_storm,
}
