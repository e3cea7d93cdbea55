"""The report of a validation: its data, the tables of docs/radio-validation.md, and the figures.

The words of the page are written by hand; each table stands between two marks and is renewed from the data. The rows of
all checks are in the data alone, validation.json beside the figures, and so is why some are not judged: the page has
their sums, and names each that is missed.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import figures
import judged
import mutations
from experiments import Effort
from reference import TOLERANCES, rows
from verdicts import MET, MISSED, SHOWN, Check, Data, tally

import rmr

HEADER = ("scenario", "quantity", "ours", "ns-3", "difference", "tolerance", "verdict")
LABELS: dict[str, Callable[[Data], str]] = {
    "contention": judged.label_contention,
    "reply_storm": judged.label_storm,
}
MODES = {"contention": "delivery_ratio_sink", "reply_storm": "reply_delivery_ratio"}
"""What is compared between the modes of interference."""
ROUNDS = (2, 5, 10, 20, 50)
"""Numbers of robots whose rounds the page shows."""

Cells = tuple[str, ...]


def gathered(checks: Sequence[Check], found: Mapping[Any, Data], effort: Effort) -> Data:
    """Return everything that a validation found, as plain data."""
    jobs: dict[str, list[Any]] = {}
    for job in sorted(found):
        jobs.setdefault(job.kind, []).append(job)
    noticed = {job.name: found[job]["noticed"] for job in jobs.get("mutation", ())}
    failed = {(family, mutations.kind(quantity)) for each in noticed.values() for family, _, quantity in each}
    guarded = [pair for job in jobs.get("guarded", ()) for pair in found[job]["guarded"]]
    return {
        "version": rmr.__version__,
        "seeds": f"1 to {effort.seeds}, and more where an interval asked for it",
        "effort": effort._asdict(),
        "tolerances": TOLERANCES,
        "checks": [check.as_data() for check in checks],
        "modes": [_modes(job, found) for job in jobs.get("capture", ())],
        "rounds": [found[job] for job in jobs.get("rounds", ())],
        "discovery": [found[job] for job in jobs.get("discovery", ())],
        "mutations": [
            {"rule": rule, "noticed": _families(noticed[rule]), "checks": len(noticed[rule])}
            for rule in mutations.NAMES
            if rule in noticed
        ],
        "guarded": len(guarded),
        "unguarded": [
            [family, quantity] for family, quantity in guarded if noticed and (family, quantity) not in failed
        ],
    }


def _families(noticed: Iterable[Sequence[str]]) -> dict[str, int]:
    """Return how many checks of each family are in `noticed`."""
    counts: dict[str, int] = {}
    for family, *_ in noticed:
        counts[family] = counts.get(family, 0) + 1
    return counts


def _modes(job: Any, found: Mapping[Any, Data]) -> Data:
    """Return one scenario in both modes of interference, and in ns-3."""
    theirs, capture = rows(job.name)[job.which], found[job]
    awgn = found.get(job._replace(kind="row"))
    field = MODES[job.name]
    sides = {"awgn": awgn, "capture_3db": capture, "ns-3": theirs}
    values = {name: side and side[field] for name, side in sides.items()}
    return {"file": job.name, "row": LABELS[job.name](theirs), "quantity": field, **values}


def write(folder: Path, data: Data) -> None:
    """Renew validation.json and the figures in `folder`, and the tables of the page of its name beside it.

    Raises:
        ValueError: the page lacks a pair of marks.
    """
    folder.mkdir(parents=True, exist_ok=True)
    page = folder.parent / f"{folder.name}-validation.md"
    page.write_text(renewed_page(page.read_text("utf-8"), data), "utf-8")
    (folder / "validation.json").write_text(as_json(data), "utf-8")
    if find_spec("matplotlib") is not None:
        figures.draw_all(folder, data)


def as_json(data: Data) -> str:
    """Return the data with one line for each check and row."""
    parts = []
    for key, value in data.items():
        if isinstance(value, list):
            lines = ",\n".join(json.dumps(each, separators=(",", ":")) for each in value)
            parts.append(f"{json.dumps(key)}:[\n{lines}\n]")
        else:
            parts.append(f"{json.dumps(key)}:{json.dumps(value)}")
    return "{" + ",\n".join(parts) + "}\n"


def renewed_page(text: str, data: Data) -> str:
    """Return the page's text with all its tables renewed."""
    for what, lines in tables(data).items():
        text = renewed(text, "\n".join(lines) + "\n", what)
    return text


def renewed(text: str, generated: str, what: str) -> str:
    """Return a page's text with what stands between ``<!-- what: begin -->`` and ``end`` replaced."""
    marks = f"<!-- {what}: begin -->", f"<!-- {what}: end -->"
    before, begin, rest = text.partition(marks[0])
    _, end, after = rest.partition(marks[1])
    if not (begin and end):
        raise ValueError(f"the page has no {marks[0]} ... {marks[1]}")
    return f"{before}{marks[0]}\n{generated}{marks[1]}{after}"


