"""The program `rmr-sim`: its options alone, so that help and wrong usage cost little; `sim_command` does the work."""
# ruff: noqa: PLC0415 - see rmr.entry; lab, nodes and world load only where something runs

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rmr.entry import Loading, run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    return run("rmr sim", lambda: command().main(words, "rmr sim"))


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
        become_view()
    with Loading("rmr_sim.sim_command"):
        from rmr_sim.sim_command import perform

    return perform(arguments)


def become_view() -> None:
    """Replace this process by `rmr_view.sim_view`, which is given the same words: that part imports this one."""
    from rmr.entry import turn_into

    words = sys.argv[1:]
    turn_into(sys.executable, ["-P", "-m", "rmr_view.sim_view", *words])


if __name__ == "__main__":
    sys.exit(main())
