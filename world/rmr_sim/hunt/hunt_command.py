"""What `rmr sim LAB --hunt` does. Standard output has the findings alone; progress goes to standard error."""

import argparse
import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial, reduce
from operator import getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from rmr.base.time import NS_PER_S, in_seconds
from rmr.entry import JSON_VERSION, ExitCode
from rmr.entry.terminal import LiveLines, moves_cursor
from rmr_sim.arguments import command_of, cores
from rmr_sim.hunt.harm import Harm, with_harms
from rmr_sim.hunt.hunt_names import METHODS
from rmr_sim.hunt.hunt_search import HuntFinding, HuntSearch, Quarry, RunBatch
from rmr_sim.hunt.hunt_trial import Trial, TrialOutcome, lost, tried
from rmr_sim.interruption import Interruption, PoolLostError
from rmr_sim.lab_task import LabTask
from rmr_sim.run_setup import LoadedLab
from rmr_sim.worker_pool import WorkerPool, pool_of
from rmr_world.document import read
from rmr_world.faults import fault_entries, fault_line
from rmr_world.lab import Lab
from rmr_world.lab_file import files_of

if TYPE_CHECKING:
    from rmr_sim.cluster_pool import ClusterPool

HUNT_FILE = "hunt.json"
BUDGET_NS = 600 * NS_PER_S
"""Budget of a hunt that names none."""
PROGRESS_PERIOD_S_MAX = 600.0
"""Longest time between two lines of progress."""


def hunt(arguments: argparse.Namespace, loaded: LoadedLab, folder: Path, out: TextIO) -> int:
    """Hunt until the budget is over or enough is found; return the exit code: 1 if anything was found."""
    lab = loaded.lab
    loaded.simulation(arguments.seed)  # what is wrong with the user's files shows here, once
    quarry = Quarry(
        lab.seed if arguments.seed is None else arguments.seed, arguments.properties, arguments.methods or METHODS
    )
    budget = _Budget(arguments.runs, arguments.budget)
    print(f"hunting for {budget_words(budget.runs, budget.time_ns)}", file=sys.stderr)
    found: list[dict[str, Any]] = []
    jobs = arguments.jobs or cores()
    with (
        Interruption() as interruption,
        _batches(loaded, jobs, arguments.on, interruption) as run_batch,
        _progress() as (tell, live),
    ):
        search = HuntSearch(lab, quarry, run_batch, lambda runs: 0 if interruption.came else budget.left(runs))
        search.told = lambda: tell(_state(search, len(found)))
        for finding in search.findings():
            number = len(found) + 1
            file = folder / f"found-{number}.yaml"
            command = _repeating(arguments, file)
            found.append(finding_entry(lab, finding, command))
            if not arguments.json:
                lines = finding_lines(lab, number, finding, command, ended=not interruption.came)
                print("\n".join(lines), file=live if live and out.isatty() else out, flush=True)
            _write(file, lab_text(lab, finding, folder))
            if len(found) >= arguments.findings:
                break
    document = hunt_document(lab, quarry, _command(arguments, quarry), search.runs, search.closest_m, found)
    text = json.dumps(document, indent=1)
    if arguments.json:
        print(text, file=out)
    written = _write(folder / HUNT_FILE, text + "\n")
    where = f"; {folder / HUNT_FILE} has all of it" if written else ""
    took = f"{search.runs} runs in {budget.took_s:.0f} s"
    ended = "interrupted: " if interruption.came else ""
    print(f"{ended}{took}; {len(found) or 'nothing'} found{where}", file=sys.stderr)
    return ExitCode.FAILED if found or interruption.came or not written else 0


