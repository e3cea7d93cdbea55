"""What `rmr sim LAB --seeds A-B` does, and with `--resume` goes on to do: a run of each seed, and their summary."""

import argparse
import json
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from rmr.entry import ExitCode
from rmr_sim.arguments import command_of, cores
from rmr_sim.run_setup import LoadedLab
from rmr_sim.seed_run import Row, exit_code, fails
from rmr_sim.sweep import SWEEP_FILE, Sweep
from rmr_sim.sweep_histogram import histogram_lines
from rmr_sim.sweep_rows import ResumeError, Rows, head, seeds_of, taken_up
from rmr_sim.sweep_summary import failing_lines, lines_of, summary_of


def resume(arguments: argparse.Namespace, loaded: LoadedLab, out: TextIO) -> int:
    """Go on with a sweep that ended early; return the exit code."""
    folder = arguments.resume
    try:
        arguments.seeds = arguments.seeds or seeds_of(folder)
        rows = taken_up(folder, head(arguments, loaded.lab, arguments.seeds))
    except ResumeError as error:
        print(f"rmr sim: {error}", file=sys.stderr)
        return ExitCode.USAGE
    print(f"resuming: {len(rows)} of {len(arguments.seeds)} runs are over", file=sys.stderr)
    return sweep(arguments, loaded, folder, out, rows)


def sweep(arguments: argparse.Namespace, loaded: LoadedLab, folder: Path, out: TextIO, rows: Sequence[Row] = ()) -> int:
    """Carry out a sweep, in which the runs with `rows` are over; return the exit code."""
    loaded.simulation(arguments.seeds[0])  # what is wrong with the user's files shows here, once
    began = time.perf_counter()
    file = Rows(folder, head(arguments, loaded.lab, arguments.seeds), rows)
    sweep = Sweep(loaded, arguments.seeds, folder, file, rows)
    interrupted = sweep.run(min(arguments.jobs or cores(), len(arguments.seeds)))
    wall_s = time.perf_counter() - began
    command = command_of(arguments)
    text = json.dumps(sweep.document(command), indent=1, sort_keys=True)
    written = _sum_up(folder, text)
    lines = [*lines_of(summary_of(sweep.rows), sweep.speed), *histogram_lines(sweep.rows, out)]
    lines += failing_lines(sweep.rows, command)
    if not written:
        lines += ["rows:", *(json.dumps(row, sort_keys=True) for row in sweep.rows)]
    print(text if arguments.json else "\n".join(lines), file=out)
    where = f"all rows are in {folder / SWEEP_FILE}" if written else "all rows are on standard output"
    done = f"{len(sweep.rows)} of {len(arguments.seeds)} runs in {wall_s:.1f} s; {where}"
    again = f"; to go on: {command} --resume {shlex.quote(str(folder))}" if interrupted and written else ""
    print(f"{'interrupted: ' if interrupted else ''}{done}{again}", file=sys.stderr)
    if interrupted or not written or any(map(fails, sweep.rows)):
        return ExitCode.FAILED
    return max((exit_code(row, strict=arguments.strict) for row in sweep.rows), default=0)


def _sum_up(folder: Path, text: str) -> bool:
    """Write `sweep.json`, into a new folder where the old one is gone; return whether that was possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / SWEEP_FILE).write_text(text + "\n")
    except OSError as error:
        print(f"rmr sim: cannot write {folder / SWEEP_FILE}: {error.strerror}", file=sys.stderr)
        return False
    return True
