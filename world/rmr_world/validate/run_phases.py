"""The checks of a lab together with its program, by phase: the rest of fit, reachability, feasibility."""

from collections.abc import Callable, Iterable

from rmr.bytecode.program import Program
from rmr_world.finding import Finding
from rmr_world.lab import Lab
from rmr_world.validate import (
    beacon_fit,
    deadline_feasibility,
    exclusion,
    lab_lint,
    program_fit,
    reachability,
    schedulability,
    shape_fit,
)

Check = Callable[[Lab, Program], Iterable[Finding]]

FEASIBILITY = (
    *lab_lint.CHECKS,
    *shape_fit.CHECKS,
    *beacon_fit.LINT,
    *deadline_feasibility.CHECKS,
    *exclusion.CHECKS,
    *schedulability.CHECKS,
)
"""Checks of phase 4, which yield warnings only."""

RUN_PHASES: tuple[tuple[Check, ...], ...] = (
    (*program_fit.CHECKS, reachability.stations_used),
    reachability.CHECKS,
    FEASIBILITY,
)
"""The phases in order."""
