"""Ablation of the rules of motion: each hazard rule and each escape is left out in turn, over many seeds of chaos.

    python tests/evaluation/ablation.py [--seeds A-B] [--labs NAME[=A-B],...] [--rules NAME,...] [--jobs N] [--out DIR]
                                        [--state FILE] [--resume]

A run is determined by lab, seed and rules, and each rule counts its firings with effect (`rmr.node.motion.speed_law`).
So a rule that did not fire in the run with all rules cannot change that run: it is left out only where it fired, and
the other runs count as equal. The seeds that once failed (tests/sim/kept.toml) are run as well, as the lab `kept`.

All results are kept in a state file, a line of JSON for each run; with `--resume` only what is missing is run. After
each rule `DIR/ablation.md` (the tables) and `DIR/ablation.jsonl` (their rows) are written. Rows of rules that are not
asked for stay as they were.
"""

import argparse
import json
import sys
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from experiment import table
from runs import LABS, ROOT

from rmr.node.motion.speed_law import HAZARDS
from rmr.node.motion.standoff.escapes import ESCAPES
from rmr_sim.run_setup import LoadedLab, Options, load, report_of

FIVE_LABS = ("corridor", "twoway", "testbed", "formation", "hall")
KEPT = "kept"
SEEDS = "1-25"
RULES = tuple(rule.name for rule in (*HAZARDS, *ESCAPES))
SLOWER_MIN = 0.005
"""A mean change of time over bound by less than this is none."""

Row = dict[str, Any]


class Case(NamedTuple):
    """One run: a lab of deploy/labs, a seed, and the rule that is left out (empty: none)."""

    group: str
    """The lab, or `kept`."""
    lab: str
    seed: int
    without: str = ""

    @property
    def key(self) -> str:
        """Return the name of the run in the state file."""
        return "/".join((self.group, self.lab, str(self.seed), self.without))


_LOADED: dict[tuple[str, str], LoadedLab] = {}
"""Labs by name and rule left out, once a process."""


def carried_out(case: Case) -> Row:
    """Return the result of one run."""
    if (case.lab, case.without) not in _LOADED:
        without = frozenset([case.without] if case.without else [])
        _LOADED[case.lab, case.without] = load(LABS / case.lab, Options(chaos=True, without=without))
    simulation = _LOADED[case.lab, case.without].simulation(case.seed)
    finished = simulation.run()
    report = report_of(simulation, finished)
    return {
        "finished": finished,
        "contacts": report["collisions"],
        "violations": len(report["violations"]),
        "time_s": report["time_s"],
        "ratio": report["time_s"] / (report["bound_s"] or 1.0),  # a lab in which nobody travels has no bound: seconds
        "fired": {name: count for name, count in sorted(simulation.firings.items()) if name in RULES},
    }


class State:
    """Results by the key of their run, in a file that is only appended to."""

    def __init__(self, path: Path, *, resume: bool) -> None:
        self._path = path
        self.results: dict[str, Row] = {}
        if not resume:
            path.write_text("")
        elif path.exists():
            for line in path.read_text().splitlines():
                key, row = json.loads(line)
                self.results[key] = row

    def missing(self, cases: Iterable[Case]) -> list[Case]:
        """Return the cases that have not been run."""
        return [case for case in cases if case.key not in self.results]

    def run(self, cases: Sequence[Case], jobs: int, what: str) -> None:
        """Carry out what is missing of `cases`, and save each result."""
        todo = self.missing(cases)
        print(f"{what}: {len(todo)} runs, {len(cases) - len(todo)} known", file=sys.stderr, flush=True)
        if jobs <= 1:
            for case in todo:
                self._keep(case, carried_out(case))
            return
        with ProcessPoolExecutor(jobs) as pool:
            running = {pool.submit(carried_out, case): case for case in todo}
            for done in as_completed(running):
                self._keep(running[done], done.result())

    def _keep(self, case: Case, row: Row) -> None:
        self.results[case.key] = row
        with self._path.open("a") as file:
            print(json.dumps([case.key, row]), file=file)

    def base(self, case: Case) -> Row:
        """Return the result of the run with all rules."""
        return self.results[case._replace(without="").key]

    def result(self, case: Case) -> Row:
        """Return the result of a run without a rule: that with all rules where the rule did not fire."""
        base = self.base(case)
        return self.results[case.key] if case.without in base["fired"] else base

    def to_ablate(self, rule: str, bases: Iterable[Case]) -> list[Case]:
        """Return the runs without `rule` that can differ."""
        return [case._replace(without=rule) for case in bases if rule in self.base(case)["fired"]]


def summary(state: State, rule: str, bases: Sequence[Case]) -> Row:
    """Return what leaving out `rule` changes over all runs of `bases`."""
    pairs = [(state.base(case), state.result(case._replace(without=rule))) for case in bases]
    both = [(base, row) for base, row in pairs if base["finished"] and row["finished"]]
    delta = fmean(row["ratio"] - base["ratio"] for base, row in both) if both else 0.0
    found = {
        "rule": rule,
        "runs": len(pairs),
        "fired": sum(rule in base["fired"] for base, _ in pairs),
        "changed": sum(
            any(base[key] != row[key] for key in ("finished", "contacts", "violations", "time_s"))
            for base, row in pairs
        ),
        **{
            f"{what}{side}": sum(value(pair[at]) for pair in pairs)
            for what, value in (
                ("contacts", lambda row: row["contacts"]),
                ("unfinished", lambda row: not row["finished"]),
                ("violations", lambda row: row["violations"]),
            )
            for at, side in ((0, "_base"), (1, ""))
        },
        "ratio_delta": round(delta, 4),
    }
    return {**found, "verdict": verdict(found)}


