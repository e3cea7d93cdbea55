"""How a row that was measured is judged: which quantities, how closely, and which not at all.

The tables below are all there is; everything else that ns-3 measured is shown. The rows of both sides have the forms
of the reference files.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import sqrt

from curves import crossing, likely
from reference import TOLERANCES, rows
from verdicts import NARROW, Check, Data, Estimate, compared, equal, estimate, proportion

FILES = ("psr_vs_distance", "latency_single_hop", "contention", "hidden_terminal", "capture_overlap", "reply_storm")

NO_TOLERANCE = "no tolerance is stated"

OVER_CAPACITY = "over capacity: the queue grows with the time that is measured"

NEAR_CAPACITY = "near capacity the delay depends on the last half percent of the random load"

FORGOTTEN = "ns-3 forgets an interferer that ends inside the locked frame; judged below with the same fault added"
"""Of hidden stations under saturation, which transmit nearly all the time: most frames that get through at all have
begun inside another one that they survive the end of."""
FORGETFUL = (17,)
"""Rows of hidden_terminal.json that are judged with this fault of ns-3 imitated (`imitation`)."""
BLURRED = "ns-3's own interval is wider than half the tolerance: all such rows are judged together"

TIGHT = 1.0 / 8.0
"""Share of each of the eight backoffs of an idle channel."""

RARE = 3.72
"""Normal deviations that are exceeded once in 10,000 times."""

SIR_STEP_DB = 0.5
"""From one point of capture_overlap.json to the next."""

Rule = float | tuple[float, float] | None
"""A tolerance: absolute, or the greater of an absolute and a relative one, or None."""

CONTENTION: dict[str, Rule] = {
    "delivery_ratio_sink": TOLERANCES["delivery"],
    "delivery_ratio_all_receivers": TOLERANCES["delivery"],
    "channel_access_failure_ratio": (TOLERANCES["access failure"], TOLERANCES["access failure, part"]),
    "mean_access_delay_ms": (0.0, TOLERANCES["access delay, part"]),
    "throughput_sink_fps": (0.0, TOLERANCES["saturated throughput, part"]),
    # For these the reference states none; they are held to those of shares and of delays.
    "no_ack_ratio": TOLERANCES["delivery"],
    "duplicates_per_delivered": TOLERANCES["delivery"],
    "attempts_per_transmitted_frame": (0.0, TOLERANCES["access delay, part"]),
    "mean_service_ms": (0.0, TOLERANCES["access delay, part"]),
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


def checks(file: str, index: int, ours: Data, slack: bool = False, imitated: bool = False) -> Iterator[Check]:
    """Yield the checks of our row against row `index` of a file of the reference.

    Of a row in `FORGETFUL` only what was measured with ns-3's fault `imitated` is judged.
    """
    for check in JUDGES[file](rows(file)[index], ours, slack):
        if imitated:
            yield replace(check, row=f"{check.row}, ns-3's fault imitated")
        elif file == "hidden_terminal" and index in FORGETFUL and check.tolerance is not None:
            yield replace(check, tolerance=None, unjudged=FORGOTTEN)
        else:
            yield check


def _compare(where: tuple[str, str, str], ours: Data, theirs: Data, rule: Rule, unjudged: str, slack: bool) -> Check:
    """Return the check of a field of the reference's form by its rule."""
    known = estimate(theirs)
    absolute, part = rule if isinstance(rule, tuple) else (rule, 0.0)
    tolerance = None if absolute is None or unjudged else max(absolute, part * abs(known.mean))
    reason = unjudged or ("" if tolerance is not None else NO_TOLERANCE)
    return compared(where, estimate(ours), known, tolerance, reason, slack)


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


def label_hidden(row: Data) -> str:
    """Return which scenario of hidden_terminal.json a row is."""
    load = "saturated" if row["saturated"] else f"{row['load_per_node_fps']:g} frames/s each"
    return f"{row['case']}, {row['type'].partition('_')[0]}, {load}"


def over_capacity(row: Data) -> bool:
    """Whether more is offered in a row of hidden_terminal.json than the channel carries, repeats included."""
    return row["type"] != "broadcast" and row["case"] != "exposed_control" and row["load_per_node_fps"] == 100


def _judge_hidden(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    unjudged = OVER_CAPACITY if over_capacity(theirs) else ""
    label = label_hidden(theirs)
    for station in ("A", "C"):
        for name, field in theirs[station].items():
            where = ("hidden_terminal", label, f"{station}: {name}")
            yield _compare(where, ours[station][name], field, HIDDEN.get(name), unjudged, slack)
    where = ("hidden_terminal", label, "both_delivery_ratio")
    both = "both_delivery_ratio"
    yield _compare(where, ours[both], theirs[both], TOLERANCES["hidden terminal"], unjudged, slack)


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


def _judge_distance(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    name = f"PSDU of {theirs['psdu_bytes']}, sensitivity {theirs['rx_sensitivity_dbm']:g} dBm"
    curves = [[(row["d_m"], row["success"]) for row in side["rows"]] for side in (ours, theirs)]
    means = [crossing(curve, 0.5) for curve in curves]
    # Where the curve is steepest, one deviation of the count is so many metres.
    slope = max(abs(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(curves[1]))
    halves = [proportion(side["rows"][0]["n"] // 2, side["rows"][0]["n"]).half / slope for side in (ours, theirs)]
    pair = [Estimate(mean, half) for mean, half in zip(means, halves, strict=True)]
    where = ("psr_vs_distance", name, "distance of 50% of frames sent, m")
    yield compared(where, *pair, TOLERANCES["crossing, m"], slack=slack)


def _judge_overlap(theirs: Data, ours: Data, slack: bool) -> Iterator[Check]:
    name = f"second frame {theirs['offset_us']:g} us later"
    curves = [sorted((-row["sir_db"], row["first_ok"]["p"]) for row in side["rows"]) for side in (ours, theirs)]
    halves = [proportion(side["rows"][0]["n"] // 2, side["rows"][0]["n"]).half for side in (ours, theirs)]
    steep = max(a[1] - b[1] for a, b in pairwise(curves[1])) / SIR_STEP_DB
    pair = [Estimate(-crossing(curve, 0.5), half / steep) for curve, half in zip(curves, halves, strict=True)]
    where = ("capture_overlap", name, "SIR at which half of the first frames sent survive, dB")
    yield compared(where, *pair, SIR_STEP_DB / 2.0, slack=slack)
    seconds = sum(row["second_ok"]["k"] for row in ours["rows"])
    where = ("capture_overlap", name, "second frames received of all that are sent")
    yield equal(where, seconds, sum(row["second_ok"]["k"] for row in theirs["rows"]))


JUDGES: dict[str, Callable[[Data, Data, bool], Iterator[Check]]] = {
    "psr_vs_distance": _judge_distance,
    "latency_single_hop": _judge_latency,
    "contention": _judge_contention,
    "hidden_terminal": _judge_hidden,
    "capture_overlap": _judge_overlap,
    "reply_storm": _judge_storm,
}
