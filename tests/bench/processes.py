"""How many ticks come too late where many robots share a few cores, as real processes.

    python tests/bench/processes.py [--output FILE] [--write FOLDER] [--page FILE]

The first robots of the hall, one to a process, and all of it in two. A tick is late if its whole frame of 1/60 s has
passed before the robot was called (`ticks_late` of the report). Its share is of all frames of the run and all robots,
and, harder, of those alone in which a robot had something to do. What else runs on the machine makes ticks late, too:
what the machine's host took of the processor's time stands beside the figures.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hosts import machine
from page import add_options, figure_rows, keep, table
from run import LABS, Figure

from rmr.base.time import TICK_HZ
from rmr.compiled import FOLDER, modules_in

RUNS = {"20 robots, a process each": ("--robots", "20"), "50 robots in two processes": ("--processes", "2")}
TIMEOUT_S = 90
"""Wall time of a run at most: twenty are through by then, and of fifty enough to judge."""
LATE_MAX_PERCENT = 1.0


def run(options: Sequence[str]) -> dict[str, Any]:
    """Return the report of one run of the hall."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-c", "from rmr.cli import main; main()", "up", str(LABS / "hall"), *options]
        subprocess.run([*words, "--run", folder, "--timeout", str(TIMEOUT_S)], capture_output=True, check=False)
        report: dict[str, Any] = json.loads((Path(folder) / "report.json").read_text("utf-8"))
        return report


def figures_of(name: str, report: dict[str, Any]) -> list[Figure]:
    """Return a run's figures."""
    robots = report["robots"].values()
    late, busy = (sum(robot[key] for robot in robots) for key in ("ticks_late", "ticks"))
    share, of_busy = 100 * late / (len(robots) * report["time_s"] * TICK_HZ), 100 * late / max(1, busy)
    return [
        Figure(f"{name}: late ticks", share, "%", LATE_MAX_PERCENT),
        Figure(f"{name}: of those with something to do", of_busy, "%"),
        Figure(f"{name}: contacts", report["collisions"], ""),
    ]


def _processor() -> list[int]:
    """Return the ticks of the processor so far: user, nice, system, idle, waiting, interrupts (two), steal."""
    return [int(word) for word in Path("/proc/stat").read_text().split()[1:9]]


def _stolen_percent(before: Sequence[int], after: Sequence[int]) -> float:
    return 100 * (after[7] - before[7]) / max(1, sum(after) - sum(before))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "processes")
    options = parser.parse_args()
    if not modules_in(FOLDER):
        parser.error("nothing is compiled, or sources have changed since: make fast")
    figures: list[Figure] = []
    for name, words in RUNS.items():
        before = _processor()
        figures += figures_of(name, run(words))
        figures.append(Figure(f"{name}: taken by the machine's host", _stolen_percent(before, _processor()), "%"))
    told = [{**asdict(figure), "met": figure.met} for figure in figures]
    header = ("real processes", "taken", "target")
    lines = table(header, figure_rows(told))
    aimed = table(header, figure_rows([each for each in told if each["target"] is not None]))
    print("\n".join(lines))
    keep(options, "processes.json", {"machine": machine(), "figures": told}, "processes", aimed)
    return 0 if all(figure.met for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
