"""A sweep, `rmr sim LAB --seeds A-B`: runs of one lab with many seeds, their summary, and the files that they write.

The run folder gets `rows.jsonl`, with a row for each seed as soon as its run ends, and finally `sweep.json`, with all
rows and their summary. Each seed that failed gets a folder `failed/seed-N` with its report, its trace and, after an
internal error, `breakdown.txt`. A folder that becomes unwritable does not end the sweep: only these files are lost. A
sweep that ended early goes on with `--resume`. Each worker process is given the loaded lab and runs one seed at a time.
"""

import argparse
import json
import shlex
import sys
import time
from bisect import insort
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any, TextIO

from rmr.entry import JSON_VERSION, ExitCode
from rmr.entry.terminal import LiveLines, moves_cursor, size
from rmr_sim.arguments import Shard, cores
from rmr_sim.interruption import Interruption, PoolLostError
from rmr_sim.lab_task import LabTask
from rmr_sim.run_setup import LoadedLab
from rmr_sim.seed_run import BREAKDOWN_FILE, Result, Row, exit_code, fails, lost, run_seed, write_trace
from rmr_sim.sweep_rows import Rows, RowsError, head, is_new, read, seeds_of, taken_up
from rmr_sim.sweep_summary import failing_lines, histogram_lines, lines_of, summary_of
from rmr_sim.worker_pool import WorkerPool, pool_of
from rmr_world.run_report import write

if TYPE_CHECKING:
    from rmr_sim.cluster_pool import ClusterPool

    Pool = WorkerPool[int, Result] | ClusterPool[int, Result]

SWEEP_FILE = "sweep.json"
TRACE_FILE = "trace.jsonl"
PROGRESS_PERIOD_S_MAX = 600.0
"""Longest time between two lines of progress; the time doubles up to this bound."""
KEPT_MAX = 100
"""Bound of the failing seeds whose report and trace are kept, the least ones: each takes a megabyte of disk."""


def resume(arguments: argparse.Namespace, loaded: LoadedLab, out: TextIO) -> int:
    """Go on with a sweep that ended early, or begin it if its seeds are named; return the exit code."""
    folder = arguments.resume
    try:
        if arguments.seeds is not None and is_new(folder):
            folder.mkdir(parents=True, exist_ok=True)
            return sweep(arguments, loaded, folder, out)
        first, _ = read(folder)
        arguments.seeds = arguments.seeds or seeds_of(first)
        arguments.shard = arguments.shard or Shard(*first["shard"])
        rows = taken_up(folder, head(arguments, loaded))
    except RowsError as error:
        print(f"rmr sim: {error}", file=sys.stderr)
        return ExitCode.USAGE
    seeds = arguments.shard.seeds(arguments.seeds)
    print(f"resuming: {len(rows)} of {len(seeds)} runs are over", file=sys.stderr)
    return sweep(arguments, loaded, folder, out, rows)


def sweep(arguments: argparse.Namespace, loaded: LoadedLab, folder: Path, out: TextIO, rows: Sequence[Row] = ()) -> int:
    """Carry out a sweep, in which the runs with `rows` are over; return the exit code."""
    shard = arguments.shard = arguments.shard or Shard()
    seeds = shard.seeds(arguments.seeds)
    loaded.simulation(seeds[0])  # what is wrong with the user's files shows here, once
    began = time.perf_counter()
    first = head(arguments, loaded)
    jobs = min(arguments.jobs or cores(), len(seeds))
    with ExitStack() as stack:
        pool: Pool | None = None
        if jobs > 1 or arguments.on is not None:
            pool = pool_of(jobs, arguments.on, LabTask(loaded, run_seed), lost)
            stack.enter_context(pool)
        sweep = SweepRuns(loaded, seeds, folder, Rows(folder, first, rows), rows)
        ended = sweep.run(pool)
    wall_s = time.perf_counter() - began
    written = summed_up(first, sweep.rows, folder, out, sweep.speed, json_wanted=arguments.json)
    where = f"all rows are in {folder / SWEEP_FILE}" if written else "all rows are on standard output"
    done = f"{len(sweep.rows)} of {len(seeds)} runs in {wall_s:.1f} s; {where}"
    on = f" --on {arguments.on}" if arguments.on else ""
    again = f"; to go on: {first['command']}{on} --resume {shlex.quote(str(folder))}" if ended and written else ""
    print(f"{f'{ended}: ' if ended else ''}{done}{again}", file=sys.stderr)
    return ExitCode.FAILED if ended or not written else exit_code_of(sweep.rows, strict=arguments.strict)


def summed_up(
    first: dict[str, Any], rows: Sequence[Row], folder: Path, out: TextIO, speed: float | None, *, json_wanted: bool
) -> bool:
    """Write `sweep.json`, and print the summary or, if that is wanted, the document; return whether it is written."""
    text = json.dumps(document(first, rows), indent=1, sort_keys=True)
    written = _write_document(folder, text)
    lines = [*lines_of(summary_of(rows), speed), *histogram_lines(rows, out)]
    lines += failing_lines(rows, first["command"])
    if not written:
        lines += ["rows:", *(json.dumps(row, sort_keys=True) for row in rows)]
    print(text if json_wanted else "\n".join(lines), file=out)
    return written


