"""`rmr attach`: table and report of a lab whose processes were started by hand, as `rmr up` shows those of its own.

It is a client of the bus that watches: robots come and go by their liveliness, and the run is over when the quorum of
the lab file holds the finish fact, when lab time stops, or on Ctrl-C. A world that falls silent is waited for; without
it nothing is known of the robots, so the watching ends when it has not returned in time. It starts and ends no process.
"""

import asyncio
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rmr.base.ids import named
from rmr.bus import wire
from rmr.bus.admission import why_no_session
from rmr.bus.certificates import CertificateError, check_keys, read_credentials, secret_file
from rmr.bus.endpoint import BusError, check_endpoint, host_problem
from rmr.bus.middleware import NotAdmittedError
from rmr.bus.secret import SecretError
from rmr.bus.session import open_when_there
from rmr.entry import ExitCode
from rmr.entry.files import unreadable
from rmr.entry.terminal import has_colour
from rmr_deploy.lab_run import make_report
from rmr_deploy.preparation import RunPlan, RunRefusedError, read_lab, read_program
from rmr_deploy.run_choice import FleetError
from rmr_deploy.run_end import judged_end
from rmr_deploy.run_options import RunOptions
from rmr_deploy.run_outcome import RunOutcome
from rmr_deploy.screen import RobotLine, Screen, make_screen
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world import run_report
from rmr_world.lab import Lab
from rmr_world.lab_file import lab_path
from rmr_world.quorum import NEVER_CAME, Fate

POLL_S = 0.1
WORLD_SILENT_S = 3.0
"""Silence of the world after which it is said: it tells its status twice a second."""


@dataclass(frozen=True, slots=True)
class AttachOptions:
    """What to attach to, and what to show."""

    lab: Path
    connect: str
    secret: Path | None
    as_json: bool
    strict: bool
    timeout_s: float
    """Limit for the world to answer, and to be heard of again."""


def attach(options: AttachOptions) -> int:
    """Watch a lab to its end; return the exit code, as `rmr up` would. Raises FleetError."""
    if missing := unreadable((lab_path(options.lab), secret_file(options.secret))):
        raise FleetError(missing[0])
    try:
        check_endpoint(options.connect)
        lab = read_lab(options.lab, None)
        plan = RunPlan(RunOptions(lab=options.lab), lab, read_program(lab, color=has_colour(sys.stderr)), Path())
        return asyncio.run(_watched(plan, options))
    except RunRefusedError as refusal:
        raise FleetError(str(refusal).rstrip("\n"), refusal.exit_code) from None
    except (SecretError, CertificateError) as error:
        raise FleetError(str(error), ExitCode.INVALID) from None
    except NotAdmittedError as error:
        raise FleetError(str(error), ExitCode.FAILED) from None
    except BusError as error:
        raise FleetError(str(error)) from None


async def _watched(plan: RunPlan, options: AttachOptions) -> int:
    began = time.monotonic()
    outcome = RunOutcome()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, setattr, outcome, "interrupted", True)
    monitor = await _monitor(plan.lab, options)
    screen = make_screen(json=options.as_json)
    try:
        await _until_over(plan.lab, monitor, screen, outcome, options)
    finally:
        screen.close()
    with suppress(TimeoutError):
        # Time for the last statuses after the finish: robots tell theirs at least once a second.
        await asyncio.wait_for(_all_told(plan.lab, monitor), 1.0)
    outcome.wall_s = time.monotonic() - began
    record = make_report(plan, outcome, monitor)
    monitor.close()
    stream = sys.stderr if options.as_json else sys.stdout
    print(f"{run_report.table_text(record, color=has_colour(stream))}\n{outcome.reason}", file=stream)
    if options.as_json:
        print(run_report.to_json(record), end="")
    if not outcome.finished:
        return ExitCode.FAILED
    imperfect = record["deadlines"]["missed"] or record["collisions"]
    return ExitCode.STRICT if options.strict and imperfect else ExitCode.OK


