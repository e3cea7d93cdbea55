"""The figures of docs/radio-validation.md, drawn with matplotlib of the `bench` extra.

Everywhere ns-3 is a grey line or mark, our model in mode ``awgn`` blue, in mode ``capture_3db`` orange; bars are 95 %
intervals. Text stays text, so that the files are small and can be searched; the same data give the same file.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import curves
import overlaps
from reference import rows
from verdicts import Data

NS3, AWGN, CAPTURE = "0.45", "tab:blue", "tab:orange"
SIZE = (7.0, 3.4)
LOADS = (10, 50, 100, 200)
SENDERS = (1, 2, 10, 50)
CASES = ("exposed_control", "hidden", "near_far_hidden")
MEMBERS = (5, 10, 50)
MARKS = ("o", "s", "^", "D")


def draw_all(folder: Path, data: Data) -> None:
    """Draw every figure into `folder` as SVG."""
    import matplotlib as mpl
    from matplotlib import pyplot

    mpl.rcParams |= {"svg.hashsalt": "radio", "svg.fonttype": "none", "font.size": 9, "axes.axisbelow": True}
    checks = {(check["file"], check["row"], check["quantity"]): check for check in data["checks"]}
    for name, (columns, draw) in FIGURES.items():
        figure, axes = pyplot.subplots(1, columns, figsize=SIZE, layout="constrained", squeeze=False)
        draw(axes[0], data if name in ("modes", "rounds") else checks)
        for each in axes[0]:
            each.grid(color="0.92")
        figure.savefig(folder / f"{name}.svg", format="svg", metadata={"Date": None, "Creator": None})
        pyplot.close(figure)


def per(axes: Any, _: Any) -> None:
    """Packet error over the ratio of signal to noise."""
    (each,) = axes
    table = rows("per_vs_snr")
    for octets, shade in ((5, "C0"), (20, "C2"), (50, "C1"), (127, "C3")):
        ratios = [row["snr_db"] for row in table]
        ours = [1.0 - curves.alone(10.0 ** (ratio / 10.0), octets) for ratio in ratios]
        each.plot(ratios, ours, color=shade, linewidth=1, label=f"PSDU of {octets}")
        some = table[::12]
        theirs = [row[f"per_air_{octets}"] for row in some]
        each.plot([row["snr_db"] for row in some], theirs, ".", color=shade, markersize=4)
    each.plot([], [], ".", color=NS3, label="ns-3")
    _finish(each, "signal to noise, dB", "packet error rate")


def distance(axes: Any, _: Any) -> None:
    """Success over distance at three sensitivities."""
    for each, sensitivity in zip(axes, (-85.0, -95.0, -106.58), strict=True):
        for series, shade in zip(_series(sensitivity), ("C3", "C1", "C2"), strict=True):
            config = replace(curves.AWGN, sensitivity_dbm=sensitivity)
            metres = [row["d_m"] for row in series["rows"]]
            ours = [curves.point(metre, series["psdu_bytes"], config).success for metre in metres]
            each.plot(metres, ours, color=shade, linewidth=1, label=f"PSDU of {series['psdu_bytes']}")
            each.plot(metres, [row["success"] for row in series["rows"]], ".", color=shade, markersize=3)
        falling = [metre for metre, value in zip(metres, ours, strict=True) if 0.001 < value < 0.999]
        each.set_xlim(falling[0] * 0.9, falling[-1] * 1.1)
        _finish(each, "metres", "frames received" if sensitivity == -85.0 else "")
        each.set_title(f"{sensitivity:g} dBm", fontsize=9)


def _series(sensitivity: float) -> list[Data]:
    return [series for series in rows("psr_vs_distance") if series["rx_sensitivity_dbm"] == sensitivity]


def _points(
    each: Any, checks: Data, keys: Sequence[tuple[str, str, str]], places: Sequence[Any], mark: str, label: str
) -> None:
    """Plot ours and ns-3's of the checks `keys` at `places`."""
    found = [(place, checks[key]) for place, key in zip(places, keys, strict=True) if key in checks]
    if not found:
        return
    x = [place for place, _ in found]
    for side, shade, line in (("theirs", NS3, "-"), ("ours", AWGN, "none")):
        means = [check[side] for _, check in found]
        halves = [check.get(f"{side}_half", 0.0) for _, check in found]
        style = {"marker": mark, "markersize": 4} if side == "ours" else {}
        each.errorbar(x, means, yerr=halves, color=shade, linestyle=line, linewidth=1, capsize=2, **style)
    each.annotate(label, (x[-1], found[-1][1]["theirs"]), textcoords="offset points", xytext=(4, 0), fontsize=8)


def contention(axes: Any, checks: Data) -> None:
    """Delivery, access failure and access delay over the load."""
    quantities = ("delivery_ratio_sink", "channel_access_failure_ratio", "mean_access_delay_ms")
    for each, quantity, label in zip(
        axes, quantities, ("delivered", "access failures", "access delay, ms"), strict=True
    ):
        for senders, mark in zip(SENDERS[1:], MARKS, strict=False):
            keys = [("contention", f"broadcast, {senders} senders, {load} frames/s", quantity) for load in LOADS]
            _points(each, checks, keys, LOADS, mark, str(senders))
        _finish(each, "frames/s of all senders", label, legend=False)


