"""The entry point of validation: the phases in order, from a document to a lab that is ready to run.

A phase with errors ends validation, for the later ones would report consequences of the same errors.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

from rmr.bytecode.program import Program
from rmr_world.document import Document
from rmr_world.finding import Finding, LabError
from rmr_world.lab import Lab
from rmr_world.validate import beacon_fit, floor_fit, reference_fit, shape_fit
from rmr_world.validate.lab_draft import LabDraft
from rmr_world.validate.schema_conformance import check_schema

FILE_FIT = (*floor_fit.CHECKS, *beacon_fit.CHECKS, *shape_fit.FILE_CHECKS, *reference_fit.CHECKS)
"""Checks of phase 2 that need the lab file alone."""

RunCheck = Callable[[Lab, Program], Iterable[Finding]]


def run_phases() -> tuple[tuple[RunCheck, ...], ...]:
    """Return the checks of a lab together with its program, by phase: the rest of fit, reachability, feasibility.

    Those of feasibility yield warnings only.
    """
    # Planner and engine double the start-up time of a world that is given no program to check.
    from rmr_world.validate import (  # noqa: PLC0415
        deadline_feasibility,
        exclusion,
        lab_lint,
        program_fit,
        reachability,
        schedulability,
    )

    feasibility = (
        *lab_lint.CHECKS,
        *shape_fit.CHECKS,
        *beacon_fit.LINT,
        *deadline_feasibility.CHECKS,
        *exclusion.CHECKS,
        *schedulability.CHECKS,
    )
    return (*program_fit.CHECKS, reachability.stations_used), reachability.CHECKS, feasibility


def lab_of(document: Document, path: Path) -> Lab:
    """Return the lab that the document of the file `path` defines (phases 1 and 2). Raises LabError."""
    draft = LabDraft(document, check_schema(document), path)
    errors = [*draft.errors, *(finding for check in FILE_FIT for finding in check(draft))]
    if errors:
        raise LabError(errors)
    return draft.lab()


def run_findings(lab: Lab, program: Program) -> list[Finding]:
    """Return what is wrong, or can hardly be intended, with a run of `program` in `lab`, in the order of the files.

    These are the errors of the first phase that has any, else the warnings of all phases.
    """
    found: list[Finding] = []
    for checks in run_phases():
        found += [finding for check in checks for finding in check(lab, program)]
        errors = [finding for finding in found if not finding.is_warning]
        if errors:
            return sorted(dict.fromkeys(errors))
    return sorted(found)