async def _monitor(lab: Lab, options: AttachOptions) -> StatusMonitor:
    """Return the monitor once the world's router answers and a process of the lab has told its status."""
    secret = read_credentials(options.secret)
    check_keys(secret, "operator", "viewer", of=lab.name if lab.mtls else None)
    if problem := host_problem(options.connect):
        raise FleetError(f"no world at {options.connect}{problem}", ExitCode.FAILED)
    opening = open_when_there(wire.OPERATOR_ID, options.connect, lambda: None, secret)
    try:
        async with asyncio.timeout(options.timeout_s):
            monitor = StatusMonitor(await opening, lab.name)
            while monitor.world is None:
                await asyncio.sleep(POLL_S)
    except TimeoutError:
        message = f"no world of lab {lab.name} answers at {options.connect} within {options.timeout_s:g} s"
        message += why_no_session(options.connect)
        raise FleetError(message, ExitCode.FAILED) from None
    return monitor


async def _until_over(
    lab: Lab, monitor: StatusMonitor, screen: Screen, outcome: RunOutcome, options: AttachOptions
) -> None:
    """Show the robots until the run is over; `outcome` says how it ended, and who was not there then."""
    lost = False
    while not outcome.reason:
        if lost != (monitor.world_silent_s > WORLD_SILENT_S):
            lost = not lost
            missed = f"{_silence(lab, monitor, options)}; waiting for it to return"
            screen.say(missed if lost else f"the world of lab {lab.name} is back")
        outcome.absent = _absent(lab, monitor)
        lines = [RobotLine(robot, *_line(robot, monitor)) for robot in lab.roster]
        screen.show(monitor.now_s if monitor.running(lab.roster) else None, lines)
        await asyncio.sleep(POLL_S)
        if outcome.interrupted:
            outcome.reason = f"interrupted; {_silence(lab, monitor, options) if lost else 'the lab goes on'}"
        elif monitor.world is not None and monitor.world.final:
            outcome.reason = "the world has ended"
        elif monitor.world_silent_s > max(options.timeout_s, WORLD_SILENT_S):
            outcome.reason = _silence(lab, monitor, options)
        elif _all_came(lab, outcome) and monitor.running(lab.roster):
            outcome.finished, outcome.reason = judged_end(lab, monitor, outcome.absent)


def _all_came(lab: Lab, outcome: RunOutcome) -> bool:
    """Return whether all robots of the lab have been there, and one is there still: before, nothing is judged."""
    return NEVER_CAME not in outcome.absent.values() and len(outcome.absent) < len(lab.roster)


def _silence(lab: Lab, monitor: StatusMonitor, options: AttachOptions) -> str:
    """Return what is known of a world that is not heard of any more, and of its robots."""
    where = "a router answers there, but not the world" if monitor.connected else "the connection is lost"
    told = f"no word of the world of lab {lab.name} at {options.connect} for {monitor.world_silent_s:.0f} s ({where})"
    robots = sorted(monitor.present)
    were = "was" if len(robots) == 1 else "were"
    return f"{told}; at {monitor.now_s:.1f} s of lab time {named(robots)} {were} there" if robots else told


def _absent(lab: Lab, monitor: StatusMonitor) -> dict[int, Fate]:
    return {robot: monitor.fate(robot) for robot in lab.roster if robot not in monitor.present}


def _line(robot: int, monitor: StatusMonitor) -> tuple[str, str]:
    if robot in monitor.present:
        return monitor.line(robot)
    fate = monitor.fate(robot)
    return "starting" if fate == NEVER_CAME else fate, ""


async def _all_told(lab: Lab, monitor: StatusMonitor) -> None:
    """Return when the part of every robot that has finished says when."""
    while any(monitor.finished((one,)) and monitor.report(one).get("finish_s") is None for one in lab.roster):
        await asyncio.sleep(POLL_S)