def _write(file: Path, text: str) -> bool:
    """Write `text` to `file`; return whether that was possible. What it has is on standard output as well."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    except OSError as error:
        print(f"rmr sim: cannot write {file}: {error.strerror}", file=sys.stderr)
        return False
    return True


def _repeating(arguments: argparse.Namespace, file: Path) -> str:
    """Return the command that repeats a finding from its lab file."""
    return command_of(argparse.Namespace(**{**vars(arguments), "lab": file, "strict": True}))


def _command(arguments: argparse.Namespace, quarry: Quarry) -> str:
    """Return the command that repeats the hunt."""
    words = [command_of(arguments), "--hunt", "--seed", str(quarry.seed), "--findings", str(arguments.findings)]
    if arguments.runs is not None:
        words += ["--runs", str(arguments.runs)]
    words += ["--properties", shlex.quote(",".join(quarry.properties))]
    if arguments.methods is not None:
        words += ["--methods", ",".join(quarry.methods)]
    return " ".join(words)


class _Budget:
    """How long a hunt goes on."""

    def __init__(self, runs: int | None, time_ns: int | None) -> None:
        """Both are bounds; without any of them the time is `BUDGET_NS`."""
        self.runs = runs
        self.time_ns = BUDGET_NS if runs is None and time_ns is None else time_ns
        self._began_s = time.monotonic()

    @property
    def took_s(self) -> float:
        """Time since the beginning, seconds."""
        return time.monotonic() - self._began_s

    def left(self, runs: int) -> int:
        """Return how many more runs there may be after `runs`."""
        if self.time_ns is not None and self.took_s * NS_PER_S >= self.time_ns:
            return 0
        return sys.maxsize if self.runs is None else max(0, self.runs - runs)


# -- running trials -----------------------------------------------------------------------------------------------


@contextmanager
def _batches(loaded: LoadedLab, jobs: int, on: str | None, interruption: Interruption) -> Iterator[RunBatch]:
    """Yield the function that runs trials, in this process, in `jobs` others, or on the cluster at `on`."""
    if jobs == 1 and on is None:
        yield partial(_in_turn, loaded, interruption)
        return
    with pool_of(jobs, on, LabTask(loaded, tried), lost) as pool:
        yield partial(_in_order, pool, interruption)


def _in_turn(loaded: LoadedLab, interruption: Interruption, trials: Sequence[Trial]) -> Iterator[TrialOutcome]:
    for trial in trials:
        if interruption.came:
            return
        yield tried(loaded, trial)


def _in_order(
    pool: "WorkerPool[Trial, TrialOutcome] | ClusterPool[Trial, TrialOutcome]",
    interruption: Interruption,
    trials: Sequence[Trial],
) -> Iterator[TrialOutcome]:
    """Yield the outcomes in the order of the trials, up to the first that an interruption has left out."""
    try:
        known = dict(pool.outcomes(trials, interruption))
    except PoolLostError as error:
        print(f"rmr sim: {error}", file=sys.stderr)
        interruption.came = True
        return
    for index in range(len(trials)):
        if index not in known:
            return
        yield known[index]


# -- progress -----------------------------------------------------------------------------------------------------


def _state(search: HuntSearch, found: int) -> str:
    """Return the line of progress."""
    reducing = f", reducing a finding: {search.shrink_runs} runs" if search.shrink_runs else ""
    return f"{search.runs} runs, closest call {100 * search.closest_m:.1f} cm, {found} found{reducing}"


@contextmanager
def _progress() -> Iterator[tuple[Callable[[str], None], LiveLines | None]]:
    """Show the state of a hunt: one line that changes on a terminal, lines at growing intervals elsewhere.

    Yields the function that shows it, and the line on the terminal, above which is to be written.
    """
    began_s = time.monotonic()
    live = LiveLines(sys.stderr) if moves_cursor(sys.stderr) else None
    # Time of the first line of progress, where standard error is no terminal; the time doubles with each line.
    next_s = 0.0 if live else 10.0
    with live or nullcontext():

        def tell(text: str) -> None:
            nonlocal next_s
            took_s = time.monotonic() - began_s
            if took_s < next_s:
                return
            line = f"{text}, after {took_s:.0f} s"
            if live is None:
                print(line, file=sys.stderr, flush=True)
                next_s = took_s + min(took_s, PROGRESS_PERIOD_S_MAX)
            else:
                live.show([line])
                next_s = took_s + 0.2  # period of the line of progress on a terminal

        yield tell, live


# ---- what a hunt tells: the smallest fault lists as lines of a lab file, and as lab files that repeat them
#
# A lab file that repeats a finding is the lab's own with the faults, the seed and the duration of the finding; so
# it is run without further options than those of the hunt.


def entries_of(lab: Lab, harms: Sequence[Harm]) -> list[dict[str, Any]]:
    """Return `harms` as entries of ``faults`` of a lab file, without those of the lab itself."""
    return fault_entries(with_harms(replace(lab, faults=(), disturbances=()), harms))


def duration_s(lab: Lab, finding: HuntFinding) -> float:
    """Return the duration of the run of a finding, seconds."""
    return in_seconds(with_harms(lab, finding.harms).duration)


def finding_lines(lab: Lab, number: int, finding: HuntFinding, command: str, *, ended: bool = True) -> list[str]:
    """Return the lines that tell a finding; `command` repeats it. Not `ended`: the reduction was interrupted."""
    broken = finding.broken
    smallest = "the smallest list" if ended else "the smallest list so far"
    lines = [
        f"{number}. {broken.name} at {broken.at_s:.3f} s of seed {finding.seed}: {broken.words}",
        f"   found after {finding.runs} runs; {smallest}, after {finding.shrink_runs} more:",
        f"duration: {duration_s(lab, finding):g}s",
        "faults:" if finding.harms else "faults: []",
        *(f"  - {fault_line(entry)}" for entry in entries_of(lab, finding.harms)),
    ]
    return [*lines, f"   to repeat it: {command}"]


def finding_entry(lab: Lab, finding: HuntFinding, command: str) -> dict[str, Any]:
    """Return the finding as an entry of the document."""
    broken = finding.broken
    return {
        "property": broken.name,
        "t_s": broken.at_s,
        "robots": list(broken.robots),
        "words": broken.words,
        "seed": finding.seed,
        "duration_s": duration_s(lab, finding),
        "faults": entries_of(lab, finding.harms),
        "faults_at_first": entries_of(lab, finding.at_first),
        "runs": finding.runs,
        "shrink_runs": finding.shrink_runs,
        "command": command,
    }


def hunt_document(
    lab: Lab, quarry: Quarry, command: str, runs: int, closest_m: float, found: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the content of `hunt.json`; `found` are entries of findings."""
    return {
        "version": JSON_VERSION,
        "lab": lab.name,
        "command": command,
        "seed": quarry.seed,
        "properties": list(quarry.properties),
        "methods": list(quarry.methods),
        "runs": runs,
        "closest_m": round(closest_m, 4),
        "found": found,
    }


