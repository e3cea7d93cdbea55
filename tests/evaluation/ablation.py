"""Ablation of the rules of motion: each hazard rule and each escape is left out in turn, over many seeds of chaos.

    python tests/evaluation/ablation.py [--seeds A-B] [--labs NAME,...] [--rules NAME,...] [--jobs N] [--out DIR]
                                        [--state FILE] [--resume]

A run is determined by lab, seed and rules, and each rule counts its firings with effect (`rmr.node.motion.hazards`). So
a rule that did not fire in the run with all rules cannot change that run: it is left out only where it fired, and the
other runs count as equal. The seeds that once failed (tests/sim/kept.toml) are taken in addition, as the lab `kept`.

All results are kept in a state file, one entry a run; with `--resume` only what is missing is run. At the end, and after
each rule, `DIR/ablation.md` (the table) and `DIR/ablation.json` are written.
"""

import argparse
import json
import os
import sys
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from experiment import table
from runs import LABS, ROOT

from rmr.node.motion.hazards import HAZARDS
from rmr.node.motion.standoff.escapes import ESCAPES
from rmr_sim.run import Loaded, Options, load, report_of

FOUR_LABS = ("corridor", "twoway", "testbed", "hall")
KEPT = "kept"
SEEDS = "1-25"
RULES = tuple(rule.name for rule in (*HAZARDS, *ESCAPES))
SLOWER_MIN = 0.005
"""A change of the median time over bound by less than this is none."""

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


_LOADED: dict[tuple[str, str], Loaded] = {}
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
        "ratio": report["time_s"] / report["bound_s"],
        "fired": {name: count for name, count in sorted(simulation.firings.items()) if name in RULES},
    }


class State:
    """Results by the key of their run, in a file."""

    def __init__(self, path: Path, *, resume: bool) -> None:
        self._path = path
        self.results: dict[str, Row] = json.loads(path.read_text()) if resume and path.exists() else {}

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
        fresh = self._path.with_suffix(".new")
        fresh.write_text(json.dumps(self.results, indent=0))
        os.replace(fresh, self._path)

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
    delta = median(row["ratio"] for _, row in both) - median(base["ratio"] for base, _ in both) if both else 0.0
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
    return "no effect on results" if row["changed"] else "no effect"


def written(folder: Path, rows: Sequence[Row], what: str) -> None:
    """Write the table and its data into `folder`."""
    header = ("rule left out", "fired in", "runs changed", "contacts", "unfinished", "violations", "time / bound", "")
    lines = [
        (
            f"`{row['rule']}`",
            f"{row['fired']} of {row['runs']}",
            str(row["changed"]),
            *(f"{row[key]} ({row[key] - row[f'{key}_base']:+d})" for key in ("contacts", "unfinished", "violations")),
            f"{row['ratio_delta']:+.3f}",
            row["verdict"],
        )
        for row in rows
    ]
    page = ["# Ablation of the rules of motion", "", *NOTE, "", f"{what}.", "", *table(header, lines), ""]
    (folder / "ablation.md").write_text("\n".join(page))
    (folder / "ablation.json").write_text(json.dumps({"name": "ablation", "runs": what, "rows": rows}, indent=1) + "\n")


NOTE = (
    "Each [hazard rule and each escape](../motion.md) is left out in turn, with chaos. A rule that did not fire in the run",
    "with all rules cannot change that run, so it is run without only where it fired. In brackets: the difference to the",
    "runs with all rules. Time over bound: the difference of the medians over the runs that finish with and without the",
    "rule. Written by `python tests/evaluation/ablation.py`.",
)


def cases_of(labs: Sequence[str], seeds: Sequence[int]) -> list[Case]:
    """Return the runs with all rules."""
    found = []
    for lab in labs:
        if lab == KEPT:
            kept = tomllib.loads((ROOT / "tests" / "sim" / "kept.toml").read_text())["kept"]
            found += [Case(KEPT, each["lab"], each["seed"]) for each in kept]
        else:
            found += [Case(lab, lab, seed) for seed in seeds]
    return found


def arguments() -> argparse.Namespace:
    """Return what was asked for."""
    parser = argparse.ArgumentParser(description="Leave out each rule of motion in turn.")
    parser.add_argument("--seeds", default=SEEDS, help=f"A-B, of each lab (default {SEEDS})")
    parser.add_argument("--labs", default=",".join((KEPT, *FOUR_LABS)), help="names of deploy/labs, and `kept`")
    parser.add_argument("--rules", default=",".join(RULES), help="which rules are left out (default: all)")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once (default 1)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "evaluation", help="where the table is written")
    parser.add_argument("--state", type=Path, default=ROOT / "build" / "ablation.json", help="results of single runs")
    parser.add_argument("--resume", action="store_true", help="go on with what the state file has")
    found = parser.parse_args()
    found.rules = found.rules.split(",")
    if unknown := [rule for rule in found.rules if rule not in RULES]:
        parser.error(f"--rules: no rule is called {', '.join(unknown)}; there are {', '.join(RULES)}")
    found.labs = found.labs.split(",")
    if unknown := [lab for lab in found.labs if lab != KEPT and not (LABS / lab).is_dir()]:
        parser.error(f"--labs: no lab of deploy/labs is called {', '.join(unknown)}")
    first, _, last = found.seeds.partition("-")
    if not (first.isdigit() and (last or first).isdigit()):
        parser.error(f"--seeds: a range such as 1-25, not {found.seeds!r}")
    found.seeds = range(int(first), int(last or first) + 1)
    return found


def main() -> None:
    """Run what is missing and write the table, anew after each rule."""
    asked = arguments()
    asked.state.parent.mkdir(parents=True, exist_ok=True)
    state = State(asked.state, resume=asked.resume)
    bases = cases_of(asked.labs, asked.seeds)
    state.run(bases, asked.jobs, "all rules")
    what = f"{len(bases)} runs: {', '.join(asked.labs)}; seeds {asked.seeds[0]} to {asked.seeds[-1]} of each lab"
    rows = []
    for rule in asked.rules:
        state.run(state.to_ablate(rule, bases), asked.jobs, f"without {rule}")
        rows.append(summary(state, rule, bases))
        written(asked.out, rows, what)
    sys.exit(0)


if __name__ == "__main__":
    main()
