"""Experiments with the radio in virtual time: what a channel carries before anything is deployed on it.

Each experiment is a module with a case (a frozen dataclass that refuses what cannot be run) and a function that runs
it and returns one row: a dictionary of plain values, fit for JSON. Fields and values have the names and forms of the
reference results, which the lr-wpan model of ns-3 3.44 produced; see `rmr.radio.trials.statistics`. Times are in ms
unless the name says otherwise.

    contention   stations around a silent sink send at random, or as fast as they can
    hidden       two stations send to a third and hear each other, or not
    storm        a broadcast that all members answer
    overlap      two frames at once, without any medium access
    latency      one sender alone: how long a frame takes
    link         one frame over a distance: power, noise, chance of arrival

A row averages over independent replications. Each has random streams that are named from its seed, and shares nothing
with the others. So the order of the replications and the number of processes do not matter (`Runs.over`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from rmr.radio.phy import RadioConfig

REFERENCE = RadioConfig(sensitivity_dbm=-106.58, interference="awgn")
"""The radio of ns-3's lr-wpan model as it comes: an ideal receiver, interference treated like noise."""

SEEDS = 10
"""Default number of replications: enough for a meaningful interval."""

Row = dict[str, Any]
"""What an experiment found."""

_Sample = TypeVar("_Sample")


class Over(Protocol):
    """How replications are run: `map`, or what maps in several processes; results come in the order of the seeds."""

    def __call__(self, trial: Callable[[int], _Sample], seeds: Sequence[int], /) -> Iterable[_Sample]:
        """Return the samples of `trial`, one for each seed."""


@dataclass(frozen=True)
class Runs:
    """With which radio, and how often, a case is run."""

    config: RadioConfig = field(default_factory=RadioConfig)
    seeds: Sequence[int] = range(SEEDS)
    """One replication for each."""
    over: Over = map

    def __post_init__(self) -> None:
        if not self.seeds:
            raise ValueError("no seeds: at least one replication is needed")
        if min(self.seeds) < 0:
            raise ValueError(f"seed {min(self.seeds)}: write 0 or more")
