"""The options of `rmr view [RUN]`; `view_command` carries it out."""
# ruff: noqa: PLC0415 - see rmr.entry

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

ABOUT = """\
Show a run in the browser: map, timeline, facts and rules of each robot, radio, logs.

RUN is a run folder or a recording. Without it the newest run is shown: one that goes on on this machine, else one in
./runs. The page is served on this machine alone, until Ctrl-C; open the address that is printed.
"""


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(ABOUT, _declare, _view)


def _declare(parser: "Parser") -> None:
    from rmr.entry.command_line import real, whole

    parser.positional("path", "RUN", count="?", usage="[RUN]", help="a run folder, or a recording (.mcap)")
    parser.option("--run", dest="folder", metavar="DIR", read=Path, help="the same as RUN, as for other commands")
    parser.option("--lab", metavar="NAME", help="the newest run of this lab")
    parser.option("--port", read=whole(0, 65535), metavar="PORT", help="of the page (default: a free one)")
    parser.flag("--control", help="the page may add faults to a run that goes on; orders need the token in its address")
    parser.option(
        "--leave", read=real(0), metavar="SECONDS", help="end so long after the run is over and the last page is closed"
    )
    parser.flag("--foxglove", help="serve Foxglove or Lichtblick (a WebSocket) instead of the page")
    parser.option("--speed", read=real(0.1, 100), metavar="X", help="of a recording in Foxglove (default: 1)")
    parser.option("--listener", read=whole(0), metavar="FD", help="a listening socket, instead of a port")


def _view(**options: Any) -> int:
    """Serve the page; return the exit code."""
    from rmr.entry.command_line import CommandLineError

    if sum(options[name] is not None for name in ("path", "folder", "lab")) > 1:
        raise CommandLineError("say one of RUN, --run and --lab")
    if not options["foxglove"] and options["speed"] is not None:
        raise CommandLineError("--speed is of a recording in Foxglove: ask for it with --foxglove")
    if options["foxglove"] and (options["control"] or options["leave"] is not None or options["listener"] is not None):
        raise CommandLineError("--foxglove goes without --control, --leave and --listener: these are about the page")
    from rmr_view.view_command import perform

    return perform(**options)


def main(words: Sequence[str] | None = None, name: str = "rmr view") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
