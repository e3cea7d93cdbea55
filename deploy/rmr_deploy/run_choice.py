"""Which run a verb such as `rmr ps` means: the one that is named, or the only one that runs on this machine."""

import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from rmr.base.ids import spelled
from rmr.entry import ExitCode
from rmr_deploy.active_runs import RUNS, LaunchedRun, active_runs, is_ours, past_runs, recorded_run


class FleetError(Exception):
    """A verb cannot be carried out: why, for people, and the exit code."""

    def __init__(self, message: str, exit_code: int = ExitCode.USAGE) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def chosen_run(folder: Path | None, lab: str | None, *, past: bool = False) -> LaunchedRun:
    """Return the run in `folder`, or that of `lab`, or else the only one that runs. Raises FleetError.

    With `past` it may be over: without a run under way the newest in ./runs is meant.
    """
    if folder is not None:
        return _named(folder, past=past)
    runs = [run for run in active_runs() if lab in (None, run.lab)]
    if len(runs) > 1:
        raise FleetError(f"several labs run: {_listing(runs)}; choose with --run DIR{_by_lab(runs)}")
    if runs:
        return runs[0]
    over = [run for run in past_runs() if lab in (None, run.lab)] if past else []
    if over:
        return over[-1]
    raise FleetError(_nothing(lab, past=past))


def _named(folder: Path, *, past: bool) -> LaunchedRun:
    run = next((one for one in active_runs() if one.folder == folder.resolve()), None)
    if run is not None:
        return run
    if not folder.exists():
        raise FleetError(f"there is no {folder}; rmr ls shows what runs")
    run = recorded_run(folder)
    if not run.record:
        raise FleetError(f"{folder} is no folder of a run of processes: rmr up makes one")
    if not past and not is_ours(folder):
        raise FleetError(
            f"the run in {folder} is another user's, or others can write its record: its own user orders it"
        )
    if not past:
        raise FleetError(f"the run in {folder} is over; rmr ls shows what runs", ExitCode.FAILED)
    return run


def _listing(runs: Iterable[LaunchedRun]) -> str:
    return ", ".join(f"{run.lab} ({shown(run.folder)})" for run in runs)


def _by_lab(runs: Iterable[LaunchedRun]) -> str:
    labs = [run.lab for run in runs]
    return " or --lab NAME" if len(set(labs)) == len(labs) else ""


def _nothing(lab: str | None, *, past: bool) -> str:
    runs = active_runs()
    if lab is not None and runs:
        return f"no lab {lab} runs on this machine; what runs: {_listing(runs)}"
    what = "no lab" if lab is None else f"no lab {lab}"
    ended = f", and no run of it has left a folder in ./{RUNS}" if past else ""
    return f"{what} runs on this machine{ended}; start one with rmr up LAB -d"


def shown(folder: Path) -> str:
    """Return `folder` as a person at this place would write it."""
    here = Path.cwd()
    return str(folder.relative_to(here)) if folder.is_relative_to(here) and folder != here else str(folder)


def check_robots(run: LaunchedRun, robots: Iterable[int]) -> None:
    """Raise FleetError if the lab of `run` lacks one of `robots`."""
    unknown = [robot for robot in robots if run.roster and robot not in run.roster]
    if unknown:
        raise FleetError(f"lab {run.lab} has no robot {unknown[0]}: it has {spelled(run.roster)}")


def performed(verb: str, perform: Callable[[], int]) -> int:
    """Carry out `perform`; return its exit code, or that of a FleetError, which is told."""
    try:
        return perform()
    except FleetError as error:
        print(f"rmr {verb}: {error}", file=sys.stderr)
        return error.exit_code
