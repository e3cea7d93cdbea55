"""The engine beside CLIPS, experta and durable_rules: a table, JSON, and with --write a page and a figure.

    python tests/bench/engine.py [--rounds 15] [--quick] [--only NAME] [--engine NAME] [--output FILE] [--write FOLDER]

Processor time of one process, paired: in each round every engine runs the workload once, in turn first, and has to
come to the right end; ratios are of one round. Rivals come with `pip install -e .[bench]`; one that is not there is not
compared with. The exit code is 0 only if all that could be compared was taken and every target is met; --quick takes
small sizes, which say nothing, and judges none.
"""

import argparse
import collections
import collections.abc
import importlib
import inspect
import json
import os
import platform
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import by_hand
import costs
import page
from paired import Laps, Spread, Timing, contest, ratio, timing
from run import ROOT, Figure, UntakenError, show
from systems import CLIPS, DURABLE, EXPERTA, RMR, ClipsSystem, RmrSystem, System, WrongResultError, installed
from workloads import SUITE, Entry, Workload

from rmr.vm.engines import Engine, new_machine

USUAL: Engine = inspect.signature(new_machine).parameters["engine"].default
"""What runs where nothing else is said."""

EVENTS = 20_000
"""Of the latency: enough for the slowest of a hundred to be a distribution."""

MACHINES = 500
"""Whose memory is measured."""

EXPERTA_FACTOR = 100
"""Times as fast as experta, at least."""

MODULES = {CLIPS: "clips", EXPERTA: "experta", DURABLE: "durable"}
"""What is imported of each rival."""

PACKAGES = {CLIPS: "clipspy", EXPERTA: "experta", DURABLE: "durable_rules"}
"""What is installed of each."""


@dataclass(frozen=True)
class Comparison:
    """RMR beside one rival with one workload."""

    workload: str
    size: int
    firings: int
    """Of RMR, in one run."""
    rival: str
    rmr_s: Timing
    rival_s: Timing | None
    """None: the rival is not installed."""
    ratio: Spread | None
    """RMR's time over the rival's."""
    target: float | None

    @property
    def met(self) -> bool | None:
        """Whether the target holds; None: there is none, or no rival."""
        return None if self.target is None or self.ratio is None else self.ratio.median <= self.target


@dataclass
class Record:
    """All that was taken."""

    comparisons: list[Comparison]
    figures: list[Figure]
    missing: list[str]
    """Rivals that are not installed."""
    errors: list[str]

    @property
    def met(self) -> bool:
        """Whether nothing went wrong and all targets are met."""
        return not self.errors and all(each.met is not False for each in (*self.comparisons, *self.figures))


@dataclass(frozen=True)
class Plan:
    """How to take it."""

    options: dict[str, Any]
    """Of RMR's machines."""
    missing: Sequence[str]
    """Rivals to do without."""
    rounds: int
    quick: bool = False


def large(entry: Entry, plan: Plan) -> tuple[Workload, list[System]]:
    """Return the workload at its full size, for RMR, CLIPS, also with its default strategy, and Python by hand."""
    workload = entry.make(entry.small if plan.quick else entry.size)
    systems: list[System] = [RmrSystem(workload, **plan.options)]
    if CLIPS not in plan.missing:
        clips = importlib.import_module(MODULES[CLIPS])
        systems.append(ClipsSystem(workload, clips))
        if workload.strategy != "depth":
            systems.append(ClipsSystem(workload, clips, "depth"))
        if workload.name in by_hand.RULES:
            systems.append(by_hand.HandSystem(workload))
    return workload, systems


def small(entry: Entry, plan: Plan) -> tuple[Workload, list[System]]:
    """Return the workload at its small size, for RMR and the rivals that need much longer."""
    workload = entry.make(entry.small)
    systems: list[System] = [RmrSystem(workload, **plan.options)]
    if EXPERTA not in plan.missing:
        # frozendict 1.2, which experta needs, looks for what Python 3.10 has moved away
        collections.Mapping = collections.abc.Mapping  # type: ignore[attr-defined]
        experta = importlib.import_module("in_experta")
        if workload.name in experta.RULES:
            systems.append(experta.ExpertaSystem(workload))
    if DURABLE not in plan.missing:
        durable = importlib.import_module("in_durable")
        if workload.name in durable.RULES:
            systems.append(durable.DurableSystem(workload))
    return workload, systems


