"""`rmr view --foxglove [RUN]`: finds the run, and serves it to Foxglove until Ctrl-C."""

import signal
import sys
from pathlib import Path

from rmr.entry.command_line import CommandLineError
from rmr_view.foxglove_server import serve_foxglove
from rmr_view.view_command import NoRunError, find_run


def perform_foxglove(
    path: Path | None,
    port: int | None,
    speed: float | None,
    control: bool,
    leave: float | None,
    listener: int | None,
) -> int:
    """Serve a run to Foxglove; return the exit code."""
    if control or leave is not None or listener is not None:
        raise CommandLineError("--control, --leave and --listener are for the page: Foxglove only watches")
    try:
        run, live = find_run(path)
    except NoRunError as error:
        print(f"rmr view: {error}", file=sys.stderr)
        return error.exit_code
    if live and speed is not None:
        raise CommandLineError("--speed is for a recording: this run goes on")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    return serve_foxglove(run, live=live, port=port, speed=speed or 1.0)
