"""One run of a hunt: a seed and a list of harms, and what came of it. A run that breaks a property ends there."""

import traceback
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rmr.base.mistake import words
from rmr.base.time import Instant, in_seconds
from rmr_sim.event import EventError
from rmr_sim.hunt.harm import Harm, with_harms
from rmr_sim.hunt.hunt_names import CONTACT, EXCLUSION, RULES, UNFINISHED
from rmr_sim.hunt.lineage import APART_M, LineageObserver, Support
from rmr_sim.run_setup import LoadedLab
from rmr_sim.simulation import Simulation
from rmr_sim.violation import Violation
from rmr_world.lab_program import ProgramError

CHECKS = {"contact": CONTACT, "overlap": EXCLUSION}
"""Checks of docs/simulation.md that are a property of their own."""
ERROR = "error"
"""Property of a run that ended in an error: always looked for."""


class Trial(NamedTuple):
    """What is tried."""

    seed: int
    harms: tuple[Harm, ...]
    properties: tuple[str, ...]
    """Those looked for."""


class Broken(NamedTuple):
    """The property that a run broke."""

    name: str
    at_s: float
    robots: tuple[int, ...]
    words: str


@dataclass(frozen=True, slots=True)
class TrialOutcome:
    """The result of a trial."""

    trial: Trial
    broken: Broken | None
    closest_m: float
    """Smallest gap, metres, of two robots that closed in on each other."""
    supports: tuple[Support, ...]
    """Lineage of a good run; empty where a property was broken."""


class _Watch:
    """Ends a run at the first violation of a property that is looked for."""

    def __init__(self, simulation: Simulation, properties: Collection[str]) -> None:
        self._simulation = simulation
        self._properties = properties
        self._seen = 0
        self.broken: Broken | None = None
        simulation.checkers.append(self)

    def __call__(self, _now: Instant) -> None:
        violations = self._simulation.violations
        if len(violations) == self._seen:
            return
        for violation in violations[self._seen :]:
            name = CHECKS.get(violation.check, RULES)
            if self.broken is None and name in self._properties:
                self.broken = _broken(name, violation)
                self._simulation.stop()
        self._seen = len(violations)


def _broken(name: str, violation: Violation) -> Broken:
    said = violation.words if name != RULES else f"{violation.check}: {violation.words}"
    return Broken(name, round(in_seconds(violation.at), 3), violation.robots, said)


def tried(loaded: LoadedLab, trial: Trial) -> TrialOutcome:
    """Return what comes of `trial`."""
    try:
        return _tried(loaded, trial)
    except (EventError, ProgramError) as error:
        return lost(trial, str(error))
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return lost(trial, f"{words(error)}, in {last.name}, line {last.lineno} of {Path(last.filename).name}")


def _tried(loaded: LoadedLab, trial: Trial) -> TrialOutcome:
    simulation = loaded.simulation(trial.seed, harmed=partial(with_harms, harms=trial.harms))
    watch = _Watch(simulation, trial.properties)
    lineage = LineageObserver(simulation)
    finished = simulation.run()
    broken = watch.broken
    if broken is None and not finished and UNFINISHED in trial.properties:
        robots = tuple(robot.robot for robot in simulation.robots if not robot.finished())
        said = f"not finished: robot {', '.join(map(str, robots))}"
        broken = Broken(UNFINISHED, round(in_seconds(simulation.now), 3), robots, said)
    if broken is not None:
        return TrialOutcome(trial, broken, 0.0, ())
    return TrialOutcome(trial, None, lineage.closest_m, lineage.supports())


def lost(trial: Trial, error: str) -> TrialOutcome:
    """Return the outcome of a trial that ended in `error`."""
    return TrialOutcome(trial, Broken(ERROR, 0.0, (), error), APART_M, ())