def verdict(row: Row) -> str:
    """Return what a rule buys, in words."""
    buys = [
        f"{more} {what}"
        for what in ("contacts", "unfinished", "violations")
        if (more := row[what] - row[f"{what}_base"]) > 0
    ]
    costs = [
        f"{-more} {what}"
        for what in ("contacts", "unfinished", "violations")
        if (more := row[what] - row[f"{what}_base"]) < 0
    ]
    if not row["fired"]:
        return "never fires"
    if buys:
        return "needed: without it " + ", ".join(buys) + " more" + (f", {', '.join(costs)} fewer" if costs else "")
    if costs:
        return "harms: without it " + ", ".join(costs) + " fewer"
    if row["ratio_delta"] > SLOWER_MIN:
        return "saves time"
    if row["ratio_delta"] < -SLOWER_MIN:
        return "costs time"
    return "no gain measured" if row["changed"] else "no effect"


def known_rows(folder: Path) -> list[Row]:
    """Return the rows that `folder` has; none if there is no table yet."""
    path = folder / "ablation.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def merged_rows(known: Iterable[Row], new: Sequence[Row]) -> list[Row]:
    """Return all rows in the order of the rules, those of rules that are gone last; new rows replace known ones."""
    by_rule = {row["rule"]: row for row in (*known, *new)}
    order = {rule: at for at, rule in enumerate(RULES)}
    return sorted(by_rule.values(), key=lambda row: order.get(row["rule"], len(order)))


def written(folder: Path, rows: Sequence[Row]) -> None:
    """Write table and data into `folder`; rules that are gone, and which runs those of a rule were, are in the data."""
    lines = [line_of(row) for row in rows if row["rule"] in RULES]
    header = ("rule left out", "fired in", "time / bound", "")
    page = ["# Ablation of the rules of motion", "", *NOTE, "", *table(header, lines)]
    (folder / "ablation.md").write_text("\n".join([*page, ""]))
    (folder / "ablation.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))


def line_of(row: Row) -> tuple[str, ...]:
    """Return the cells of a rule."""
    return (
        f"`{row['rule']}`",
        f"{row['fired']} of {row['runs']}",
        f"{row['ratio_delta']:+.3f}",
        row["verdict"],
    )


NOTE = (
    "Each [hazard rule and each escape](../motion.md) is left out in turn, with chaos, where it fired: a rule that did",
    "not fire cannot change a run. Time over bound: the mean difference over the runs that finish both with the rule",
    "and without it. Written by `python tests/evaluation/ablation.py`; `ablation.jsonl` has the runs and former rules.",
)


def cases_of(labs: dict[str, range]) -> list[Case]:
    """Return the runs with all rules; the seeds of `kept` are its own."""
    found = []
    for lab, seeds in labs.items():
        if lab == KEPT:
            kept = tomllib.loads((ROOT / "tests" / "sim" / "kept.toml").read_text())["kept"]
            found += [Case(KEPT, each["lab"], each["seed"]) for each in kept]
        else:
            found += [Case(lab, lab, seed) for seed in seeds]
    return found


def seeds_of(text: str) -> range:
    """Return the seeds of a range `A-B` or of one number. Raises ValueError if it is neither."""
    first, dash, last = text.partition("-")
    return range(int(first), int(last if dash else first) + 1)


def arguments() -> argparse.Namespace:
    """Return what was asked for."""
    parser = argparse.ArgumentParser(description="Leave out each rule of motion in turn.")
    parser.add_argument("--seeds", default=SEEDS, help=f"A-B, of each lab (default {SEEDS})")
    parser.add_argument(
        "--labs",
        default=",".join((KEPT, *FIVE_LABS)),
        help="of deploy/labs, and `kept`",
    )
    parser.add_argument("--rules", default=",".join(RULES), help="which rules are left out (default: all)")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once (default 1)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "evaluation", help="where the table is written")
    parser.add_argument("--state", type=Path, default=ROOT / "build" / "ablation.json", help="results of single runs")
    parser.add_argument("--resume", action="store_true", help="go on with what the state file has")
    found = parser.parse_args()
    found.rules = found.rules.split(",")
    if unknown := [rule for rule in found.rules if rule not in RULES]:
        parser.error(f"--rules: no rule is called {', '.join(unknown)}; there are {', '.join(RULES)}")
    found.by_lab = {}
    for text in found.labs.split(","):
        lab, _, own = text.partition("=")
        if lab != KEPT and not (LABS / lab).is_dir():
            parser.error(f"--labs: no lab of deploy/labs is called {lab!r}")
        try:
            found.by_lab[lab] = seeds_of(own or found.seeds)
        except ValueError:
            parser.error(f"seeds are a range such as 1-25, not {own or found.seeds!r}")
    return found


def main() -> None:
    """Run what is missing and write the table, anew after each rule."""
    asked = arguments()
    asked.state.parent.mkdir(parents=True, exist_ok=True)
    state = State(asked.state, resume=asked.resume)
    bases = cases_of(asked.by_lab)
    state.run(bases, asked.jobs, "all rules")
    shown = [lab if lab == KEPT else f"{lab} (seeds {s[0]} to {s[-1]})" for lab, s in asked.by_lab.items()]
    over = f"{len(bases)} runs: {', '.join(shown)}"
    known = known_rows(asked.out)
    rows: list[Row] = []
    for rule in asked.rules:
        state.run(state.to_ablate(rule, bases), asked.jobs, f"without {rule}")
        rows.append({**summary(state, rule, bases), "over": over})
        written(asked.out, merged_rows(known, rows))


if __name__ == "__main__":
    main()
