"""`rmr.sweep`: the runs of many seeds as a function, shared by whatever the caller has, such as processes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from rmr.base.errors import UsageError
from rmr.coord.timing import Order
from rmr_sim.lab_task import LabTask
from rmr_sim.run_setup import LoadedLab, load
from rmr_sim.seed_run import Row, fails, run_seed
from rmr_sim.simulation_api import lab_in, options_of, reading
from rmr_sim.sweep_summary import summary_of

Map = Callable[[Callable[[int], Row], list[int]], Iterable[Row]]
"""Calls a function with each seed, and returns what comes of it in any order."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """The results of a sweep."""

    lab: str
    """The lab's name."""
    rows: list[dict[str, Any]] = field(repr=False)
    """A row for each seed, in their order, as in `sweep.json`."""
    summary: dict[str, Any]
    """The figures of all rows, as in `sweep.json`."""
    failing: list[int]
    """The seeds that failed."""
    warnings: list[str]
    """Warnings about the lab and its program, as `rmr sim` prints them before the runs."""


def sweep(
    lab: str | PathLike[str],
    seeds: Iterable[int],
    *,
    map: Map = map,  # noqa: A002 - what it takes the place of
    robots: int | None = None,
    loss: float | None = None,
    chaos: bool = False,
    hard_chaos: bool = False,
    durable: bool = False,
    facts: Iterable[str] = (),
    faults: Iterable[Any] = (),
    order: str = Order.OURS.value,
    actions: str | PathLike[str] | None = None,
    events: str | PathLike[str] | None = None,
    duration: float | None = None,
) -> Sweep:
    """Simulate a lab with each of `seeds`; the rows are those of `rmr sim --seeds`, octet for octet.

    `map` is called once, with a function of a seed and the list of the seeds, as the built-in `map` is, which runs one
    after the other in this process. It may call the function in other processes, or on other machines that have the
    same RMR (the function can be pickled, and has lab and program with it), and return the rows in any order. The other
    arguments are those of `rmr.simulate`.

    Raises UsageError for an argument that cannot be used, or where `map` returns other rows than one for each seed;
    LabError or ProgramError for a lab or a program that is wrong.
    """
    wanted = _checked_seeds(seeds)
    if not callable(map):
        raise UsageError(f"map should be a function such as the built-in map, or pool.imap_unordered, not {map!r:.40}")
    path = lab_in(lab)
    options = options_of(
        robots=robots,
        loss=loss,
        chaos=chaos,
        hard_chaos=hard_chaos,
        durable=durable,
        facts=facts,
        faults=faults,
        order=order,
        actions=actions,
        event_file=None if events is None else Path(events),
        duration=duration,
    )
    with reading():
        loaded = load(path, options)
        loaded.simulation(wanted[0])  # what is wrong with the user's files shows here
        task = LabTask(loaded, _row)
    rows = _by_seed(map(task, list(wanted)), wanted)
    warnings = [line for text in loaded.warnings for line in text.splitlines()]
    return Sweep(loaded.lab.name, rows, summary_of(rows), [row["seed"] for row in rows if fails(row)], warnings)


def _row(loaded: LoadedLab, seed: int) -> Row:
    return run_seed(loaded, seed).row


def _checked_seeds(seeds: object) -> list[int]:
    """Return the seeds in ascending order. Raises UsageError."""
    takes = "a list or range of different whole numbers from 0"
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
        raise UsageError(f"seeds should be {takes}, not {seeds!r:.40}")
    found = list(seeds)
    for seed in found:
        if type(seed) is not int or seed < 0:
            raise UsageError(f"seeds should be {takes}; {seed!r:.40} is none")
    if not found or len(set(found)) < len(found):
        raise UsageError(f"seeds should be {takes}: {'one is there twice' if found else 'there is none'}")
    return sorted(found)


def _by_seed(rows: Iterable[Row], seeds: list[int]) -> list[Row]:
    """Return the rows in the order of `seeds`. Raises UsageError unless there is one for each."""
    if not isinstance(rows, Iterable):
        raise UsageError(f"map should return the rows that come of the seeds, not {rows!r:.40}")
    wanted = set(seeds)
    known: dict[int, Row] = {}
    for row in rows:
        if not isinstance(row, dict) or row.get("seed") not in wanted:
            raise UsageError(f"map should return the rows that come of the seeds; {row!r:.60} is none")
        if row["seed"] in known:
            raise UsageError(f"map returned two rows of seed {row['seed']}")
        known[row["seed"]] = row
    missing = [seed for seed in seeds if seed not in known]
    if missing:
        raise UsageError(f"map returned no row of {len(missing)} of {len(seeds)} seeds, such as {missing[0]}")
    return [known[seed] for seed in seeds]
