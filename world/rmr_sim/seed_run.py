"""The run of one seed of a sweep, and its row in the results.

A row depends on lab, seed and options alone, so that the rows of a sweep are the same for any number of processes and
any order. A failed run comes with its report and trace. An internal error (an assertion that fails) fails the seed and
is kept as well; the sweep goes on.
"""

import json
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rmr.base.file_errors import naming
from rmr.base.mistake import words
from rmr.entry import ExitCode
from rmr_sim.event import EventError
from rmr_sim.interruption import Interruption
from rmr_sim.run_setup import LoadedLab, report_of
from rmr_sim.simulation import Simulation
from rmr_sim.violation import CONTACT
from rmr_world.lab_program import ProgramError
from rmr_world.run_report import DECIMALS
from rmr_world.run_warnings import unhandled_failures, unsendable_facts

Row = dict[str, Any]
"""A seed's entry in sweep.json; `docs/simulation.md` describes its keys."""
BREAKDOWN_FILE = "breakdown.txt"


class Result(NamedTuple):
    """The result of one seed."""

    row: Row
    time_s: float
    """Simulated time."""
    took_s: float
    """Processor time of the simulation."""
    report: dict[str, Any] | None = None
    """The report of a failed run, unless that had an internal error."""
    trace: list[dict[str, Any]] | None = None
    """The trace of a failed run."""
    breakdown: str | None = None
    """The traceback of an internal error."""


def run_seed(loaded: LoadedLab, seed: int, interruption: Interruption | None = None) -> Result:
    """Run `seed` and return its result; `interruption` may stop it before its end."""
    simulation: Simulation | None = None
    began = time.process_time()
    try:
        simulation = loaded.simulation(seed)
        if interruption is not None:
            interruption.ends(simulation.stop)
        finished = simulation.run()
        took_s = time.process_time() - began
        report = report_of(simulation, finished)
    except (EventError, ProgramError) as error:
        return lost(seed, str(error))
    except Exception as error:
        broken = lost(seed, words(error))
        trace = [] if simulation is None else simulation.trace()
        return broken._replace(trace=trace, breakdown=traceback.format_exc())
    row = row_of(report)
    if not fails(row):
        return Result(row, simulation.time_s, took_s)
    return Result(row, simulation.time_s, took_s, report, simulation.trace())


def row_of(report: dict[str, Any]) -> Row:
    """Return the row of a run's report."""
    bound_s = report["bound_s"]
    violations: dict[str, int] = {}
    for violation in report["violations"]:
        violations[violation["check"]] = violations.get(violation["check"], 0) + 1
    return {
        "seed": report["seed"],
        "finished": report["finished"],
        "time_s": report["time_s"],
        "bound_s": bound_s,
        "time_to_bound": round(report["time_s"] / bound_s, DECIMALS) if bound_s else None,
        "deadlines": report["deadlines"],
        "collisions": report["collisions"],
        "violations": violations,
        "unhandled": unhandled_failures(report),
        "unsendable": unsendable_facts(report),
        "error": None,
    }


def lost(seed: int, error: str) -> Result:
    """Return the result of a seed that has no report, because of `error`."""
    row: Row = {
        "seed": seed,
        "finished": False,
        "time_s": None,
        "bound_s": None,
        "time_to_bound": None,
        "deadlines": {"met": 0, "missed": 0, "best_possible": 0},
        "collisions": 0,
        "violations": {},
        "unhandled": 0,
        "unsendable": 0,
        "error": error,
    }
    return Result(row, 0.0, 0.0)


def fails(row: Row) -> bool:
    """Return whether the run failed; a missed deadline alone is no failure."""
    broken = row["collisions"] or row["violations"] or _unheeded(row) or row["error"]
    return not row["finished"] or bool(broken)


def _unheeded(row: Row) -> bool:
    """Return whether something failed for which the program has no answer."""
    return bool(row.get("unhandled", 0) or row.get("unsendable", 0))


def reasons(row: Row) -> list[str]:
    """Return the reasons why a run failed."""
    if row["error"]:
        return [row["error"]]
    found = [] if row["finished"] else ["not finished"]
    if row.get("unhandled", 0):
        found.append(f"actions that failed without an `else`: {row['unhandled']}")
    if row.get("unsendable", 0):
        found.append(f"facts that no frames can carry: {row['unsendable']}")
    if row["collisions"]:
        found.append(f"{row['collisions']} contact{'s' if row['collisions'] > 1 else ''}")
    return found + [f"{check} ({count})" for check, count in sorted(row["violations"].items()) if check != CONTACT]


def exit_code(row: dict[str, Any], *, strict: bool) -> int:
    """Return the exit code for a run.

    0 fine; 1 not finished, a rule broken, an action of the user's failed unhandled, or a fact dropped that no frames
    can carry; 4 under --strict: a deadline missed, or a contact.
    """
    if not row["finished"] or _unheeded(row) or any(check != CONTACT for check in row["violations"]):
        return ExitCode.FAILED
    if strict and (row["deadlines"]["missed"] or row["collisions"]):
        return ExitCode.STRICT
    return 0


def write_trace(entries: Sequence[dict[str, Any]], path: Path) -> None:
    """Write a trace as JSON lines. Raises OSError with the name of the file."""
    with naming(path), path.open("w") as file:
        for entry in entries:
            file.write(json.dumps(entry) + "\n")