def table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    """Return a table in Markdown."""
    return [f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *lines)]


def tables(data: Data) -> dict[str, list[str]]:
    """Return all tables of the page by what their marks say."""
    return {
        "summary": _summary(data),
        "mutations": _mutations(data),
        "rounds": _rounds([row for row in data["rounds"] if row["members"] in ROUNDS]),
    }


def _summary(data: Data) -> list[str]:
    lines = [f"RMR {data['version']}; seeds {data['seeds']}.", ""]
    counts = tally([as_check(each) for each in data["checks"]])
    rows = [
        (_code(file), str(met), str(failed), str(shown), _narrowest(data["checks"], file))
        for file, met, failed, shown in counts
    ]
    total = [str(sum(row[at] for row in counts)) for at in (1, 2, 3)]  # type: ignore[misc]
    header = ("file", "met", "missed", "only shown", "nearest to its tolerance")
    lines += table(header, [*rows, ("all", *total, "")])
    missed = [each for each in data["checks"] if each["verdict"] == MISSED]
    return lines + (["", "Missed:", "", *table(HEADER, map(_cells, missed))] if missed else ["", "No check is missed."])


def _narrowest(checks: Sequence[Data], file: str) -> str:
    """Return the check of a file that uses most of its tolerance, with how much of it."""
    some = [each for each in checks if each["file"] == file and each["tolerance"] and "difference" in each]
    if not some:
        return "all are equal"
    most = max(some, key=_used)
    return f"{most['quantity'].replace('|', '/')}: {_used(most):.0%}"


def _used(check: Data) -> float:
    part: float = abs(check["difference"]) / check["tolerance"]
    return part


def as_check(data: Data) -> Check:
    """Return a check as `tally` wants it, of its data; its verdict is that of the data."""
    known = {key: data[key] for key in ("file", "row", "quantity", "ours", "theirs")}
    # A verdict once given stands: one that is missed is rebuilt as an inequality.
    if data["verdict"] == MISSED:
        return Check(**known | {"ours": "missed", "theirs": "met"}, tolerance=0.0)
    return Check(**known | {"ours": 0, "theirs": 0}, tolerance=None if data["verdict"] == SHOWN else 0.0)


def _cells(check: Data) -> Cells:
    difference = check.get("difference")
    return (
        check["row"],
        _code(check["quantity"]) if "_" in check["quantity"] and " " not in check["quantity"] else check["quantity"],
        *_sides(check),
        "" if difference is None else f"{difference:+.3g}",
        "" if not check["tolerance"] else f"{check['tolerance']:.3g}",
        check["verdict"],
    )


def _sides(check: Data) -> tuple[str, str]:
    ours, theirs = (_side(check[name], check.get(f"{name}_half", 0.0)) for name in ("ours", "theirs"))
    return ours, theirs


def _side(value: Any, half: float) -> str:
    if isinstance(value, list):
        text = ", ".join(f"{each:g}" if isinstance(each, int | float) else str(each) for each in value)
        return text if len(text) < 60 else f"{text[:56]} ..."
    if isinstance(value, bool) or not isinstance(value, int | float):
        return "none" if value is None else str(value)
    if not half:
        return f"{value:.5g}"
    digits = max(0, min(6, 1 - len(f"{half:.0f}") + 1 if half >= 1.0 else _decimals(half)))
    return f"{value:.{digits}f} ± {half:.{digits}f}"


def _decimals(half: float) -> int:
    """Return how many decimals show two digits of an interval below 1."""
    return 1 - int(f"{half:e}".partition("e")[2])


def _code(text: str) -> str:
    return f"`{text}`"


def _mutations(data: Data) -> list[str]:
    rows = data["mutations"]
    unguarded = [f"{family}: {quantity}" for family, quantity in data["unguarded"]]
    failed = data["guarded"] - len(unguarded)
    silent = [row["rule"] for row in rows if not row["noticed"]]
    lines = [
        f"{len(rows)} rules were broken; {len(rows) - len(silent)} were noticed.",
        *([f"Not noticed: {'; '.join(silent)}."] if silent else []),
        f"Of {data['guarded']} kinds of checks {failed} fail for at least one of these rules.",
    ]
    return [*lines, f"No rule makes these fail: {'; '.join(unguarded)}."] if unguarded else lines


def _mean(field: Data | None) -> str:
    return "" if field is None else _side(field["mean"], (field["ci95"][1] - field["ci95"][0]) / 2.0)


def _rounds(found: Sequence[Data]) -> list[str]:
    header = (
        "robots",
        "round, ms",
        "frames",
        "airtime, ms",
        "waiting, frames/s",
        "passing, frames/s",
    )
    return table(header, [
        (
            str(row["members"]),
            _mean(row["round_ms"]),
            *(_mean(row["round"][name]) for name in ("frames", "airtime_ms")),
            *(_mean(row[phase]["frames"]) for phase in ("waiting", "passing")),
        )
        for row in found
    ])  # fmt: skip


__all__ = ["MET", "as_json", "gathered", "renewed_page", "tables", "write"]