def exit_code_of(rows: Sequence[Row], *, strict: bool) -> int:
    """Return the exit code of a sweep that is over."""
    if any(map(fails, rows)):
        return ExitCode.FAILED
    return max((exit_code(row, strict=strict) for row in rows), default=0)


def document(first: dict[str, Any], rows: Sequence[Row]) -> dict[str, Any]:
    """Return the content of `sweep.json`, given the first line of the rows' file and the rows by seed."""
    command = first["command"]
    failing = [row["seed"] for row in rows if fails(row)]
    return {
        "version": JSON_VERSION,
        "lab": first["lab"],
        "command": command,
        "first_seed": first["seeds"][0],
        "last_seed": first["seeds"][1],
        "shard": first["shard"],
        "summary": summary_of(rows),
        "failing": [{"seed": seed, "command": f"{command} --seed {seed}"} for seed in failing],
        "rows": list(rows),
    }


def _write_document(folder: Path, text: str) -> bool:
    """Write `sweep.json`, into a new folder where the old one is gone; return whether that was possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / SWEEP_FILE).write_text(text + "\n")
    except OSError as error:
        print(f"rmr sim: cannot write {folder / SWEEP_FILE}: {error.strerror}", file=sys.stderr)
        return False
    return True


class SweepRuns:
    """A sweep and the rows of the runs that have ended."""

    def __init__(self, loaded: LoadedLab, seeds: range, folder: Path, file: Rows, rows: Sequence[Row] = ()) -> None:
        """`rows` are those of the runs before a sweep was resumed; the rows of further runs are added to `file`."""
        self._loaded = loaded
        self._seeds = seeds
        self._folder = folder
        self._file = file
        self._rows: dict[int, Row] = {row["seed"]: row for row in rows}
        self._left = [seed for seed in seeds if seed not in self._rows]
        self._kept = [row["seed"] for row in self.rows if fails(row)][:KEPT_MAX]
        self._keeps = True
        self._time_s = self._took_s = 0.0

    def run(self, pool: "Pool | None") -> str:
        """Run all seeds in `pool`, or in this process; return what ended it early in words, else an empty string."""
        ended = ""
        if not self._left:
            return ended
        with Interruption() as interruption, _progress(len(self._left)) as tell:
            try:
                for result in self._results(pool, interruption):
                    self._take(result)
                    tell(fails(result.row))
            except PoolLostError as error:
                ended = str(error)
        if len(self._rows) == len(self._seeds):
            self._file.sort(self.rows)
        return "interrupted" if interruption.came else ended

    def _results(self, pool: "Pool | None", interruption: Interruption) -> Iterator[Result]:
        if pool is not None:
            for _, result in pool.outcomes(self._left, interruption):
                yield result
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
        if fails(result.row) and self._keeps:
            self._keep(result)  # before its row: a sweep that is killed in between runs the seed again
        if wrong := self._file.add(result.row):
            print(f"rmr sim: {wrong}", file=sys.stderr)
            self._keeps = False  # these files are in the same folder: writing them would fail, too

    def _keep(self, result: Result) -> None:
        """Keep the files of a seed that failed if it is among the first: whichever order the runs end in."""
        insort(self._kept, result.row["seed"])
        dropped = self._kept.pop() if len(self._kept) > KEPT_MAX else None
        folder = failed_folder(self._folder, result.row["seed"])
        try:
            if dropped != result.row["seed"]:
                keep(result, folder)
            if dropped is not None:
                rmtree(failed_folder(self._folder, dropped), ignore_errors=True)
        except OSError as error:
            self._keeps = False
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


class ProgressLines:
    """Progress as lines of text, at intervals that double up to `PROGRESS_PERIOD_S_MAX`."""

    def __init__(self, total: int, clock: Callable[[], float], say: Callable[[str], None]) -> None:
        """`clock` returns seconds; `say` prints a line."""
        self._total = total
        self._clock = clock
        self._say = say
        self._began_s = clock()
        self._next_s = 10.0  # seconds
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


def failed_folder(run: Path, seed: int) -> Path:
    """Return the folder of a seed that failed."""
    return run / "failed" / f"seed-{seed}"


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

    A terminal gets a line with a bar. Other outputs get a line at growing intervals, which keeps a log file short.
    """
    if not moves_cursor(sys.stderr):
        yield ProgressLines(total, time.monotonic, lambda line: print(line, file=sys.stderr, flush=True)).tell
        return
    began_s = time.monotonic()
    over = failures = 0
    with LiveLines(sys.stderr) as live:

        def draw() -> None:
            took_s = time.monotonic() - began_s
            left = f", about {_spell(took_s / over * (total - over))} left" if over else ""
            text = f"{over}/{total} runs{f', {failures} failed' if failures else ''}, {_spell(took_s)}{left}"
            room = min(40, size(sys.stderr)[0] - len(text) - 4)
            live.show([f"{text} [{'#' * (room * over // total):<{room}}]" if room > 4 else text])

        def tell(failed: bool) -> None:
            nonlocal over, failures
            over += 1
            failures += failed
            draw()

        draw()
        yield tell
