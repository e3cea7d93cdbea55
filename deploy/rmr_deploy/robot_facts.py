"""`rmr facts` and `rmr config`: what robots hold, and the lab as the run took it."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rmr.entry import ExitCode
from rmr_deploy.active_runs import LAB_COPY, REPORT_FILE, LaunchedRun
from rmr_deploy.run_choice import FleetError, check_robots, chosen_run, shown
from rmr_deploy.run_requests import RequestError, ask_launcher


def show_facts(
    robots: Sequence[int], *, predicate: str | None, folder: Path | None, lab: str | None, as_json: bool
) -> int:
    """Print the facts of robots, as the launcher heard last, or as the report has them. Raises FleetError."""
    run = chosen_run(folder, lab, past=True)
    check_robots(run, robots)
    wanted = robots or run.roster
    held = {str(robot): _facts(run, robot) for robot in wanted}
    if predicate is not None:
        held = {robot: [fact for fact in facts if _name(fact) == predicate] for robot, facts in held.items()}
    if as_json:
        print(json.dumps(held, indent=2))
    elif len(wanted) == 1:
        print(*held[str(wanted[0])], sep="\n")
    else:
        print(*(f"{robot}: {fact}" for robot, facts in held.items() for fact in facts), sep="\n")
    return ExitCode.OK


def _name(fact: str) -> str:
    return fact.lstrip("!?").partition("(")[0]


def _facts(run: LaunchedRun, robot: int) -> list[str]:
    if run.launched:
        try:
            return _listed(ask_launcher(run.folder, {"do": "facts", "robot": robot}))
        except RequestError as error:
            raise FleetError(str(error), ExitCode.FAILED) from None
    path = run.folder / REPORT_FILE
    try:
        report = json.loads(path.read_text())
        return _listed(report["robots"][str(robot)])
    except (OSError, ValueError, KeyError, TypeError):
        message = f"what robot {robot} held is not known: {shown(path)} cannot be read or has no such robot"
        raise FleetError(message, ExitCode.FAILED) from None


def _listed(part: dict[str, Any]) -> list[str]:
    return [str(fact) for fact in part.get("facts", [])]


def show_config(source: Path | None, *, folder: Path | None, lab: str | None) -> int:
    """Print the lab of a run, or the lab in `source`, with all defaults. Raises FleetError."""
    if source is not None:
        if folder is not None or lab is not None:
            raise FleetError("LAB goes without --run and --lab")
        from rmr_deploy.resolved_lab import resolved_file  # noqa: PLC0415 - loads the checks of lab files

        print(json.dumps(resolved_file(source), indent=2))
        return ExitCode.OK
    run = chosen_run(folder, lab, past=True)
    path = run.folder / LAB_COPY
    try:
        print(path.read_text(), end="")
    except OSError as error:
        message = f"the lab of this run is not known: {shown(path)}: {error.strerror}"
        raise FleetError(f"{message}; of a lab file: rmr config LAB", ExitCode.FAILED) from None
    return ExitCode.OK
