"""Draws a figure with matplotlib, as SVG.

The colours are those of Okabe and Ito ("Color Universal Design", 2008), which people with any common kind of colour
vision tell apart; series differ in mark and dash as well, groups of stacks in hatching, so that nothing rests on colour
alone. Text stays text: it can be searched, and read aloud. The same data give the same octets.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any
from warnings import catch_warnings, simplefilter

from rmr_view.chart import Figure, Panel, Series

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")
DASHES = ("-", "--", "-.", ":")
HATCHES = ("", "////", "xx", "----")
PANEL_INCHES = (4.4, 3.6)
STYLE: Any = {
    "svg.hashsalt": "rmr",
    "svg.fonttype": "none",
    "text.parse_math": False,  # a dollar in a label is a dollar
    "font.size": 9,
    "axes.axisbelow": True,
}
BAR_SHARE = 0.8
"""Width of the bars at one x, as a share of the distance between two."""


def draw(figure: Figure, path: Path) -> list[str]:
    """Draw `figure` into an SVG file; return matplotlib's warnings, such as characters missing in its font.

    Raises ImportError without matplotlib, OSError when the file cannot be written.
    """
    with catch_warnings(record=True) as doubts:
        simplefilter("always")
        _draw(figure, path)
    return list(dict.fromkeys(str(doubt.message) for doubt in doubts))


def _draw(figure: Figure, path: Path) -> None:
    import matplotlib as mpl  # noqa: PLC0415 - whoever only asks for help or names need not have it
    from matplotlib.figure import Figure as Canvas  # noqa: PLC0415

    count = len(figure.panels)
    width, height = (7.0, 4.2) if count == 1 else (PANEL_INCHES[0] * count, PANEL_INCHES[1])
    note = fill(figure.note, round(width * 15))  # characters per inch
    with mpl.rc_context(STYLE):
        # Height of one line of the note, inches.
        canvas = Canvas(figsize=(width, height + 0.16 * (note.count("\n") + 1)), layout="constrained")
        canvas.suptitle(figure.title, fontsize=10)
        canvas.supxlabel(note, fontsize=8, color="0.3")
        for axes, panel in zip(canvas.subplots(1, count, squeeze=False)[0], figure.panels, strict=True):
            _panel(axes, panel)
        told = {"Title": figure.title, "Description": figure.note, "Date": None, "Creator": None}
        canvas.savefig(path, format="svg", metadata=told)


def _panel(axes: Any, panel: Panel) -> None:
    bars = [series for series in panel.series if series.kind == "bars"]
    stacks = [series for series in panel.series if series.kind == "stack"]
    _bars(axes, panel, bars)
    _stacks(axes, panel, stacks)
    for index, series in enumerate(panel.series):
        if series.kind in {"line", "points"}:
            _points(axes, series, index)
    for line in panel.lines:
        axes.axhline(line.y, color="0.35", linewidth=1, linestyle=(0, (6, 3)))
        axes.annotate(
            line.label, (1.0, line.y), xycoords=("axes fraction", "data"), xytext=(-2, 2),
            textcoords="offset points", ha="right", fontsize=7, color="0.25",
        )  # fmt: skip
    _axes(axes, panel, from_zero=bool(bars or stacks))


def _axes(axes: Any, panel: Panel, *, from_zero: bool) -> None:
    axes.set_title(panel.title, fontsize=9)
    axes.set_xlabel(panel.x)
    axes.set_ylabel(panel.y)
    if panel.x_log:
        _log(axes.xaxis, axes.set_xscale)
    if panel.y_log:
        _log(axes.yaxis, axes.set_yscale)
    if panel.ticks:
        axes.set_xticks([tick.at for tick in panel.ticks], [tick.label for tick in panel.ticks])
    if from_zero and not panel.y_log:
        # Ratio of the height of the y axis to the highest bar, which leaves room for the legend above the bars.
        axes.set_ylim(0.0, 1.3 * axes.get_ylim()[1])
    elif panel.y_from is not None:
        axes.set_ylim(bottom=panel.y_from)
    axes.grid(axis="y", color="0.9")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(frameon=False, fontsize=7, ncols=2 if from_zero else 1, loc="upper left" if from_zero else "best")


def _log(axis: Any, set_scale: Any) -> None:
    """Make an axis logarithmic, with plain numbers at 1, 2 and 5 times powers of ten."""
    from matplotlib import ticker  # noqa: PLC0415 - as above

    set_scale("log")
    axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(ticker.NullLocator())


def _points(axes: Any, series: Series, index: int) -> None:
    mark = MARKS[index % len(MARKS)]
    colour = COLOURS[index % len(COLOURS)]
    dash = DASHES[index // 2 % len(DASHES)] if series.kind == "line" else "none"
    axes.errorbar(
        series.x, series.y, yerr=_reach(series), label=series.label, color=colour, marker=mark, markersize=4,
        linestyle=dash, linewidth=1.2, capsize=2,
    )  # fmt: skip


def _reach(series: Series) -> list[list[float]] | None:
    """Return how far a series's intervals reach below and above its points; None: it has none."""
    if series.low is None or series.high is None:
        return None
    below = [max(0.0, y - low) if low is not None else 0.0 for y, low in zip(series.y, series.low, strict=True)]
    above = [max(0.0, high - y) if high is not None else 0.0 for y, high in zip(series.y, series.high, strict=True)]
    return [below, above]


def _spacing(panel: Panel) -> float:
    """Return the least distance between two places of a panel's bars."""
    places = sorted({x for series in panel.series if series.kind in {"bars", "stack"} for x in series.x})
    return min((b - a for a, b in pairwise(places)), default=1.0)


def _bars(axes: Any, panel: Panel, bars: Sequence[Series]) -> None:
    at = {x: [series for series in bars if x in series.x] for x in dict.fromkeys(x for s in bars for x in s.x)}
    width = BAR_SHARE * _spacing(panel) / max(map(len, at.values()), default=1)
    for index, series in enumerate(bars):
        shifts = [(at[x].index(series) - (len(at[x]) - 1) / 2.0) * width for x in series.x]
        axes.bar(
            [x + shift for x, shift in zip(series.x, shifts, strict=True)], series.y, 0.92 * width,
            yerr=_reach(series), label=series.label, color=COLOURS[index % len(COLOURS)],
            hatch=HATCHES[index // 2 % len(HATCHES)], edgecolor="white", capsize=2, error_kw={"linewidth": 1},
        )  # fmt: skip


def _stacks(axes: Any, panel: Panel, stacks: Sequence[Series]) -> None:
    groups = list(dict.fromkeys(series.group for series in stacks))
    labels = list(dict.fromkeys(series.label for series in stacks))
    width = BAR_SHARE * _spacing(panel) / max(1, len(groups))
    tops: dict[tuple[str | None, float], float] = {}
    for series in stacks:
        number = groups.index(series.group)
        shift = (number - (len(groups) - 1) / 2.0) * width
        bottoms = [tops.get((series.group, x), 0.0) for x in series.x]
        name = series.label if series.group is None else f"{series.label}, {series.group}"
        axes.bar(
            [x + shift for x in series.x], series.y, 0.92 * width, bottom=bottoms, yerr=_reach(series), label=name,
            color=COLOURS[labels.index(series.label) % len(COLOURS)], hatch=HATCHES[number % len(HATCHES)],
            edgecolor="white", capsize=2, error_kw={"linewidth": 1},
        )  # fmt: skip
        tops |= {(series.group, x): b + y for x, b, y in zip(series.x, bottoms, series.y, strict=True)}
