"""The paper's figure 14: how long a run takes with one to five robots, and what it spends that on; then up to fifty.

The paper's execution time is "the total time spent on starting up robots, moving forward based on the planned path and
lining up at the destination" (V.C). Here, in lab time, from what the robots note (docs/trace.md):

- *starting up*: from the first tick until the first robot sets out: its first `action`. Robots localise themselves,
  find each other, elect a leader, which waits and orders them.
- *moving*: until the last robot is through: its hull is out of the narrow section (`left`).
- *lining up*: until the last robot stands in its place of the destination (`time_s` of the report).

The test-bed is the paper's: 1.5 m x 1.5 m, N = 30 cells a side. Its runs are taken in the simulator and, fewer, with a
process for each robot, while other processors simulate. The hall has room for fifty.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import fmean, linear_regression
from typing import Any

from experiment import Data, figure, panel, series, table, target
from intervals import mean, quantile, text
from runs import LABS, Row, Run, simulated

NAME = "figure14"
SEEDS = range(1, 31)
QUICK = range(1, 3)
ROBOTS = (1, 2, 3, 4, 5, 6)
"""The paper's one to five, and the sixth that the lab has."""
PAPER = ROBOTS[:5]
PROCESS_RUNS = 5
HALL = {1: 3, 5: 3, 10: 3, 20: 3, 30: 1, 50: 1}
"""Runs by the number of robots: fifty cost two hundred times as much as one."""
HALL_QUICK = {1: 1, 5: 1}
PHASES = ("starting_s", "moving_s", "lining_up_s")
LABELS = ("starting up", "moving", "lining up")
RUN_S_MAX = 180.0
"""Wall time of a run of processes, which takes some 15 s."""
GROWTH_S_MAX = 1.2
"""Of the test-bed's time with each robot more."""


def phases(notes: Iterable[Mapping[str, Any]], time_s: float) -> Row:
    """Return what a run spent its time on, from its robots' notes."""
    by_what: dict[str, list[float]] = {"action": [], "left": []}
    for note in notes:
        if note["what"] in by_what:
            by_what[note["what"]].append(note["t"])
    out, through = min(by_what["action"]), max(by_what["left"])
    return {
        "starting_s": round(out, 3),
        "moving_s": round(through - out, 3),
        "lining_up_s": round(max(0.0, time_s - through), 3),
    }


def measured(simulation: Any, report: Mapping[str, Any]) -> Row:
    """Return the phases of a simulated run."""
    return phases(simulation.trace(), report["time_s"])


def launched(lab: str, robots: int, seed: int) -> Row:
    """Run a lab with processes (`rmr up`); return its row."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        words = ["--robots", str(robots), "--seed", str(seed), "--json", "--run", str(run)]
        answer = subprocess.run(
            [sys.executable, "-P", "-m", "rmr_deploy.up", str(LABS / lab), *words],
            capture_output=True, text=True, timeout=RUN_S_MAX, check=False,
        )  # fmt: skip
        if not answer.stdout:
            raise RuntimeError(f"rmr up {lab} --robots {robots} gave no report: {answer.stderr.strip()}")
        report = json.loads(answer.stdout)
        lines = [line for log in sorted(run.glob("logs/robot-*.jsonl")) for line in log.read_text().splitlines()]
    notes = [note for note in map(json.loads, lines) if "what" in note]
    parts = report["robots"].values()
    return {
        "seed": seed,
        "finished": report["finished"],
        "time_s": report["time_s"],
        "bound_s": report["bound_s"],
        "collisions": report["collisions"],
        "missed": report["deadlines"]["missed"],
        "ticks_late": sum(part["ticks_late"] for part in parts),
        **phases(notes, report["time_s"]),
    }


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Run the test-bed in both ways and the hall, processes beside simulations."""
    full = len(seeds) >= PROCESS_RUNS
    hall = HALL if full else HALL_QUICK
    real_seeds = seeds[:PROCESS_RUNS] if full else seeds[:1]
    wanted = [("hall", n, seed) for n in reversed(hall) for seed in seeds[: hall[n]]]
    wanted += [("testbed", n, seed) for n in ROBOTS for seed in seeds]
    launches = [("testbed", n, seed) for n in PAPER for seed in real_seeds]
    with ThreadPoolExecutor(1) as thread:
        real = thread.submit(lambda: [launched(*each) for each in launches])
        found = simulated([Run(lab, seed, {"robots": n}, measured) for lab, n, seed in wanted], max(1, jobs - 1))
    runs = [named("simulated", each, row) for each, row in zip(wanted, found, strict=True)]
    runs += [named("processes", each, row) for each, row in zip(launches, real.result(), strict=True)]
    points = (("testbed", "simulated", ROBOTS), ("testbed", "processes", PAPER), ("hall", "simulated", tuple(hall)))
    rows = [
        {"lab": lab, "mode": mode, "robots": n, **summary(chosen(runs, lab, mode, n))}
        for lab, mode, counts in points
        for n in counts
    ]
    grown = {
        "test-bed, 1 to 6 robots": growth(runs, "testbed", ROBOTS),
        "test-bed, 3 to 6 robots": growth(runs, "testbed", ROBOTS[2:]),
        f"hall, 1 to {max(hall)} robots": growth(runs, "hall", tuple(hall)),
    }
    return {
        "options": {"robots": ROBOTS, "process_runs": len(real_seeds), "hall": list(hall.items())},
        "rows": rows,
        "growth_s": grown,
        "targets": targets(runs, grown),
        "figure": drawn(rows, len(seeds), len(real_seeds)),
        "runs": runs,
    }


