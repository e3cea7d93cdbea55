"""The program of `rmr sim LAB --view`: a simulated run that is shown while it goes on.

`rmr sim` becomes this program, since the simulator does not import the page. The run is in the main thread, the page's
server in another one. After the end of the run the page stays until Ctrl-C.
"""
# ruff: noqa: PLC0415 - see rmr.entry

import sys
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command
    from rmr_sim.arguments import ABOUT, declare

    return Command(ABOUT, declare, _simulate)


def _simulate(**options: Any) -> int:
    from argparse import Namespace

    from rmr_sim.arguments import check

    arguments = Namespace(**options)
    check(arguments)
    from rmr_view.sim_viewer import perform

    return perform(arguments)


def main() -> None:
    """Run the command; ends the process."""
    sys.exit(run("rmr sim", lambda: command().main(name="rmr sim")))


if __name__ == "__main__":
    main()
