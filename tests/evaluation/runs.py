"""Runs of the simulator, many at once: a pool of processes, rows in the order asked for.

Each run is a task of its own and depends on its lab, seed and options alone, so neither the number of processes nor
the order in which they come to it shows in the rows, but for the processor time.
"""

import signal
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from rmr_sim.run_setup import prepare, report_of
from rmr_sim.simulation import Simulation

ROOT = Path(__file__).parents[2]
LABS = ROOT / "deploy" / "labs"

Row = dict[str, Any]
Given = TypeVar("Given")
Found = TypeVar("Found")


@dataclass(frozen=True)
class Run:
    """One run of a lab."""

    lab: str
    """A folder of deploy/labs, or a path."""
    seed: int
    options: dict[str, Any] = field(default_factory=dict)
    """Of `rmr_sim.run_setup.prepare`."""
    measure: Callable[[Simulation, dict[str, Any]], Row] | None = None
    """What else belongs to the row, of the simulation and its report."""


def row(run: Run) -> Row:
    """Carry out one run; return its row."""
    simulation = prepare(LABS / run.lab, seed=run.seed, **run.options)
    began = time.process_time()
    finished = simulation.run()
    cpu_s = time.process_time() - began
    report = report_of(simulation, finished)
    deadlines = report["deadlines"]
    return {
        "seed": run.seed,
        "finished": finished,
        "time_s": report["time_s"],
        "bound_s": report["bound_s"],
        "ratio": report["time_s"] / report["bound_s"] if report["bound_s"] else None,
        "collisions": report["collisions"],
        "min_gap_m": report["min_gap_m"],
        "violations": len(report["violations"]),
        **{key: deadlines[key] for key in ("met", "missed", "best_possible")},
        "cpu_s": round(cpu_s, 3),
        **(run.measure(simulation, report) if run.measure else {}),
    }


def simulated(runs: Sequence[Run], jobs: int) -> list[Row]:
    """Carry out runs, `jobs` at once; return their rows in the same order."""
    return pooled(row, runs, jobs)


def pooled(function: Callable[[Given], Found], arguments: Sequence[Given], jobs: int) -> list[Found]:
    """Return `function` of each argument, worked out by `jobs` processes."""
    found = []
    if jobs <= 1:
        for argument in arguments:
            found.append(function(argument))
            _progress(len(found), len(arguments))
        return found
    with ProcessPoolExecutor(jobs, initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_DFL)) as pool:
        for each in pool.map(function, arguments):
            found.append(each)
            _progress(len(found), len(arguments))
    return found


def _progress(done: int, count: int) -> None:
    if sys.stderr.isatty():
        print(f"\r  {done} of {count}", end="\n" if done == count else "", file=sys.stderr, flush=True)