def lab_text(lab: Lab, finding: HuntFinding, folder: Path) -> str:
    """Return the text of a lab file in `folder` that repeats a finding: a line of JSON, which is YAML, for each key."""
    value: Any = read(lab.path).value
    assert isinstance(value, dict), "the lab has been loaded from this file"
    value |= {"seed": finding.seed, "duration": duration_s(lab, finding)}
    for place, file in files_of(lab):
        if place:  # the image of a map stays beside the map file
            *above, key = place
            part = reduce(getitem, above, value)
            if key in part:  # what an option of the hunt names is in its command
                part[key] = os.path.relpath(file.resolve(), folder.resolve())
    own = value.pop("faults", None)
    lines = [f"{key}: {json.dumps(part)}" for key, part in value.items()]
    faults = [json.dumps(each) for each in own] if isinstance(own, list) else []
    faults += [fault_line(entry) for entry in entries_of(lab, finding.harms)]
    head = f"# {finding.broken.name} at {finding.broken.at_s:.3f} s: {' '.join(finding.broken.words.split())}"
    return "\n".join([head, *lines, "faults:", *(f"  - {line}" for line in faults)]) + ("\n" if faults else " []\n")


def budget_words(runs: int | None, time_ns: int | None) -> str:
    """Return the budget of a hunt in words."""
    parts = [] if runs is None else [f"{runs} run{'' if runs == 1 else 's'}"]
    parts += [] if time_ns is None else [f"{time_ns / NS_PER_S:g} s"]
    return " or ".join(parts)
