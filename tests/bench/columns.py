"""What running all robots at once costs: a table, and JSON in build/bench-columns.json.

    python tests/bench/columns.py [--quick] [--output FILE] [--write docs/benchmarks]

A million robots as columns on one core. Robot-firings a second are all firings of all robots over the processor time
of the run, from the initial facts to quiescence; of programs that never become quiet, over so many firings of each. The
octets of a robot are all columns, with stream, goals and counts. Each figure is the median of some rounds; the exit
code is 0 only if every target is met.
"""

import argparse
import gc
import json
import os
import statistics
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np
from page import figure_rows, renewed, table
from run import PROGRAMS, ROOT, Figure, show

from rmr.base.values import ROBOT_ID_MAX
from rmr.bytecode.program import Program
from rmr.columns.columns import Columns
from rmr.lang.compiler import compile_source

ROBOTS = 1_000_000
"""Many ensembles side by side: an id is not larger than a robot's can be."""
ROUNDS = 15
QUIET = 1_000
"""Firings after which figure 3 is quiet for certain."""

COIN = """
type side(robot, side).
side(R, heads).
side(R, heads) -o side(R, tails).
side(R, heads) -o side(R, edge).
side(R, tails) -o side(R, heads).
side(R, tails) -o side(R, edge).
side(R, edge) -o side(R, heads).
side(R, edge) -o side(R, tails).
"""
"""Never quiet; every firing is drawn."""
WALK = """
type at(robot, int, int).
at(R, 0, 0).
at(R, X, Y) -o at(R, X + 1, Y).
at(R, X, Y) -o at(R, X - 1, Y).
at(R, X, Y) -o at(R, X, Y + 1).
at(R, X, Y) -o at(R, X, Y - 1).
"""
"""Never quiet; every firing is one of four that are drawn, and counts with 64 bits."""


def program_of(text: str) -> Program:
    program = compile_source(text, "bench.rmr").program
    assert program is not None
    return program


def run(program: Program, robots: int, firings: int) -> tuple[float, int]:
    """Return robot-firings a second of processor time, and the octets of a robot."""
    ids = np.arange(robots) % (ROBOT_ID_MAX + 1)
    columns = Columns(program, ids, np.arange(robots, dtype=np.uint64) << np.uint64(32))
    gc.collect()
    began = time.process_time()
    columns.run(firings)
    taken_s = time.process_time() - began
    made = int(columns.firings.sum())
    assert made >= robots
    return made / taken_s, -(-columns.octets // robots)


def figures(*, quick: bool) -> Iterable[Figure]:
    robots, rounds = (ROBOTS // 10, 3) if quick else (ROBOTS, ROUNDS)
    figure3 = (PROGRAMS / "figure3.rmr").read_text()
    cases = [("figure 3 to quiescence", figure3, QUIET, 20.0), ("coin, 20 firings", COIN, 20, None)]
    for name, text, firings, target in [*cases, ("walk, 20 firings", WALK, 20, None)]:
        program = program_of(text)
        taken = [run(program, robots, firings) for _ in range(rounds)]
        speed = statistics.median(speed for speed, _ in taken) / 1e6
        yield Figure(f"{name}: robot-firings a second", speed, "million", target, at_least=True)
        yield Figure(f"{name}: memory of a robot", taken[0][1], "octets", 64)


def main() -> int:
    """Take all figures; return the exit code."""
    parser = argparse.ArgumentParser(description="Take what running all robots at once costs.")
    parser.add_argument("--quick", action="store_true", help="fewer robots and rounds")
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "bench-columns.json", metavar="FILE")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="renew the table in FOLDER.md, the data in FOLDER")
    options = parser.parse_args()
    taken = list(figures(quick=options.quick))
    show(taken, [])
    options.output.parent.mkdir(parents=True, exist_ok=True)
    record = {"robots": ROBOTS, "cores": os.cpu_count(), "numpy": np.__version__, "quick": options.quick}
    told = [{**asdict(figure), "met": figure.met} for figure in taken]
    data = json.dumps({**record, "figures": told}, indent=1) + "\n"
    options.output.write_text(data)
    if options.write:
        path = options.write.with_suffix(".md")
        rows = table(("a million robots", "taken", "target"), figure_rows(told))
        path.write_text(renewed(path.read_text("utf-8"), "\n".join([*rows, ""]), "columns"), "utf-8")
        (options.write / "columns.json").write_text(data)
    return 0 if all(figure.met for figure in taken) else 1


if __name__ == "__main__":
    sys.exit(main())
