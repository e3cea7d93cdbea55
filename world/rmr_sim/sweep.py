"""A sweep, `rmr sim LAB --seeds A-B`: runs of one lab with many seeds, their summary, and the files that they write.

The run folder gets `rows.jsonl`, with a row for each seed as soon as its run ends, and finally `sweep.json`, with all
rows and their summary. Each seed that failed gets a folder `failed/seed-N` with its report, its trace and, after an
internal error, `breakdown.txt`. A folder that becomes unwritable does not end the sweep: only these files are lost. A
sweep that ended early goes on with `--resume`. Each worker process loads the lab once and runs one seed at a time.
"""

import argparse
import json
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from rmr.entry import JSON_VERSION, ExitCode
from rmr_sim.arguments import command_of, cores
from rmr_sim.interruption import Interruption
from rmr_sim.run_setup import LoadedLab, Options, load
from rmr_sim.seed_run import BREAKDOWN_FILE, Result, Row, exit_code, fails, lost, run_seed, write_trace
from rmr_sim.sweep_rows import ResumeError, Rows, head, seeds_of, taken_up
from rmr_sim.sweep_summary import failing_lines, histogram_lines, lines_of, summary_of
from rmr_sim.worker_pool import WorkerPool
from rmr_world.finding import LabError
from rmr_world.lab_program import ProgramError
from rmr_world.run_report import write

SWEEP_FILE = "sweep.json"
TRACE_FILE = "trace.jsonl"
PROGRESS_FIRST_S = 10.0
"""Time of the first line of progress, where standard error is no terminal."""
PROGRESS_PERIOD_S_MAX = 600.0
"""Longest time between two lines of progress; the time doubles up to this bound."""
KEPT_MAX = 100
"""Bound of the failing seeds whose report and trace are kept: each takes a megabyte of disk."""


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


class Sweep:
    """A sweep and the rows of the runs that have ended."""

    def __init__(self, loaded: LoadedLab, seeds: range, folder: Path, file: Rows, rows: Sequence[Row] = ()) -> None:
        """`rows` are those of the runs before a sweep was resumed; the rows of further runs are added to `file`."""
        self._loaded = loaded
        self._seeds = seeds
        self._folder = folder
        self._file = file
        self._rows: dict[int, Row] = {row["seed"]: row for row in rows}
        self._left = [seed for seed in seeds if seed not in self._rows]
        self._kept = min(KEPT_MAX, sum(map(fails, rows)))
        self._time_s = self._took_s = 0.0

    def run(self, jobs: int) -> bool:
        """Run all seeds in `jobs` processes (1: in this one); return whether Ctrl-C ended it."""
        if not self._left:
            return False
        with Interruption() as interruption, _progress(len(self._left)) as tell:
            for result in self._results(jobs, interruption):
                self._take(result)
                tell(fails(result.row))
        return interruption.came

    def _results(self, jobs: int, interruption: Interruption) -> Iterator[Result]:
        if jobs > 1:
            yield from shared(self._loaded.lab.path, self._loaded.options, self._left, jobs, interruption)
            return
        for seed in self._left:
            result = run_seed(self._loaded, seed, interruption)
            if interruption.came:  # the run was cut short: its row is incomplete
                return
            yield result

    def _take(self, result: Result) -> None:
        self._rows[result.row["seed"]] = result.row
        self._time_s += result.time_s
        self._took_s += result.took_s
        if wrong := self._file.add(result.row):
            print(f"rmr sim: {wrong}", file=sys.stderr)
            self._kept = KEPT_MAX  # these files are in the same folder: writing them would fail, too
        if fails(result.row) and self._kept < KEPT_MAX:
            self._kept += 1
            self._keep(result)

    def _keep(self, result: Result) -> None:
        folder = self._folder / "failed" / f"seed-{result.row['seed']}"
        try:
            keep(result, folder)
        except OSError as error:
            self._kept = KEPT_MAX
            print(
                f"rmr sim: cannot write {folder}: {error.strerror}; no further seed that fails is kept", file=sys.stderr
            )

    @property
    def rows(self) -> list[Row]:
        """The rows, by seed."""
        return [self._rows[seed] for seed in sorted(self._rows)]

    @property
    def speed(self) -> float:
        """Seconds simulated in a second of one processor."""
        return self._time_s / self._took_s if self._took_s > 0 else 0.0

    def document(self, command: str) -> dict[str, Any]:
        """Return the content of `sweep.json`; `command` with `--seed` repeats a run."""
        rows = self.rows
        failing = [row["seed"] for row in rows if fails(row)]
        return {
            "version": JSON_VERSION,
            "lab": self._loaded.lab.name,
            "command": command,
            "first_seed": self._seeds[0],
            "last_seed": self._seeds[-1],
            "summary": summary_of(rows),
            "failing": [{"seed": seed, "command": f"{command} --seed {seed}"} for seed in failing],
            "rows": rows,
        }