def compared(entry: Entry, workload: Workload, laps: Laps, runs: int) -> list[Comparison]:
    """Return RMR beside each other system of one contest, or beside a CLIPS that is not there if there is none."""
    targets = {CLIPS: entry.target, f"{CLIPS}, depth": entry.target, EXPERTA: 1 / EXPERTA_FACTOR}
    mine = laps.pop(RMR)
    return [
        Comparison(
            entry.title,
            workload.size,
            workload.firings,
            rival,
            timing(mine, runs),
            timing(theirs, runs) if theirs else None,
            ratio(mine, theirs) if theirs else None,
            targets.get(rival),
        )
        for rival, theirs in (laps or {CLIPS: []}).items()
    ]


def compare(entry: Entry, plan: Plan) -> list[Comparison]:
    """Take one workload with all that are there.

    Raises:
        WrongResultError: an engine did not come to the right end.
    """
    found = []
    for make, runs in ((large, 1 if plan.quick else entry.runs), (small, 1)):
        workload, systems = make(entry, plan)
        if make is small and len(systems) == 1:
            continue  # nobody to compare with
        laps = contest(systems, workload.ending, plan.rounds, runs)
        found += compared(entry, workload, laps, runs)
    return found


def take(only: str, plan: Plan) -> Record:
    """Take everything that has `only` in its name."""
    record = Record([], [], list(plan.missing), [])
    for entry in SUITE:
        if only in entry.title:
            progress(entry.title)
            try:
                record.comparisons += compare(entry, plan)
            except WrongResultError as error:
                record.errors.append(f"{entry.title}: {error}")
    for name, group in groups(plan).items():
        if only in name:
            progress(name)
            try:
                record.figures += group()
            except UntakenError as error:
                record.errors.append(f"{name}: {error}")
    progress("")
    return record


def groups(plan: Plan) -> dict[str, Callable[[], Iterable[Figure]]]:
    """Return what is taken of one machine, by name."""
    events = 1000 if plan.quick else EVENTS
    found: dict[str, Callable[[], Iterable[Figure]]] = {"latency": lambda: costs.latency(plan.options, events)}
    if CLIPS not in plan.missing:
        clips = importlib.import_module(MODULES[CLIPS])
        found["latency, CLIPS"] = lambda: costs.clips_latency(clips, events)
    found["memory"] = lambda: costs.memory(plan.options, 20 if plan.quick else MACHINES)
    found["load"] = lambda: costs.load(plan.options, plan.rounds)
    return found


def progress(name: str) -> None:
    """Say on a terminal what is being taken."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{name} ..." if name else "\r\x1b[K", end="", file=sys.stderr, flush=True)


def show_table(lines: Sequence[Sequence[str]]) -> None:
    """Print a table whose columns are as wide as their widest cell."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def as_data(record: Record, plan: Plan) -> dict[str, Any]:
    """Return the record for JSON."""
    return {
        "taken": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {"cores": os.cpu_count(), "python": platform.python_version(), "system": platform.system()},
        "engine": plan.options.get("engine", USUAL).value,
        "rounds": plan.rounds,
        "quick": plan.quick,
        "comparisons": [asdict(each) | {"met": each.met} for each in record.comparisons],
        "figures": [asdict(each) | {"met": each.met} for each in record.figures],
        "rivals": {PACKAGES[name]: version(PACKAGES[name]) for name in MODULES if name not in record.missing},
        "not installed": record.missing,
        "errors": record.errors,
    }


def main(words: Sequence[str] | None = None) -> int:
    """Take all figures; return the exit code."""
    parser = argparse.ArgumentParser(description="Compare the engine with others.")
    parser.add_argument("--rounds", type=int, default=15, help="rounds of each workload (default 15)")
    parser.add_argument("--quick", action="store_true", help="small sizes, nothing judged")
    parser.add_argument("--only", metavar="NAME", default="", help="only what has NAME in its name")
    parser.add_argument("--engine", choices=[each.value for each in Engine], default=USUAL.value, help="RMR's")
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "engine.json", metavar="FILE")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="renew FOLDER.md, and figure and data in FOLDER")
    arguments = parser.parse_args(words)
    missing = [name for name, module in MODULES.items() if not installed(module)]
    plan = Plan({"engine": Engine(arguments.engine)}, missing, arguments.rounds, arguments.quick)
    record = take(arguments.only, plan)
    data = as_data(record, plan)
    if record.comparisons:
        show_table([page.HEADER, *page.rows(data)])
    for name in record.missing:
        print(f"{name}: not installed")
    show(record.figures, record.errors)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(data, indent=1) + "\n")
    if arguments.write:
        page.write(arguments.write, data)
    taken = bool(record.comparisons or record.figures) and not record.errors
    return 0 if taken and (arguments.quick or record.met) else 1


if __name__ == "__main__":
    sys.exit(main())
