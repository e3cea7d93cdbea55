"""`rmr down` and `rmr wait`: the end of a run.

`down` asks the launcher with SIGTERM, as Ctrl-C would, and it stops the run in order and writes the report. Where the
launcher is dead or does not end in time, the processes of the record are signalled one by one, each after its start
was compared: whoever has got the id of one that has ended is left alone.
"""

import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rmr.entry import ExitCode
from rmr_deploy.active_runs import LaunchedRun, RecordedProcess, active_runs, recorded_run
from rmr_deploy.process_identity import signal_process
from rmr_deploy.run_choice import FleetError, Remote, chosen_run, shown
from rmr_deploy.run_logs import last_event

POLL_S = 0.02
DOWN_S = 30.0
"""Limit for a launcher to stop its run in order: it takes five seconds, and longer where it joins a recording."""
TERM_S = 2.0
"""Limit for a process without a launcher to exit after SIGTERM, and to end after SIGKILL."""


def bring_down(
    folder: Path | None,
    lab: str | None,
    *,
    everything: bool,
    timeout_s: float | None,
    there: Remote | None = None,
) -> int:
    """End a run, the lab that runs `there`, or with `everything` all that run on this machine; return the exit code.

    Raises FleetError.
    """
    if everything and (folder is not None or lab is not None or there is not None):
        raise FleetError("--all goes without --run, --lab and --connect")
    if there is not None:
        print(there.bring_down(DOWN_S if timeout_s is None else timeout_s))
        return ExitCode.OK
    runs = active_runs() if everything else [chosen_run(folder, lab)]
    if not runs:
        print("no lab runs on this machine")
    launchers = [run.launcher for run in runs if run.launcher is not None]
    for launcher in launchers:  # all at once
        _signal([launcher], signal.SIGTERM)
    return max((_ended(run, DOWN_S if timeout_s is None else timeout_s) for run in runs), default=ExitCode.OK)


def _ended(run: LaunchedRun, patience_s: float) -> int:
    """Wait for the launcher's end, then end what is left; return the exit code."""
    in_order = run.launched
    left_s = time.monotonic() + patience_s
    if run.launcher is not None and not wait_until(lambda: not run.launched, left_s - time.monotonic()):
        print(f"rmr down: the launcher (pid {run.launcher.pid}) did not end in {patience_s:g} s", file=sys.stderr)
        in_order = False
        _signal([run.launcher], signal.SIGKILL)
        wait_until(lambda: not run.launched, TERM_S)
    stranded = run.living if wait_until(lambda: not run.living, TERM_S if in_order else 0.2) is False else []
    for number in (signal.SIGTERM, signal.SIGCONT, signal.SIGKILL):  # a paused one takes SIGTERM when it continues
        _signal(run.living, number, group=number == signal.SIGKILL)
        if number != signal.SIGTERM:
            wait_until(lambda: not run.living, TERM_S)
    if run.living:
        raise FleetError(f"{_names(run.living)} of lab {run.lab} cannot be ended", ExitCode.FAILED)
    how = f"; {_names(stranded)} had no launcher any more and got SIGTERM" if stranded else ""
    print(f"lab {run.lab} is down{how}; {_leftovers(run)}")
    return ExitCode.OK


def _leftovers(run: LaunchedRun) -> str:
    if not run.folder.is_dir():
        return f"its run folder {shown(run.folder)} had been removed"
    report = run.folder / "report.json"
    return f"the report is {shown(report)}" if report.exists() else f"the run folder is {shown(run.folder)}"


def _names(processes: Sequence[RecordedProcess]) -> str:
    return ", ".join(f"{one.name} (pid {one.pid})" for one in processes)


def _signal(processes: Sequence[RecordedProcess], number: int, *, group: bool = False) -> None:
    for one in processes:
        signal_process(one.pid, one.mark, number, group=group)


def wait_until(claim: Callable[[], bool], patience_s: float | None = None) -> bool:
    """Wait until `claim` holds, `patience_s` at most; return whether it does."""
    end = None if patience_s is None else time.monotonic() + patience_s
    while not claim():
        if end is not None and time.monotonic() >= end:
            return False
        time.sleep(POLL_S)
    return True


def wait_for_end(folder: Path | None, lab: str | None, *, timeout_s: float | None, there: Remote | None = None) -> int:
    """Wait until a run is over; return the exit code of its `rmr up`. Raises FleetError.

    Of the lab that runs `there` only whether it has finished is known.
    """
    if there is not None:
        finished, said = there.wait_for_end(timeout_s)
        print(said)
        return ExitCode.OK if finished else ExitCode.FAILED
    run = chosen_run(folder, lab, past=True)
    if not wait_until(lambda: not run.launched, timeout_s):
        raise FleetError(f"lab {run.lab} still runs after {timeout_s:g} s", ExitCode.FAILED)
    code = recorded_run(run.folder).exit_code
    over = last_event(run, "over")
    if code is None:
        why = "its launcher was killed" if run.folder.is_dir() else "its run folder was removed"
        raise FleetError(f"how the run of lab {run.lab} ended is not known: {why}", ExitCode.FAILED)
    print(f"lab {run.lab}: {'over' if over is None else over.get('reason', 'over')}; exit code {code}")
    return code
