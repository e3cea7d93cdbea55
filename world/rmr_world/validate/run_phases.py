"""The checks of a lab together with its program, by phase: the rest of fit, reachability, feasibility."""

from collections.abc import Callable, Iterable

from rmr.bytecode.program import Program
from rmr_world.finding import Finding
from rmr_world.lab import Lab
from rmr_world.validate import (
    area_capacity,
    beacon_fit,
    deadline_feasibility,
    exclusion,
    lab_lint,
    passages_passed,
    program_fit,
    reachability,
    schedulability,
    shape_fit,
    station_use,
)

Check = Callable[[Lab, Program], Iterable[Finding]]

FEASIBILITY = (
    *lab_lint.CHECKS,
    *shape_fit.CHECKS,
    *beacon_fit.LINT,
    *deadline_feasibility.CHECKS,
    *area_capacity.CHECKS,
    *passages_passed.CHECKS,
    *exclusion.CHECKS,
    *schedulability.CHECKS,
)
"""Checks of phase 4, which yield warnings only."""

RUN_PHASES: tuple[tuple[Check, ...], ...] = (
    (*program_fit.CHECKS, *station_use.FIT),
    (reachability.unreachable_places, *station_use.REACHABILITY),
    FEASIBILITY,
)
"""The phases in order."""
