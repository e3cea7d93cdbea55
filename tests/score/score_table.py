"""The score beside the last landed one: which rows are worse, in what, and what the processor time is in sum.

The landed table (landed.jsonl) has a line that says how it was taken, and a line for each row. A known failure stands
there as it is, so that only what gets worse is red:

- a lab that does not finish, a contact, a violation of a rule: more of them than landed;
- deadlines met: fewer than landed, by more than 5 %;
- time until all have finished: longer than landed, by more than 5 %;
- processor time per second of lab time, in loops of the calibration: in sum over all labs that both tables have, by
  more than 10 %. That of single labs is told and not judged, for it is noisy.

A lab that is refused before its run is no failure; red is a refusal of a lab that had nothing wrong.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rmr_sim.seed_run import Row

LANDED: Final = Path(__file__).parent / "landed.jsonl"
WORSE: Final = 0.05
"""Share by which deadlines and time may be worse."""
COSTLIER: Final = 0.10
"""Share by which the processor time may be greater in sum."""
DRAWN: Final = "drawn/"
"""Beginning of the names of drawn labs."""

Rows = dict[str, Row]
"""Rows by name."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What has changed in one row."""

    name: str
    worse: tuple[str, ...]
    """What is red."""
    better: tuple[str, ...]


def failures(row: Row) -> dict[str, int]:
    """Return what is wrong with a row, with its count: ``not finished``, ``contacts``, ``errors``, and violations."""
    if row.get("refused"):
        return {}
    found = {"not finished": int(not row["finished"]), "contacts": row["contacts"], **row["violations"]}
    known = ("not finished",)
    errors = [words for words in row["wrong"] if words not in known and "contact" not in words]
    others = [words for words in errors if words.rsplit(" (", 1)[0] not in row["violations"]]
    return {what: count for what, count in {**found, "errors": len(others)}.items() if count}


def compared(name: str, row: Row, landed: Row | None) -> Verdict:
    """Return what is worse and better in a row than in the landed one; a new row with a failure is worse."""
    if row.get("refused"):
        fine = landed is not None and not landed.get("refused") and not failures(landed)
        provided = not name.startswith(DRAWN)
        before = landed is not None and bool(landed.get("refused"))
        worse = ("refused",) if fine or (provided and not before) else ()
        return Verdict(name, worse, ("refused",) if landed is not None and not worse and not before else ())
    now = failures(row)
    then = {} if landed is None else failures(landed)
    words = {what: f"{what} {then.get(what, 0)} -> {now.get(what, 0)}" for what in {**then, **now}}
    worse = [words[what] for what in words if now.get(what, 0) > then.get(what, 0)]
    better = [words[what] for what in words if now.get(what, 0) < then.get(what, 0)]
    if landed is not None and not landed.get("refused"):
        _compare(row, landed, worse, better)
    return Verdict(name, tuple(worse), tuple(better))


def _compare(row: Row, landed: Row, worse: list[str], better: list[str]) -> None:
    """Add what is worse or better in deadlines, and in time where both runs finished."""
    words = f"deadlines {landed['met']} -> {row['met']}"
    if row["met"] < landed["met"] * (1.0 - WORSE):
        worse.append(words)
    elif row["met"] > landed["met"] * (1.0 + WORSE):
        better.append(words)
    if not (row["finished"] and landed["finished"]):
        return
    words = f"time {landed['time_s']:.1f} s -> {row['time_s']:.1f} s"
    if row["time_s"] > landed["time_s"] * (1.0 + WORSE):
        worse.append(words)
    elif row["time_s"] < landed["time_s"] * (1.0 - WORSE):
        better.append(words)


def cost_ratio(rows: Mapping[str, Row], landed: Mapping[str, Row]) -> float | None:
    """Return the processor time in sum relative to the landed one; None where no lab can be compared.

    Each lab counts with its landed lab time, so that a lab that takes less time now makes nothing look slower.
    """
    both = [(rows[name], landed[name]) for name in rows if name in landed]
    both = [(row, was) for row, was in both if row.get("cost") and was.get("cost")]
    before = sum(was["cost"] * was["lab_s"] for _, was in both)
    return sum(row["cost"] * was["lab_s"] for row, was in both) / before if before else None


