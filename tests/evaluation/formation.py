"""Formation control (paper V.C, figure 13) with four, nine and sixteen robots: times, barriers, and who goes where.

A round begins with the captain's orders and ends with the last arrival. The barrier is what lies between two rounds:
from the last arrival to the last robot's knowing where to go next (before the first round, from the start). Places are
measured against the least sum of squared ways, and times against the bound of a fleet that knows everything: for each
shape the least longest way at full speed, without turning, starting, or talking.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from assignment import least_longest, least_squares, ways_between
from experiment import Data, figure, panel, series, table, target
from intervals import quantile, share, text
from runs import Row, Run, simulated

from rmr_sim.simulation import Simulation
from rmr_world.fact_syntax import parse_fact

NAME = "formation"
SEEDS = range(1, 61)
QUICK = range(1, 3)
LABS = {4: ("lab.yaml", 15.0, 1), 9: ("nine.yaml", 22.0, 2), 16: ("sixteen.yaml", 28.0, 4)}
"""By the number of robots: the lab, the time it may take beside the barriers, and of how many seeds it gets one."""
SHAPES = ("rectangle", "triangle", "rhombus", "line")
_REACH = re.compile(r"reach\(@\d+, (?P<x>[^,]+), (?P<y>[^,]+), (?P<begins>[^,]+), (?P<ends>[^)]+)\)")


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Run each lab with its share of the seeds."""
    wanted = [(n, seed) for n in reversed(LABS) for seed in seeds[:: LABS[n][2]]]
    found = simulated([Run(f"formation/{LABS[n][0]}", seed, {}, measured) for n, seed in wanted], jobs)
    runs = [{"robots": n, **row} for (n, _), row in zip(wanted, found, strict=True)]
    rows = [{"robots": n, **summary([row for row in runs if row["robots"] == n])} for n in LABS]
    return {
        "rows": rows,
        "targets": [each for row in rows for each in targets(row)],
        "figure": drawn(rows),
        "runs": runs,
    }


def measured(simulation: Simulation, report: dict[str, Any]) -> Row:
    """Return the rounds of a run; times in seconds, null if it had others than one for each shape."""
    starts = [tuple(robot.pose[:2]) for robot in sorted(simulation.lab.robots, key=lambda robot: robot.id)]
    rounds = rounds_of(simulation)
    failures = sum(note["what"] == "action_ended" and note["failure"] is not None for note in simulation.trace())
    if len(rounds) != len(SHAPES) or failures:
        return {"rounds": len(rounds), "failures": failures, "shapes_s": None}
    facts = [parse_fact(fact) for fact in simulation.lab.facts]
    shapes = [starts, *(list(fact.args[1]) for fact in facts if fact.name == "shape")]
    ends = [0.0, *(each["arrived_s"] for each in rounds)]
    places = [starts, *(each["places"] for each in rounds)]
    sums = [sum(way**2 for way in map(_way, before, after)) for before, after in pairwise(places)]
    least = [least_squares(ways_between(before, shape)) for before, shape in zip(places, shapes[1:], strict=False)]
    longest = [least_longest(ways_between(before, after)) for before, after in pairwise(shapes)]
    return {
        "rounds": len(rounds),
        "failures": 0,
        "shapes_s": [round(after - before, 3) for before, after in pairwise(ends)],
        "barriers_s": [round(each["told_s"] - end, 3) for each, end in zip(rounds, ends, strict=False)],
        "sum_ratio": sum(sums) / sum(least),
        "fleet_bound_s": sum(longest) / simulation.lab.arena.shape.speed,
        "frames": sum(part["frames"]["sent"] for part in report["robots"].values()),
    }


def _way(before: Sequence[float], after: Sequence[float]) -> float:
    return ways_between([before], [after])[0][0]


