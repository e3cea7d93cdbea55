"""A lab as real processes, from the compiler to the report.

The order is: judge lab and program, with everything that is wrong with them; make the run folder; run (`launch`);
write ``report.json``; show the table. The report is written whatever becomes of the run. The exit code is that of
the commands' contract: 0 finished, 1 not finished or a process died, 2 wrong usage, 3 invalid program,
byte-code or lab file, 4 under ``--strict`` when a deadline was missed or robots touched.
"""

import asyncio
import sys
from collections.abc import Mapping
from typing import Any

import click
from rich.console import Console

from rmr.entry import ExitCode
from rmr_deploy.launch import Outcome, Run
from rmr_deploy.preparation import Plan, RefusedError, Wishes, make_plan
from rmr_deploy.record import make_report
from rmr_deploy.screen import make_screen, table
from rmr_world import report
from rmr_world.troubles import troubles


def perform(wishes: Wishes) -> int:
    """Run a lab as `wishes` say; return the exit code."""
    try:
        plan = make_plan(wishes, color=sys.stderr.isatty())
    except RefusedError as refusal:
        click.echo(str(refusal).rstrip("\n"), err=True)
        return refusal.exit_code
    if plan.program.warnings:
        click.echo(plan.program.warnings.rstrip("\n"), err=True)
    if plan.lab.faults:
        click.echo(
            f"{plan.lab.path}: faults: kill, restart, stall, slow and outage befall simulated robots alone (rmr sim); "
            "this run goes without them",
            err=True,
        )
    if plan.lab.events is not None:
        click.echo(
            f"{plan.lab.path}: events: only rmr sim has events of your own; this run goes without them", err=True
        )
    try:
        outcome, record = asyncio.run(run_and_report(plan))
    except OSError as error:
        click.echo(f"rmr up: {error}", err=True)
        return ExitCode.FAILED
    tell(record, outcome, plan)
    return exit_code(outcome, record, strict=wishes.strict) if outcome.report_error is None else ExitCode.FAILED


async def run_and_report(plan: Plan) -> tuple[Outcome, dict[str, Any]]:
    """Run, and write the report while signals are still in the run's hands: an impatient Ctrl-C loses nothing.

    A report that cannot be written does not keep the table back. Raises OSError when a process cannot be started.
    """
    run = Run(plan, make_screen(json=plan.wishes.as_json))
    outcome = await run.go()
    record = make_report(plan, outcome, run.watch)
    try:
        report.write(record, plan.folder)
    except OSError as error:
        outcome.report_error = f"cannot write {error.filename}: {error.strerror}"
    return outcome, record


def tell(record: Mapping[str, Any], outcome: Outcome, plan: Plan) -> None:
    """Show the table and the run in a few words, and where it is asked for the report as JSON."""
    as_json = plan.wishes.as_json
    where = f"the report is {plan.folder / report.REPORT_FILE}"
    if outcome.report_error is not None:
        click.echo(f"rmr up: {outcome.report_error}", err=True)
        where = "there is no report"
    Console(stderr=as_json, highlight=False).print(table(record))
    click.echo(f"{report.summary(record)}\n{outcome.reason}; {where}", err=as_json)
    for line in troubles(record):
        click.echo(f"rmr up: {line}", err=True)
    if as_json:
        click.echo(report.to_json(record), nl=False)


def exit_code(outcome: Outcome, record: Mapping[str, Any], *, strict: bool) -> int:
    """Return the exit code of a run."""
    if outcome.invalid and outcome.ready_s is None:
        return ExitCode.INVALID
    if not outcome.finished or outcome.died:
        return ExitCode.FAILED
    imperfect = record["deadlines"]["missed"] or record["collisions"]
    return ExitCode.STRICT if strict and imperfect else ExitCode.OK


__all__ = ["Wishes", "exit_code", "perform", "tell"]