def read(path: Path = LANDED) -> tuple[dict[str, Any], Rows]:
    """Return the head of the landed table and its rows; both empty where there is none yet."""
    if not path.exists():
        return {}, {}
    head, *rows = (json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())
    return head, {row["name"]: row for row in rows}


def write(head: Mapping[str, Any], rows: Mapping[str, Row], path: Path = LANDED) -> None:
    """Write a landed table: its head, then a line for each row, provided labs first."""
    lines = [json.dumps(head, sort_keys=True), *(json.dumps(_kept(rows[name])) for name in sorted(rows, key=_place))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _kept(row: Row) -> Row:
    """Return what is kept of a row: what it is judged by and what it is about, not what a failure told."""
    return {key: value for key, value in row.items() if key not in ("first", "unfinished", "breakdown")}


def _place(name: str) -> tuple[bool, str, int]:
    kind, _, number = name.partition(DRAWN)
    return name.startswith(DRAWN), kind, int(number) if number.isdecimal() else 0


def table(rows: Mapping[str, Row], landed: Mapping[str, Row], verdicts: Iterable[Verdict]) -> list[str]:
    """Return the table as lines: each row, what it was, and what is worse or better."""
    header = ("lab", "finished", "contacts", "violations", "deadlines", "time [s]", "x bound", "cost", "landed", "")
    lines = [header, *(_cells(rows[each.name], landed.get(each.name), each) for each in verdicts)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header) - 1)]
    return ["  ".join([*(c.ljust(w) for c, w in zip(line, widths, strict=False)), line[-1]]).rstrip() for line in lines]


def _cells(row: Row, landed: Row | None, verdict: Verdict) -> tuple[str, ...]:
    marks = [*(f"RED {words}" for words in verdict.worse), *(f"better: {words}" for words in verdict.better)]
    mark = "; ".join(marks) or ("new" if landed is None else "")
    if row.get("refused"):
        return verdict.name, "refused", "", "", "", "", "", "", _brief(landed), mark or row["refused"][0]
    return (
        verdict.name,
        "yes" if row["finished"] else "NO",
        str(row["contacts"]),
        str(sum(row["violations"].values())),
        f"{row['met']}/{row['met'] + row['missed']}",
        "-" if row["time_s"] is None else f"{row['time_s']:.1f}",
        f"{row['time_s'] / row['bound_s']:.2f}" if row["time_s"] and row["bound_s"] else "-",
        f"{row['cost']:.2f}" if row["cost"] else "-",
        _brief(landed),
        mark,
    )


def _brief(landed: Row | None) -> str:
    """Return the landed row in a few words."""
    if landed is None:
        return "-"
    if landed.get("refused"):
        return "refused"
    time = f"{landed['time_s']:.1f} s" if landed["finished"] else "not finished"
    contacts = f", {landed['contacts']} contacts" if landed["contacts"] else ""
    return f"{time}{contacts}, {landed['met']} met, {landed['cost'] or 0.0:.2f}"


def totals(rows: Iterable[Row]) -> str:
    """Return the counts of a score in one line."""
    rows = list(rows)
    ran: Sequence[Row] = [row for row in rows if not row.get("refused")]
    met, missed = (sum(row[key] for row in ran) for key in ("met", "missed"))
    unfinished = sum(not row["finished"] for row in ran)
    contacts = sum(row["contacts"] for row in ran)
    violations = sum(sum(row["violations"].values()) for row in ran)
    return (
        f"{len(rows)} labs, refused {len(rows) - len(ran)}, not finished {unfinished}, contacts {contacts}, "
        f"violations {violations}, deadlines met {met} of {met + missed}"
    )
