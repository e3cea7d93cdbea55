"""Paired timing: in each round every system runs once, in turn first; what is compared are ratios of one round.

A machine that others use swings by half; what swings alike on both sides drops out of a ratio of runs that lie next to
each other. Times are processor time of the process, garbage collection is on for all, as it is in a robot, and starts
from a clean heap. It leaves out what was there before the first round, as with every command (`rmr.entry.Loading`): the
compiler and the rivals are no part of a run.
"""

import gc
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from systems import Lap, System
from workloads import Ending


@dataclass(frozen=True)
class Spread:
    """A median with its quartiles."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Return that of some values."""
        if len(values) < 2:
            return cls(values[0], values[0], values[0])
        low, median, high = statistics.quantiles(values, n=4, method="inclusive")
        return cls(median, low, high)


@dataclass(frozen=True)
class Timing:
    """What one system took over all rounds, in seconds for one run of the workload."""

    total: Spread
    run: Spread
    """Without loading the facts."""


Laps = dict[str, list[Lap]]
"""By system, one for each round: the sum of its runs in the round."""


def contest(systems: Sequence[System], ending: Ending, rounds: int, runs: int) -> Laps:
    """Let each system run `runs` times in each of some rounds, and see each time that it did what it had to.

    One run before counts for nothing: what is done once for a program is done then.

    Raises:
        WrongResultError: one did not.
    """
    laps: Laps = {system.name: [] for system in systems}
    for system in systems:
        _round(system, ending, 1)
    gc.freeze()
    for turn in range(rounds):
        first = turn % len(systems)
        for system in [*systems[first:], *systems[:first]]:
            laps[system.name].append(_round(system, ending, runs))
    return laps


def _round(system: System, ending: Ending, runs: int) -> Lap:
    gc.collect()
    load = run = 0.0
    for _ in range(runs):
        lap = system.once()
        load, run = load + lap.load, run + lap.run
        system.checked(ending)
        gc.collect(1)  # what the check has left is not the next run's to clear away
    return Lap(load, run)


def timing(laps: Sequence[Lap], runs: int) -> Timing:
    """Return what one run took."""
    return Timing(Spread.of([lap.total / runs for lap in laps]), Spread.of([lap.run / runs for lap in laps]))


def ratio(laps: Sequence[Lap], rivals: Sequence[Lap]) -> Spread:
    """Return the time of one system over that of another, round by round."""
    return Spread.of([lap.total / rival.total for lap, rival in zip(laps, rivals, strict=True)])
