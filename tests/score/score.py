"""The score: every provided lab and example and thirty drawn labs, beside the last landed score.

    python tests/score/score.py [--ci] [--drawn A-B] [--only WORD] [--land]

Each lab file of deploy/labs and docs/examples/labs is run at full size, with seed 1, and each drawn lab with its own.
The table has what each run is judged by. What is worse than in the landed table is red (score_table.py): exit code 1.
`--ci` is what fits into two minutes of processor time: of the hall its first twenty robots only.
`--land` writes what was run into the landed table, other rows stay.
"""

import argparse
import platform
import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from drawn_lab import ROOT
from score_run import Entry, calibration_s, drawn_entry, taken
from score_table import COSTLIER, LANDED, Rows, compared, cost_ratio, read, table, totals, write

from rmr import __version__

LABS: Final = ("deploy/labs", "docs/examples/labs")
SEED: Final = 1
DRAWN_SEEDS: Final = (
    *(1, 3, 16, 19, 20, 41, 52, 63, 66, 84, 85, 86, 88, 99, 103),
    *(104, 109, 113, 118, 121, 137, 140, 155, 162, 164, 174, 179, 180, 182, 188),
)
"""The drawn labs of the score: of the first 200 some with little to compute, with all kinds of parts among them."""
CI_ROBOTS: Final = {"hall": 20}
"""Labs that CI runs with their first robots only: fifty in the hall take minutes of processor time, interpreted."""


def provided() -> list[Entry]:
    """Return a run of each lab file of the tree, at full size."""
    files = [file for folder in LABS for file in sorted((ROOT / folder).glob("*/*.yaml"))]
    return [Entry(_name(file), SEED, file) for file in files]


def _name(file: Path) -> str:
    """Return the name of a lab file: its folder's, with its own where that is another one."""
    return file.parent.name if file.stem == "lab" else f"{file.parent.name}/{file.stem}"


def in_ci(entries: Sequence[Entry]) -> list[Entry]:
    """Return the runs of CI: large labs with fewer robots, the others as they are."""
    return [
        Entry(f"{entry.name}, {CI_ROBOTS[entry.name]} robots", entry.seed, entry.lab, {"robots": CI_ROBOTS[entry.name]})
        if entry.name in CI_ROBOTS
        else entry
        for entry in entries
    ]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Score all provided labs and drawn ones against the landed score.")
    parser.add_argument("--ci", action="store_true", help="what CI runs: two minutes of processor time at most")
    parser.add_argument("--drawn", metavar="A-B", help="drawn labs of these seeds instead of those of the score")
    parser.add_argument("--only", default="", metavar="WORD", help="only labs with WORD in their names")
    parser.add_argument("--land", action="store_true", help="write the landed table")
    options = parser.parse_args()
    options.seeds = DRAWN_SEEDS
    if options.drawn is not None:
        match = re.fullmatch(r"(\d+)-(\d+)", options.drawn)
        if match is None or int(match[1]) > int(match[2]):
            parser.error(f"--drawn takes two seeds, A-B, not {options.drawn!r}")
        options.seeds = range(int(match[1]), int(match[2]) + 1)
    return options


def entries_of(options: argparse.Namespace) -> list[Entry]:
    """Return the runs that the options ask for."""
    labs = in_ci(provided()) if options.ci else provided()
    entries = [*labs, *map(drawn_entry, options.seeds)]
    return [entry for entry in entries if options.only in entry.name]


def score(entries: Sequence[Entry]) -> Rows:
    """Carry out all runs; return their rows."""
    rows: Rows = {}
    for number, entry in enumerate(entries, 1):
        if sys.stderr.isatty():
            print(f"\r\x1b[K{number} of {len(entries)}: {entry.name}", end="", file=sys.stderr, flush=True)
        rows[entry.name] = taken(entry)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    return rows


def head() -> dict[str, Any]:
    """Return how a table was taken: processor times of other forms of the program cannot be compared with it."""
    return {"version": __version__, "python": platform.python_version(), "form": form()}


def form() -> str:
    """Return whether the modules that robots spend their time in are compiled or interpreted."""
    import rmr.node.node as hot

    return "interpreted" if (hot.__file__ or "").endswith(".py") else "compiled"


def judge(rows: Rows, landed_head: dict[str, Any], landed: Rows, commands: dict[str, str]) -> bool:
    """Print the table and what is red; return whether anything is."""
    verdicts = [compared(name, row, landed.get(name)) for name, row in rows.items()]
    print("\n".join(table(rows, landed, verdicts)))
    print(f"now     {totals(rows.values())}")
    known = [landed[name] for name in rows if name in landed]
    print(f"landed  {totals(known)}")
    red = [f"{each.name}: {', '.join(each.worse)}\n    {commands[each.name]}" for each in verdicts if each.worse]
    ratio = cost_ratio(rows, landed) if landed_head.get("form") == form() else None
    if ratio is None:
        print("processor time: not compared, for the landed table has no such labs or is of another form")
    else:
        print(f"processor time, in sum: {ratio:.3f} of the landed one")
        if ratio > 1.0 + COSTLIER:
            red.append(f"processor time, in sum: {ratio:.3f} of the landed one")
    for line in red:
        print(f"RED  {line}")
    return bool(red)


def main() -> int:
    """Take the score; return the exit code."""
    options = _arguments()
    entries = entries_of(options)
    if not entries:
        print(f"no lab has {options.only!r} in its name", file=sys.stderr)
        return 2
    landed_head, landed = read()
    began = time.process_time()
    calibration_s()  # the first one is slower
    rows = score(entries)
    red = judge(rows, landed_head, landed, {entry.name: entry.command for entry in entries})
    print(f"{time.process_time() - began:.0f} s of processor time, {form()}")
    if options.land:
        if landed_head and landed_head.get("form") != form():
            print(f"not landed: the landed table is {landed_head['form']}, this run is {form()}", file=sys.stderr)
            return 2
        write(head(), {**landed, **rows})
        print(f"landed in {LANDED.relative_to(ROOT)}")
        return 0
    return 1 if red else 0


if __name__ == "__main__":
    sys.exit(main())
