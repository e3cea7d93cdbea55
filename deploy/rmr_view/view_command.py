"""`rmr view [RUN]`: finds the run, and serves its page until Ctrl-C."""

import os
import signal
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path

from rmr.entry import ExitCode
from rmr_deploy.active_runs import PROCESSES_FILE, RUNS, under_way
from rmr_deploy.page_start import TOKEN_VARIABLE
from rmr_deploy.run_choice import FleetError, newest_folder
from rmr_view.access_guard import new_token
from rmr_view.live_source import LiveSource, lab_in
from rmr_view.page_server import PageServer, PageServerError, bind
from rmr_view.recorded_source import RecordedSource, RecordingError
from rmr_view.run_source import RunSource
from rmr_world.finding import LabError

WAIT_S = 0.5
"""Period with which the end of the page is looked for."""


def perform(
    path: Path | None,
    folder: Path | None,
    lab: str | None,
    port: int | None,
    control: bool,
    leave: float | None,
    foxglove: bool,
    speed: float | None,
    listener: int | None,
) -> int:
    """Serve the page of a run, or `foxglove`; return the exit code."""
    try:
        path = find_run(path or folder, lab)
        if foxglove:
            from rmr_view.foxglove_server import serve_foxglove  # noqa: PLC0415 - websockets is in an extra

            return serve_foxglove(path, live=is_live(path), port=port, speed=speed or 1.0)
        source = find_source(path, control)
        sock = bind(port or 0) if listener is None else socket.socket(fileno=listener)
    except FleetError as error:
        print(f"rmr view: {error}", file=sys.stderr)
        return error.exit_code
    except (PageServerError, OSError) as error:
        print(f"rmr view: {error}", file=sys.stderr)
        return ExitCode.FAILED
    token = os.environ.get(TOKEN_VARIABLE) or new_token() if control else None
    server = PageServer(source, sock, token)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    server.start()
    with suppress(KeyboardInterrupt):
        # Ctrl-C ends the page in order as soon as its address can be read.
        if listener is None:
            print(f"the page: {server.address}", flush=True)
        _wait(server, source, leave)
    server.stop()
    return ExitCode.OK


def _wait(server: PageServer, source: RunSource, leave_s: float | None) -> None:
    """Wait for Ctrl-C, or until nobody has looked for `leave_s` seconds at a run that is over."""
    while True:
        time.sleep(WAIT_S)
        if not server.serves:
            return
        idle_s = server.idle_s
        if leave_s is not None and not source.live and idle_s is not None and idle_s >= leave_s:
            return


def find_run(path: Path | None, lab: str | None = None) -> Path:
    """Return the run that is named, or the newest: one under way, else one in ./runs. Raises FleetError."""
    if path is None:
        path = newest_folder(lab)
        if path is None:
            of = "" if lab is None else f" of lab {lab}"
            message = (
                f"there is no run{of} in ./{RUNS}, and none is under way; start one with rmr up LAB or rmr sim LAB"
            )
            raise FleetError(f"{message}, or name a recording: rmr view RUN", ExitCode.FAILED)
    if not path.exists():
        raise FleetError(f"there is no {path}", ExitCode.USAGE)
    return path


def is_live(path: Path) -> bool:
    """Return whether the run in `path` goes on."""
    return (path / PROCESSES_FILE).is_file() and under_way(path)


def find_source(path: Path, control: bool) -> RunSource:
    """Return the source of a run. Raises FleetError."""
    if is_live(path):
        return _live(path, control)
    if control:
        raise FleetError(f"the run in {path} is over: --control is for a run that goes on", ExitCode.USAGE)
    try:
        return RecordedSource(path)
    except RecordingError as error:
        raise FleetError(str(error), ExitCode.INVALID) from None
    except OSError as error:
        raise FleetError(f"{path}: {error.strerror or error}", ExitCode.USAGE) from None


def _live(folder: Path, control: bool) -> RunSource:
    try:
        lab = lab_in(folder)
    except (LabError, OSError) as error:
        raise FleetError(f"the lab of {folder} cannot be read: {error}", ExitCode.INVALID) from None
    if lab is None:
        raise FleetError(f"{folder / PROCESSES_FILE} does not say which lab runs: was it started by rmr up?", 3)
    return LiveSource(folder, lab, control)
