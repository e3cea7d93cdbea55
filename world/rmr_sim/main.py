"""The command `rmr sim`: its options alone, so that help and wrong usage cost little; `sim_command` does the work."""
# ruff: noqa: PLC0415 - see rmr.entry; lab, nodes and world load only where something runs

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rmr.entry import Loading, run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command


def main(words: Sequence[str] | None = None, name: str = "rmr sim") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command
    from rmr_sim.arguments import ABOUT, declare

    return Command(ABOUT, declare, _simulate)


def _simulate(**options: Any) -> int:
    """Simulate a lab; return the exit code."""
    from argparse import Namespace

    from rmr_sim.arguments import check

    arguments = Namespace(**options)
    check(arguments)
    if arguments.view:
        # By its name, for the page imports the simulator.
        show: Callable[[Namespace], int] = import_module("rmr_view.sim_viewer").perform
        return show(arguments)
    with Loading("rmr_sim.sim_command"):
        from rmr_sim.sim_command import perform

    return perform(arguments)


if __name__ == "__main__":
    sys.exit(main())
