"""The commands `rmr sim` and `rmr sweep`: their options alone, so that help and wrong usage cost little.

`sim_command` and `sweep_merge` do the work.
"""
# ruff: noqa: PLC0415 - see rmr.entry; lab, nodes and world load only where something runs

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import Loading, run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, CommandGroup, Parser


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


def sweep_main(words: Sequence[str] | None = None, name: str = "rmr sweep") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: sweep_command().main(words, name))


def sweep_command() -> "CommandGroup":
    """Return the command `rmr sweep`."""
    from rmr.entry.command_line import Command, CommandGroup, Subcommand

    about = "Join the shards of a sweep to the sweep that one machine would have left."
    merge = Command(about, _declare_merge, _merge)
    return CommandGroup("Sweeps that several machines share.", {"merge": Subcommand(about, lambda: merge)})


def _declare_merge(parser: "Parser") -> None:
    parser.positional(
        "folders", "DIR...", count="+", help="the run folder of each shard, of `rmr sim LAB --seeds A-B --shard K/N`"
    )
    parser.option(
        "-o", "--output", metavar="DIR", read=Path, required=True, help="the folder of the whole sweep: a new one"
    )
    parser.flag("--json", help="the whole sweep as JSON on standard output")
    parser.flag("--strict", help="exit 4 when a deadline was missed")


def _merge(**options: Any) -> int:
    """Merge shards; return the exit code."""
    from argparse import Namespace

    with Loading("rmr_sim.sweep_merge"):
        from rmr_sim.sweep_merge import merge

    return merge(Namespace(**options))


if __name__ == "__main__":
    sys.exit(main())