def hidden(axes: Any, checks: Data) -> None:
    """Delivery of hidden, near and far, and exposed stations over the load."""
    loads = (5, 10, 25, 50, 100)
    for each, kind in zip(axes, ("broadcast", "unicast"), strict=True):
        for case, mark in zip(CASES, MARKS, strict=False):
            keys = [
                ("hidden_terminal", f"{case}, {kind}, {load} frames/s each", "both_delivery_ratio") for load in loads
            ]
            _points(each, checks, keys, loads, mark, case.replace("_", " "))
        _finish(each, "frames/s of each station", "delivered", legend=False)
        each.set_title(kind, fontsize=9)
        each.set_xlim(0, 150)


def storms(axes: Any, checks: Data) -> None:
    """Replies received over the jitter."""
    jitters = (0, 5, 10, 20, 50, 100, 200, 500)
    for each, kind in zip(axes, ("broadcast", "unicast"), strict=True):
        for members, mark in zip(MEMBERS, MARKS, strict=False):
            keys = [
                ("reply_storm", f"{kind}, {members} members, {jitter} ms, circle", "reply_delivery_ratio")
                for jitter in jitters
            ]
            _points(each, checks, keys, jitters, mark, str(members))
        each.set_xscale("symlog", linthresh=5)
        each.set_xticks(jitters, [str(jitter) for jitter in jitters])
        each.set_xlim(-0.5, 1200)
        _finish(each, "jitter of the replies, ms", "replies received", legend=False)
        each.set_title(kind, fontsize=9)


def capture(axes: Any, _: Any) -> None:
    """The first of two overlapping frames, and in capture_3db the second, over the SIR."""
    for each, index in zip(axes, (0, 5), strict=True):
        series = rows("capture_overlap")[index]
        ratios = [row["sir_db"] for row in series["rows"]]
        each.plot(ratios, [row["first_ok"]["p"] for row in series["rows"]], ".", color=NS3, label="ns-3: first")
        for config, shade, name in ((overlaps.AWGN, AWGN, "awgn"), (overlaps.CAPTURE, CAPTURE, "capture_3db")):
            ours = [overlaps.pair(config, ratio, series["offset_us"]) for ratio in ratios]
            each.plot(ratios, [first for first, _ in ours], color=shade, linewidth=1, label=f"{name}: first")
            each.plot(ratios, [second for _, second in ours], "--", color=shade, linewidth=1, label=f"{name}: second")
        _finish(each, "first over second, dB", "received", legend=False)
        each.legend(frameon=False, fontsize=7, loc="center left")
        each.set_title(f"second {series['offset_us']:g} us later", fontsize=9)


def modes(axes: Any, data: Data) -> None:
    """Delivery of broadcasts and of replies: ns-3, awgn, capture_3db."""
    for each, file, which in zip(axes, ("contention", "reply_storm"), ("10 senders", "10 members"), strict=True):
        found = [
            row for row in data["modes"] if row["file"] == file and which in row["row"] and "satur" not in row["row"]
        ]
        places = [float(row["row"].split(", ")[2].split()[0]) for row in found]
        for side, shade in (("ns-3", NS3), ("awgn", AWGN), ("capture_3db", CAPTURE)):
            shown = [(place, row[side]["mean"]) for place, row in zip(places, found, strict=True) if row[side]]
            each.plot(*zip(*shown, strict=True), marker=".", color=shade, linewidth=1, label=side)
        _finish(each, "frames/s" if file == "contention" else "jitter, ms", "received")
        each.set_title(f"broadcasts, {which}", fontsize=9)
        if file == "reply_storm":
            each.set_xscale("symlog", linthresh=5)


def rounds(axes: Any, data: Data) -> None:
    """Frames and airtime of a scheduling round over the size of the group."""
    for each, quantity, label in zip(
        axes, ("frames", "airtime_ms"), ("frames a round", "airtime a round, ms"), strict=True
    ):
        members = [row["members"] for row in data["rounds"]]
        found = [row["round"][quantity] for row in data["rounds"]]
        halves = [(field["ci95"][1] - field["ci95"][0]) / 2.0 for field in found]
        means = [field["mean"] for field in found]
        each.errorbar(members, means, yerr=halves, color=CAPTURE, marker="o", markersize=4, linewidth=1, capsize=2)
        each.set_ylim(bottom=0.0)
        _finish(each, "robots of the group", label, legend=False)


def _finish(each: Any, x: str, y: str, legend: bool = True) -> None:
    each.set_xlabel(x)
    each.set_ylabel(y)
    if legend:
        each.legend(frameon=False, fontsize=8)


FIGURES: dict[str, tuple[int, Callable[[Any, Any], None]]] = {
    "per": (1, per),
    "distance": (3, distance),
    "contention": (3, contention),
    "hidden": (2, hidden),
    "storms": (2, storms),
    "capture": (2, capture),
    "modes": (2, modes),
    "rounds": (2, rounds),
}
"""Name -> how many panels, and what draws them."""
