"""Which run a verb such as `rmr ps` means: the one that is named, or the only one that runs on this machine."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from rmr.base.ids import spelled
from rmr.entry import ExitCode
from rmr_deploy.active_runs import (
    RUNS,
    LaunchedRun,
    RecordedProcess,
    active_runs,
    is_ours,
    past_runs,
    recorded_run,
    register_places,
)
from rmr_deploy.run_requests import Who


class Steered(Protocol):
    """What a verb shows or steers: a run of this machine (`LaunchedRun`), or a lab of others (`Remote`)."""

    @property
    def lab(self) -> str:
        """Its name."""

    @property
    def roster(self) -> tuple[int, ...]:
        """The ids of its robots; empty where they are not known."""

    @property
    def launched(self) -> bool:
        """Whether it goes on, with a launcher."""

    @property
    def launcher(self) -> RecordedProcess | None:
        """The launcher, on this machine."""

    @property
    def processes(self) -> Sequence[RecordedProcess]:
        """The processes that it has started, on this machine."""

    def ask(self, request: Mapping[str, Any], patience_s: float | None = None) -> dict[str, Any]:
        """Return the launcher's answer. Raises RequestError, FleetError."""


class Remote(Steered, Protocol):
    """A lab over several hosts, which are asked on the bus (`rmr_deploy.remote_lab`)."""

    def logs(self, robots: Sequence[Who], *, events_only: bool) -> list[Any]:
        """Return the logs of each host (`rmr_deploy.run_logs.RunLogs`)."""

    @property
    def hub(self) -> str:
        """The host with the world."""

    def usage(self) -> dict[str, tuple[float | None, float | None, float]]:
        """Return what each process uses, as `rmr_deploy.process_identity.usage_of` tells. Raises FleetError."""

    def config(self) -> dict[str, Any]:
        """Return the lab with all defaults. Raises FleetError."""

    def wait_for_end(self, timeout_s: float | None) -> tuple[bool, str]:
        """Wait until the run is over; return whether it has finished, and a sentence. Raises FleetError."""

    def bring_down(self, timeout_s: float) -> str:
        """End the lab on all hosts; return a sentence. Raises FleetError."""


class FleetError(Exception):
    """A verb cannot be carried out: why, for people, and the exit code."""

    def __init__(self, message: str, exit_code: int = ExitCode.USAGE) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def chosen_run(folder: Path | None, lab: str | None, *, past: bool = False) -> LaunchedRun:
    """Return the run in `folder`, or that of `lab`, or else the only one that runs. Raises FleetError.

    With `past` it may be over: without a run under way the newest in ./runs is meant.
    """
    run = found_run(folder, lab, past=past)
    if run is None:
        raise FleetError(_nothing(lab, past=past))
    return run


def found_run(folder: Path | None, lab: str | None, *, past: bool = False) -> LaunchedRun | None:
    """Return what `chosen_run` does; None if no folder is named and nothing fits. Raises FleetError."""
    if folder is not None:
        return _named(folder, past=past)
    runs = [run for run in active_runs() if lab in (None, run.lab)]
    if len(runs) > 1:
        raise FleetError(f"several labs run: {_listing(runs)}; choose with --run DIR{_by_lab(runs)}")
    if runs:
        return runs[0]
    over = [run for run in past_runs() if lab in (None, run.lab)] if past else []
    return over[-1] if over else None


def newest_folder(lab: str | None) -> Path | None:
    """Return the folder of the newest run, of `lab` or of any: of one that goes on, else one in ./runs; None: of none.

    Those in ./runs are runs of processes and simulated runs that have left a recording.
    """
    runs = [run for run in active_runs() if lab in (None, run.lab)]
    if runs:
        return runs[-1].folder
    # A run can be shown by its recording, or by the files that are not joined yet (`rmr.record.recording`).
    recorded = {
        path.parent: path.stat().st_mtime_ns for name in ("run.mcap", "record") for path in RUNS.glob(f"*/{name}")
    }
    newest = sorted(recorded, key=lambda folder: (recorded[folder], folder), reverse=True)
    return next((folder for folder in newest if lab in (None, _recorded_lab(folder))), None)


def _recorded_lab(folder: Path) -> str | None:
    from rmr.record.mcap_scan import RecordingError  # noqa: PLC0415 - the other verbs need no recording
    from rmr.record.recording import open_recording  # noqa: PLC0415

    try:
        with open_recording(folder) as recording:
            return recording.about.lab
    except RecordingError:
        return None


def _named(folder: Path, *, past: bool) -> LaunchedRun:
    """Return the run in `folder`, by its own record; by the register if the folder was removed or has none."""
    run = recorded_run(folder)
    if run.active and is_ours(folder):
        return run
    registered = next((one for one in active_runs() if one.folder == run.folder), None)
    if registered is not None:
        return registered
    if not folder.exists():
        raise FleetError(f"there is no {folder}; rmr ls shows what runs")
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
    return f"{what} runs on this machine{ended}; {how_to_start()}"


def how_to_start() -> str:
    """Return what to do where no lab is found: it may be one that the register does not have."""
    return f"start one with rmr up LAB -d, or name its run folder with --run (looked in {where_it_looks()})"


def where_it_looks() -> str:
    """Return the places where labs that run are found without being named."""
    return f"./{RUNS} and {', '.join(map(str, register_places()))}"


def shown(folder: Path) -> str:
    """Return `folder` as a person at this place would write it."""
    here = Path.cwd()
    return str(folder.relative_to(here)) if folder.is_relative_to(here) and folder != here else str(folder)


def check_robots(run: Steered, robots: Iterable[Who]) -> None:
    """Raise FleetError if the lab of `run` lacks one of `robots`. Of world and router the launcher knows."""
    unknown = [robot for robot in robots if run.roster and type(robot) is int and robot not in run.roster]
    if unknown:
        raise FleetError(f"lab {run.lab} has no robot {unknown[0]}: it has {spelled(run.roster)}")


def performed(verb: str, perform: Callable[[], int]) -> int:
    """Carry out `perform`; return its exit code, or that of a FleetError, which is told."""
    try:
        return perform()
    except FleetError as error:
        print(f"rmr {verb}: {error}", file=sys.stderr)
        return error.exit_code