def rounds_of(simulation: Simulation) -> list[Row]:
    """Return of each round when the last robot was told and when the last one arrived, and who had which place."""
    rounds: dict[str, Row] = {}
    order = {robot.robot: index for index, robot in enumerate(simulation.robots)}
    for note in simulation.trace():
        found = _REACH.fullmatch(note.get("action", ""))
        if found is None:
            continue
        empty = {"told_s": 0.0, "arrived_s": 0.0, "places": [None] * len(order)}
        each = rounds.setdefault(found["ends"], empty)
        if note["what"] == "action":
            each["told_s"] = note["t"]
            each["places"][order[note["robot"]]] = (float(found["x"]), float(found["y"]))
        else:
            each["arrived_s"] = note["t"]
    return list(rounds.values())


def summary(runs: Sequence[Row]) -> Row:
    """Return what the tables tell of the runs with so many robots."""
    whole = [run for run in runs if run["shapes_s"] is not None]
    barriers = [barrier for run in whole for barrier in run["barriers_s"][1:]]
    return {
        "finished": share(sum(run["finished"] for run in runs), len(runs)),
        "undisturbed": share(len(whole), len(runs)),
        "contacts": sum(run["collisions"] for run in runs),
        "missed": sum(run["missed"] for run in runs),
        "deadlines": sum(run["met"] + run["missed"] for run in runs),
        "time_s": quantile([run["time_s"] for run in runs], 0.5),
        "p99_s": quantile([run["time_s"] for run in runs], 0.99),
        "worst_s": max(run["time_s"] for run in runs),
        "fleet_bound_s": whole[0]["fleet_bound_s"],
        "shapes_s": [quantile([run["shapes_s"][k] for run in whole], 0.5) for k in range(len(SHAPES))],
        "start_s": quantile([run["barriers_s"][0] for run in whole], 0.5),
        "barrier_s": quantile(barriers, 0.5),
        "barrier_p99_s": quantile(barriers, 0.99),
        "sum_ratio": quantile([run["sum_ratio"] for run in whole], 0.5),
        "sum_ratio_worst": max(run["sum_ratio"] for run in whole),
        "min_gap_mm": min(run["min_gap_m"] for run in runs) * 1e3,
        "frames": quantile([run["frames"] for run in whole], 0.5),
    }


def targets(row: Row) -> list[Data]:
    """Return the targets for so many robots."""
    name, within = f"formation of {row['robots']}", LABS[row["robots"]][1]
    return [
        target(f"{name}: runs finished", 100.0 * row["finished"]["value"], at_least=100.0, unit="%"),
        target(f"{name}: contacts", row["contacts"], at_most=0),
        target(f"{name}: deadlines missed", row["missed"], at_most=0),
        target(f"{name}: time, barriers included, worst", row["worst_s"], at_most=within, unit="s"),
    ]


def drawn(rows: Sequence[Row]) -> Data:
    """Return the medians of the shapes' times as a figure, one upon the other."""
    at = range(len(rows))
    shown = [
        series(name, at, [row["shapes_s"][k]["value"] for row in rows], kind="stack") for k, name in enumerate(SHAPES)
    ]
    shown.append(series("least possible", at, [row["fleet_bound_s"] for row in rows], kind="points"))
    ticks = [{"at": place, "label": str(row["robots"])} for place, row in enumerate(rows)]
    count = " / ".join(str(row["time_s"]["n"]) for row in rows)
    note = f"medians of {count} seeds; each shape from the last one's last arrival; least possible: without turning"
    return figure("Formation control, shape by shape", note, [panel("robots", "time, s", shown, ticks=ticks)])


def tables(data: Data) -> dict[str, list[str]]:
    """Return the table of the page; the figure has the time of each shape."""
    rows = data["rows"]
    header = ("robots", "seeds", "smallest gap", "time, median", "p99", "least possible", "first barrier", "barrier")
    lines = [
        (
            str(row["robots"]),
            str(row["time_s"]["n"]),
            f"{row['min_gap_mm']:.0f} mm",
            text(row["time_s"], 2, " s"),
            text(row["p99_s"], 2, " s"),
            f"{row['fleet_bound_s']:.1f} s",
            f"{1e3 * row['start_s']['value']:.0f} ms",
            f"{1e3 * row['barrier_s']['value']:.0f} ms",
        )
        for row in rows
    ]
    return {NAME: table(header, lines)}