class ProgressLines:
    """Progress as lines of text, at intervals that double up to `PROGRESS_PERIOD_S_MAX`."""

    def __init__(self, total: int, clock: Callable[[], float], say: Callable[[str], None]) -> None:
        """`clock` returns seconds; `say` prints a line."""
        self._total = total
        self._clock = clock
        self._say = say
        self._began_s = clock()
        self._next_s = PROGRESS_FIRST_S
        self._over = self._failed = 0

    def tell(self, failed: bool) -> None:
        """Count a run that has ended, and print a line of progress if one is due."""
        self._over += 1
        self._failed += failed
        took_s = self._clock() - self._began_s
        if took_s < self._next_s or self._over == self._total:
            return
        self._next_s = took_s + min(took_s, PROGRESS_PERIOD_S_MAX)
        left_s = took_s / self._over * (self._total - self._over)
        self._say(
            f"{self._over} of {self._total} runs, {self._failed} failed, after {_spell(took_s)}; "
            f"about {_spell(left_s)} to go"
        )


def _spell(length_s: float) -> str:
    return f"{length_s:.0f} s" if length_s < 120 else f"{length_s / 60:.0f} min"


def keep(result: Result, folder: Path) -> None:
    """Write the report, the trace and the internal error of a failed run to `folder`, as far as they exist."""
    folder.mkdir(parents=True, exist_ok=True)
    if result.report is not None:
        write(result.report, folder)
    if result.trace is not None:
        write_trace(result.trace, folder / TRACE_FILE)
    if result.breakdown is not None:
        (folder / BREAKDOWN_FILE).write_text(result.breakdown)


@contextmanager
def _progress(total: int) -> Iterator[Callable[[bool], None]]:
    """Show the progress of a sweep; yields the function to be called after each run with whether the run failed.

    A terminal gets a progress bar. Other outputs get a line at growing intervals, which keeps a log file short.
    """
    if not sys.stderr.isatty():
        yield ProgressLines(total, time.monotonic, lambda line: print(line, file=sys.stderr, flush=True)).tell
        return
    from rich.console import Console  # noqa: PLC0415 - only a terminal needs it
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("runs", total=total)
        failed = 0

        def tell(this_failed: bool) -> None:
            nonlocal failed
            failed += this_failed
            shown.update(task, advance=1, description=f"runs, {failed} failed" if failed else "runs")

        yield tell


def shared(
    path: Path, options: Options, seeds: Sequence[int], jobs: int, interruption: Interruption
) -> Iterator[Result]:
    """Yield the result of each seed as it comes, from `jobs` processes; end early when Ctrl-C comes."""
    with WorkerPool(min(jobs, len(seeds)), partial(_runner, path, options), lost) as pool:
        for _, result in pool.outcomes(seeds, interruption):
            yield result


def _runner(path: Path, options: Options) -> Callable[[int], Result]:
    """Return the runner of a seed. The files were valid when the sweep began; a later mistake in them is reported."""
    try:
        return partial(run_seed, load(path, options))
    except (LabError, ProgramError, OSError) as error:
        return partial(lost, error=str(error))
