"""`rmr kill`, `stop`, `start`, `restart`, `pause` and `unpause`: orders about robots of a lab that runs, or its world.

The launcher carries them out, for it alone may signal its processes and start them again. A verb waits until the lab
has started, and then until the order has taken effect: until the process has ended, or is started.
"""

import signal
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rmr.entry import ExitCode
from rmr_deploy.active_runs import LaunchedRun, recorded_run
from rmr_deploy.fleet_listing import told_status
from rmr_deploy.run_choice import FleetError, Remote, Steered, check_robots, chosen_run, shown
from rmr_deploy.run_requests import ROUTER, RequestError, UnansweredError, UnwrittenError, Who, base_name, called

POLL_S = 0.05
START_S = 35.0
"""Limit for a lab to have started; its launcher gives up after 30 s (`launch.READY_S_MAX`)."""
KILL_S = 5.0
"""Limit for a process to end after SIGKILL."""

DONE = {
    "kill": "killed",
    "stop": "stopped",
    "start": "started",
    "restart": "started again",
    "pause": "paused",
    "crash": "killed",
    "stall": "stalled",
    "slow": "slow",
    "outage": "without localisation",
    "unpause": "going on",
}
"""What a robot is after an order."""

NAMES = {"crash": "fault kill", "stall": "fault stall", "slow": "fault slow", "outage": "fault outage"}
"""Orders that are another command than the verb of their name."""


def signal_number(text: str) -> int:
    """Return the number of ``TERM``, ``SIGTERM`` or ``15``. Raises ValueError."""
    names = {one.name.removeprefix("SIG"): int(one) for one in signal.Signals}
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 4 else None
    found = names.get(text.upper().removeprefix("SIG")) if number is None else number
    if found is None or found not in signal.valid_signals():
        raise ValueError("should be a signal, such as KILL, SIGTERM or 15")
    return found


def give_order(
    verb: str,
    robots: Sequence[Who],
    *,
    folder: Path | None,
    lab: str | None,
    signal: int | None = None,
    timeout_s: float = 10.0,
    force: bool = False,
    lengths: Mapping[str, float] | None = None,
    there: Remote | None = None,
) -> int:
    """Give the order `verb` for each of `robots`; return the exit code. Raises FleetError.

    The lab is that which runs `there`, or a run on this machine. `lengths` are those of a fault, by the name that they
    have in a request.

    One that is refused does not keep the others from being carried out.
    """
    run = there or chosen_run(folder, lab)
    check_robots(run, [robot for robot in robots if isinstance(robot, int)])
    if not run.launched:
        raise FleetError(f"the launcher of lab {run.lab} is dead; rmr down ends what is left", ExitCode.FAILED)
    if verb != "start":
        wait_for_start(run, NAMES.get(verb, verb))
    code = ExitCode.OK
    more: dict[str, float] = {**(lengths or {}), **({} if signal is None else {"signal": signal})}
    for robot in robots:
        try:
            _order(run, verb, robot, more, timeout_s, force=force)
        except UnansweredError as error:
            raise FleetError(str(error), ExitCode.FAILED) from None
        except RequestError as error:
            hint = "; rmr restart --force stops it first" if verb == "restart" and "lives" in str(error) else ""
            print(f"rmr {NAMES.get(verb, verb)}: {error}{hint}", file=sys.stderr)
            code = ExitCode.FAILED
        else:
            print(f"{called(robot)} is {DONE[verb]}")
    return code


def wait_for_start(run: Steered, verb: str) -> None:
    """Wait until all robots of `run` have been ready. Raises FleetError if it is over before, or takes too long."""
    end = time.monotonic() + START_S
    waiting = False
    while _starts(run, known=waiting):
        if not waiting:
            print(f"rmr {verb}: lab {run.lab} is starting: waiting until its robots are ready", file=sys.stderr)
            waiting = True
        if time.monotonic() > end:
            raise FleetError(f"lab {run.lab} has not started within {START_S:g} s; see rmr ps", ExitCode.FAILED)
        time.sleep(POLL_S)
    if waiting and not run.launched:
        why = f"; rmr events --run {shown(run.folder)} tells why" if isinstance(run, LaunchedRun) else ""
        raise FleetError(f"lab {run.lab} was over before it had started{why}", ExitCode.FAILED)


def _starts(run: Steered, *, known: bool) -> bool:
    """Whether the launcher of `run` says that the lab starts.

    One of which that is `known`, and which does not answer now, is busy or ends: until it has ended it starts.
    """
    told = told_status(run)
    return known and run.launched if told is None else told["ready_s"] is None


def _order(run: Steered, verb: str, robot: Who, more: Mapping[str, float], timeout_s: float, *, force: bool) -> None:
    """Have an order carried out and wait for its effect. Raises RequestError."""
    if verb == "restart" and force and _process(run, robot)["state"] != "ended":
        _stop(run, robot, timeout_s)
    if verb == "stop":
        _stop(run, robot, timeout_s)
        return
    _ask(run, {"do": verb, "robot": robot, **more})
    # Signals after which the process ends.
    # The router has followed itself by then, and on another machine nothing could be asked meanwhile.
    if verb == "kill" and robot != ROUTER and more.get("signal") in {signal.SIGKILL, signal.SIGTERM, signal.SIGINT}:
        _wait_for_end(run, robot, KILL_S)


def _ask(run: Steered, request: Mapping[str, Any]) -> None:
    """Have a request carried out; one whose answer could not be written was, too. Raises RequestError."""
    try:
        run.ask(request)
    except UnwrittenError as error:
        if not error.done:
            raise
        print(f"rmr {NAMES.get(request['do'], request['do'])}: {error}", file=sys.stderr)


def _stop(run: Steered, robot: Who, timeout_s: float) -> None:
    _ask(run, {"do": "stop", "robot": robot})
    if not _wait_for_end(run, robot, timeout_s):
        _ask(run, {"do": "kill", "robot": robot})
        print(f"{called(robot)} did not stop in {timeout_s:g} s and was killed", file=sys.stderr)
        _wait_for_end(run, robot, KILL_S)


def _wait_for_end(run: Steered, robot: Who, patience_s: float) -> bool:
    """Wait until the process of `robot` has ended, or the run has; return whether it did in time."""
    end = time.monotonic() + patience_s
    while run.launched and _process(run, robot)["state"] != "ended":
        if time.monotonic() > end:
            return False
        time.sleep(POLL_S)
    return True


def _process(run: Steered, robot: Who) -> dict[str, Any]:
    """Return the name and state of the present process of `robot`, or of the world.

    While the run ends the launcher does not answer: the system is asked then.
    """
    told = told_status(run)
    base = robot if isinstance(robot, str) else f"robot-{robot}"
    if told is None:
        assert isinstance(run, LaunchedRun), "a lab on other machines answers, or ends the verb"
        processes = recorded_run(run.folder).processes or run.processes
        found = [one for one in processes if base_name(one.name) == base]
        return {"name": found[-1].name if found else "", "state": "running" if found and found[-1].lives else "ended"}
    if isinstance(robot, str):
        return next(dict(one) for one in reversed(told["processes"]) if base_name(one["name"]) == base)
    name = next(one["process"] for one in told["robots"] if one["robot"] == robot)
    return next(dict(one) for one in told["processes"] if one["name"] == name)
