"""What experiments have in common: their data, targets, figures and tables.

An experiment is a module; README.md in this folder says what it has. Its data are plain, so that a figure can be drawn
from the file alone: `figure` describes the chart (`rmr_view.chart` has the meaning of each part), `rmr plot` draws it.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol

Data = dict[str, Any]


class Experiment(Protocol):
    """A module of an experiment."""

    NAME: str
    SEEDS: Sequence[int]
    QUICK: Sequence[int]
    run: Callable[[Sequence[int], int], Data]
    tables: Callable[[Data], Mapping[str, Sequence[str]]]


def target(
    what: str, value: float, *, at_most: float | None = None, at_least: float | None = None, unit: str = ""
) -> Data:
    """Return a measured value beside the bound that it should keep."""
    assert (at_most is None) != (at_least is None), "one bound"
    bound = at_most if at_least is None else at_least
    assert bound is not None
    met = value <= bound if at_least is None else value >= bound
    return {"what": what, "value": value, "bound": bound, "at_least": at_least is not None, "unit": unit, "met": met}


def series(
    label: str,
    x: Iterable[float],
    y: Iterable[float],
    *,
    kind: str = "line",
    low: Iterable[float | None] | None = None,
    high: Iterable[float | None] | None = None,
    group: str | None = None,
) -> Data:
    """Return a series of a panel: a `line`, `points`, `bars` side by side, or a layer of a `stack` of its group."""
    data: Data = {"label": label, "kind": kind, "x": list(x), "y": list(y)}
    if low is not None and high is not None:
        data |= {"low": list(low), "high": list(high)}
    return data if group is None else data | {"group": group}


def panel(x: str, y: str, shown: Sequence[Data], *, title: str = "", **more: Any) -> Data:
    """Return a panel: what its axes show, with units, and its series; `more` as in `rmr_view.chart.Panel`."""
    return {"title": title, "x": x, "y": y, "series": list(shown), **more}


def figure(title: str, note: str, panels: Sequence[Data]) -> Data:
    """Return a figure; `note` says what is shown of how many runs, and what the bars are."""
    return {"title": title, "note": note, "panels": list(panels)}


def table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    """Return a table in Markdown."""
    return [f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *lines)]


def target_lines(targets: Iterable[Data]) -> list[tuple[str, ...]]:
    """Return targets as the cells of a table."""
    return [
        (
            each["what"],
            f"{each['value']:.4g} {each['unit']}".strip(),
            f"{'>=' if each['at_least'] else '<='} {each['bound']:g} {each['unit']}".strip(),
            "met" if each["met"] else "**missed**",
        )
        for each in targets
    ]


def renewed(text: str, lines: Sequence[str], mark: str) -> str:
    """Return a page's text with what stands between ``<!-- mark: begin -->`` and ``end`` replaced.

    Raises ValueError when the page lacks the marks.
    """
    begin, end = f"<!-- {mark}: begin -->", f"<!-- {mark}: end -->"
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"the page has no {begin} ... {end}")
    return "\n".join([f"{before}{begin}", *lines, f"{end}{after}"])


def as_json(data: Data) -> str:
    """Return data as JSON with a line for each element of its lists, so that a change is seen in a diff."""
    parts = []
    for key, value in data.items():
        if isinstance(value, list) and value:
            inside = ",\n  ".join(json.dumps(each) for each in value)
            parts.append(f" {json.dumps(key)}: [\n  {inside}\n ]")
        else:
            parts.append(f" {json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"