def named(mode: str, point: tuple[str, int, int], row: Row) -> Row:
    """Return a run's row with the point that it belongs to."""
    return {"lab": point[0], "mode": mode, "robots": point[1], **row}


def targets(runs: Sequence[Row], grown: Mapping[str, Data]) -> list[Data]:
    """Return the targets, over all runs."""
    return [
        *(
            target(f"time with each robot more: {where}", slope["value"], at_most=GROWTH_S_MAX, unit="s")
            for where, slope in grown.items()
            if where.startswith("test-bed")
        ),
        target("figure 14: contacts in all runs", sum(run["collisions"] for run in runs), at_most=0),
        target("figure 14: runs not finished", sum(not run["finished"] for run in runs), at_most=0),
    ]


def chosen(runs: Iterable[Row], lab: str, mode: str, robots: int) -> list[Row]:
    """Return the runs of one point."""
    return [run for run in runs if (run["lab"], run["mode"], run["robots"]) == (lab, mode, robots)]


def summary(runs: Sequence[Row]) -> Row:
    """Return what the table tells of one point."""
    totals = [run["time_s"] for run in runs]
    return {
        **{name: mean([run[name] for run in runs]) for name in PHASES},
        "mean_s": mean(totals) if len(totals) > PROCESS_RUNS else ranged(totals),
        "median_s": quantile(totals, 0.5),
        "bound_s": runs[0]["bound_s"],
        "contacts": sum(run["collisions"] for run in runs),
    }


def ranged(values: Sequence[float]) -> Data:
    """Return the mean of values that are too few for an interval, with the lowest and the highest."""
    return {"value": fmean(values), "low": min(values), "high": max(values), "n": len(values)}


def growth(runs: Sequence[Row], lab: str, counts: Sequence[int]) -> Data:
    """Return the mean slope of time over robots, a slope for each seed by least squares."""
    points: dict[int, list[tuple[int, float]]] = {}
    for n in counts:
        for run in chosen(runs, lab, "simulated", n):
            points.setdefault(run["seed"], []).append((n, run["time_s"]))
    return mean([linear_regression(*zip(*each, strict=True)).slope for each in points.values()])


def drawn(rows: Sequence[Row], seeds: int, real: int) -> Data:
    """Return the figure: the test-bed as bars of phases, the hall as lines."""
    shown = [each for mode in ("simulated", "processes") for each in stack(picked(rows, "testbed", mode, PAPER), mode)]
    bounds = {row["robots"]: row["bound_s"] for row in picked(rows, "testbed", "simulated", PAPER)}
    shown.append(series("physical bound", bounds, bounds.values(), kind="points"))
    wide = [row for row in rows if row["lab"] == "hall"]
    counts = [row["robots"] for row in wide]
    total = series(
        "time", counts, [row["mean_s"]["value"] for row in wide],
        low=[row["mean_s"]["low"] for row in wide], high=[row["mean_s"]["high"] for row in wide],
    )  # fmt: skip
    lines = [total, series("physical bound", counts, [row["bound_s"] for row in wide])]
    parts = zip(PHASES, LABELS, strict=True)
    lines += [series(label, counts, [row[name]["value"] for row in wide]) for name, label in parts]
    note = (
        f"Test-bed 1.5 m x 1.5 m, 30 x 30 cells: means of {seeds} seeds a point simulated (plain), of {real} runs "
        f"a point with real processes (hatched). Hall 6 m x 4.5 m: simulated, one to three seeds a point. "
        f"Bars: 95 % interval of the mean time (bootstrap); of {PROCESS_RUNS} runs or fewer the lowest and the highest."
    )
    panels = [
        panel("robots", "execution time, s", shown, title="test-bed"),
        panel("robots", "execution time, s", lines, title="hall", y_from=0.0),
    ]
    return figure("Execution time over the number of robots (figure 14)", note, panels)


def picked(rows: Iterable[Row], lab: str, mode: str, counts: Sequence[int]) -> list[Row]:
    """Return the points of one lab and mode."""
    return [row for row in rows if row["lab"] == lab and row["mode"] == mode and row["robots"] in counts]


def stack(rows: Sequence[Row], mode: str) -> list[Data]:
    """Return the phases of some points as layers, the interval of the whole on the last."""
    counts = [row["robots"] for row in rows]
    layers = [
        series(label, counts, [row[name]["value"] for row in rows], kind="stack", group=mode)
        for name, label in zip(PHASES, LABELS, strict=True)
    ]
    below = [row["mean_s"]["value"] - row[PHASES[-1]]["value"] for row in rows]
    layers[-1] |= {
        side: [row["mean_s"][side] - base for row, base in zip(rows, below, strict=True)] for side in ("low", "high")
    }
    return layers


def tables(data: Data) -> dict[str, list[str]]:
    """Return the tables of the page: of each lab and mode the fewest and the most robots; the data have all."""
    header = ("lab", "mode", "robots", "time, s: mean", *(f"{label}, s" for label in LABELS), "mean / bound")
    series: dict[tuple[str, str], list[Row]] = {}
    for row in data["rows"]:
        series.setdefault((row["lab"], row["mode"]), []).append(row)
    lines = [
        (
            *(str(row[key]) for key in ("lab", "mode", "robots")),
            text(row["mean_s"]),
            *(f"{row[name]['value']:.2f}" for name in PHASES),
            f"{row['mean_s']['value'] / row['bound_s']:.2f}",
        )
        for rows in series.values()
        for row in ([rows[0], rows[-1]] if len(rows) > 1 else rows)
    ]
    grown = [(lab, text(found, 2, " s"), str(found["n"])) for lab, found in data["growth_s"].items()]
    return {NAME: [*table(header, lines), "", *table(("simulated", "time with each robot more", "seeds"), grown)]}
