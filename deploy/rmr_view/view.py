"""The program `rmr-view`: the options of `rmr view [RUN]`; `view_command` carries it out."""
# ruff: noqa: PLC0415 - see rmr.entry

import sys
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

ABOUT = """\
Show a run in the browser: map, timeline, facts and rules of each robot, radio, logs.

RUN is a run folder or a recording. Without it the newest run under way in ./runs is shown while it goes on. The page
is served on this machine alone, until Ctrl-C; open the address that is printed.
"""


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(ABOUT, _declare, _view)


def _declare(parser: "Parser") -> None:
    from rmr.entry.command_line import real, whole

    parser.positional("path", "RUN", count="?", usage="[RUN]", help="a run folder, or a recording (.mcap)")
    parser.option("--port", read=whole(0, 65535), metavar="PORT", help="of the page (default: a free one)")
    parser.flag("--control", help="the page may add faults to a run that goes on; orders need the token in its address")
    parser.option(
        "--leave", read=real(0), metavar="SECONDS", help="end so long after the run is over and the last page is closed"
    )
    parser.flag("--foxglove", help="serve Foxglove and Lichtblick instead of the page (default port: 8765)")
    parser.option("--speed", read=real(0.01, 1000), metavar="X", help="lab time over time of a recording in Foxglove")
    parser.option("--listener", read=whole(0), metavar="FD", help="a listening socket, instead of a port")


def _view(foxglove: bool, speed: float | None, **options: Any) -> int:
    """Serve the page, or Foxglove; return the exit code."""
    if foxglove:
        from rmr_view.foxglove_command import perform_foxglove

        return perform_foxglove(speed=speed, **options)
    if speed is not None:
        from rmr.entry.command_line import CommandLineError

        raise CommandLineError("--speed is for --foxglove: the page has a button")
    from rmr_view.view_command import perform

    return perform(**options)


def main() -> None:
    """Run the command; ends the process."""
    sys.exit(run("rmr view", lambda: command().main(name="rmr view")))


if __name__ == "__main__":
    main()
