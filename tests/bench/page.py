"""What a page of the docs shows of one taking: tables between two marks in the page, a figure, the data.

The words around them are written by hand and stay. The figure needs matplotlib; without it the old one stays.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from run import ROOT
from systems import CLIPS, installed

Data = dict[str, Any]
"""A taking, as it stands in the JSON."""

HEADER = ("workload", "size", "rival", "RMR, us a firing", "rival's", "ratio", "quartiles", "target")


def write(folder: Path, data: Data) -> None:
    """Renew the generated part of ``FOLDER.md``, and in the folder engine.json and engine.svg.

    Raises:
        ValueError: the page has no marks.
    """
    page = folder.with_suffix(".md")
    text = page.read_text("utf-8")
    page.write_text(renewed(text, tables(data)), "utf-8")
    folder.mkdir(exist_ok=True)
    (folder / "engine.json").write_text(json.dumps(data, indent=1) + "\n", "utf-8")
    if installed("matplotlib"):
        draw(data["comparisons"], folder / "engine.svg")


def add_options(parser: argparse.ArgumentParser, name: str) -> None:
    """Add the options that say where `keep` writes."""
    output = ROOT / "build" / f"bench-{name}.json"
    parser.add_argument("--output", type=Path, default=output, metavar="FILE", help="the data (default: %(default)s)")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the data into FOLDER, too")
    parser.add_argument("--page", type=Path, metavar="FILE", help="renew the table in a page")


def keep(options: argparse.Namespace, file: str, data: Data, what: str, lines: Sequence[str]) -> None:
    """Write a taking where the options say: its data, in a folder as `file`, and a table between the marks of a page.

    Raises:
        ValueError: the page has no marks for `what`.
    """
    text = json.dumps(data, indent=1) + "\n"
    for path in [options.output, *([options.write / file] if options.write else [])]:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    if options.page:
        options.page.write_text(renewed(options.page.read_text("utf-8"), "\n".join([*lines, ""]), what), "utf-8")


def renewed(text: str, generated: str, what: str = "taken") -> str:
    """Return a page's text with what stands between the marks replaced: ``<!-- what: begin -->`` and ``end``.

    Raises:
        ValueError: there are no marks.
    """
    marks = f"<!-- {what}: begin -->", f"<!-- {what}: end -->"
    before, begin, rest = text.partition(marks[0])
    _, end, after = rest.partition(marks[1])
    if not (begin and end):
        raise ValueError(f"the page has no {marks[0]} ... {marks[1]}")
    return f"{before}{marks[0]}\n{generated}{marks[1]}{after}"


def figure_rows(figures: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return single figures with their targets as the cells of a table."""
    return [
        (
            each["name"],
            f"{each['value']:.3g} {each['unit']}",
            ""
            if each["target"] is None
            else f"{'>=' if each.get('at_least') else '<='} {each['target']:g} {each['unit']}, {verdict(each['met'])}",
        )
        for each in figures
    ]


def rows(data: Data) -> list[tuple[str, ...]]:
    """Return the comparisons as the cells of a table; times include loading and are for each of RMR's firings."""
    return [
        (
            each["workload"],
            f"{each['size']:,}",
            each["rival"],
            _microseconds(each["rmr_s"], each["firings"]),
            _microseconds(each["rival_s"], each["firings"]) if each["rival_s"] else "not installed",
            f"{each['ratio']['median']:.3g}" if each["ratio"] else "",
            f"{each['ratio']['low']:.3g} - {each['ratio']['high']:.3g}" if each["ratio"] else "",
            "" if each["target"] is None else f"<= {each['target']:g}, {verdict(each['met'])}",
        )
        for each in data["comparisons"]
    ]


def _missed(row: Sequence[str]) -> bool:
    return row[-1].endswith("not met")


def _shown(row: Sequence[str]) -> tuple[str, ...]:
    """Return a row without its rival; one that is not CLIPS stands with the workload."""
    workload, size, rival, *rest = row
    return (workload if rival == CLIPS else f"{workload}, {rival}", size, *rest)


def _others(comparisons: Sequence[Data]) -> list[str]:
    """Return a line for each rival but CLIPS: the least and the greatest of its ratios."""
    ratios: dict[str, list[float]] = {}
    for each in comparisons:
        if each["rival"] != CLIPS and each["ratio"]:
            ratios.setdefault(each["rival"], []).append(each["ratio"]["median"])
    return [
        f"- {rival}: ratios {min(those):.3g} to {max(those):.3g}, {len(those)} workloads"
        for rival, those in ratios.items()
    ]


def _microseconds(timing: Data, firings: int) -> str:
    return f"{timing['total']['median'] / firings * 1e6:.2f}"


def verdict(met: bool | None) -> str:
    return {None: "not taken", True: "met", False: "not met"}[met]


def tables(data: Data) -> str:
    """Return the taking in Markdown: when and where, the comparisons with CLIPS, the costs that have a target.

    Of the other rivals it has the range of their ratios, and each target that is missed; the data have all.
    """
    machine = data["machine"]
    where = f"{machine['cores']} cores, {machine['system']}, CPython {machine['python']}, {data['rounds']} rounds"
    rivals = ", ".join(f"{name} {number}" for name, number in data["rivals"].items())
    lines = [
        f"Taken {data['taken'][:10]}: {where}; engine: {data['engine']}. Rivals: {rivals or 'none'}.",
        "",
        *table((*HEADER[:2], *HEADER[3:]), [_shown(row) for row in rows(data) if row[2] == CLIPS or _missed(row)]),
        "",
        *_others(data["comparisons"]),
        "",
    ]
    aimed = [each for each in data["figures"] if each["target"] is not None]
    lines += table(("one machine", "taken", "target"), figure_rows(aimed))
    lines += [f"\nNot installed: {', '.join(data['not installed'])}."] if data["not installed"] else []
    return "\n".join(lines) + "\n"


def table(header: Sequence[str], lines: Sequence[Sequence[str]]) -> list[str]:
    """Return a table in Markdown."""
    return [f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *lines)]


def draw(comparisons: Sequence[Data], file: Path) -> None:
    """Draw the ratios to CLIPS with their quartiles on a log axis, and the targets."""
    import matplotlib as mpl
    from matplotlib import pyplot, ticker

    mpl.rcParams["svg.hashsalt"] = "engine"  # the same figure for the same data
    shown = [each for each in comparisons if each["rival"] == CLIPS and each["ratio"]][::-1]
    places = range(len(shown))
    medians = [each["ratio"]["median"] for each in shown]
    below = [each["ratio"]["median"] - each["ratio"]["low"] for each in shown]
    above = [each["ratio"]["high"] - each["ratio"]["median"] for each in shown]
    figure, axes = pyplot.subplots(figsize=(7, 0.42 * len(shown) + 1.2), layout="constrained")
    axes.axvline(1.0, color="0.5", linewidth=1)
    axes.errorbar(medians, places, xerr=[below, above], fmt="o", color="tab:blue", capsize=3, label="RMR / CLIPS")
    axes.scatter([each["target"] for each in shown], places, marker="|", s=160, color="tab:red", label="target")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(ticker.NullLocator())
    axes.set_yticks(list(places), [each["workload"] for each in shown])
    axes.set_xlabel("processor time over that of CLIPS: median of the rounds, quartiles")
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    pyplot.close(figure)
