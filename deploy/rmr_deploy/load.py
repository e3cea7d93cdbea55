"""The options of `rmr load`; `rmr_deploy.load_run` carries it out.

Importing this module loads next to nothing (see `rmr.entry`), and its help not the bus.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

ABOUT = """\
Give running robots a new program.

Each robot verifies it; then all switch to it at one instant of lab time, or none does, with the reason for each robot.
The lab is the only one that runs on this machine; if several run, choose with --run or --lab. If none does, it is the
one whose world listens at the default endpoint.
"""


def _declare(parser: "Parser") -> None:
    from rmr.base.ids import listed
    from rmr.bus.endpoint import DEFAULT_ENDPOINT

    parser.positional("program", "PROG.rbc", read=Path, help="Byte-code, or a source (.rmr), which is compiled.")
    parser.positional("robot", "ID", read=listed, count="?", usage="[ID]", help="One robot, or 1-9; else all.")
    parser.option("--robots", metavar="1-9", read=listed, help="The robots that get it; else all of the lab.")
    parser.choice("--via", ("bus", "radio"), help="How it gets to the robots: bus, or radio from robot to robot.")
    parser.flag("--dry-run", help="Only say whether the robots could run it, and which facts they would drop.")
    parser.option("--connect", metavar="ENDPOINT", help=f"Where the world listens, such as {DEFAULT_ENDPOINT}.")
    parser.option("--run", dest="folder", metavar="DIR", read=Path, help="The run folder, if several labs run.")
    parser.option("--secret", metavar="FILE", read=Path, help="Of the bus, where no run folder holds it.")
    parser.option("--keys", metavar="DIR", read=Path, help="The folder with an operator's keys, for tls/HOST:PORT.")
    parser.option("--lab", metavar="NAME", help="The name of the lab, if several run.")
    parser.flag("--json", dest="as_json", help="The outcome as JSON.")


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(ABOUT, _declare, _load)


def _load(robot: list[int] | None, robots: list[int] | None, **options: Any) -> int:
    from rmr.bus.certificates import credentials_path
    from rmr.entry.command_line import CommandLineError
    from rmr_deploy.load_run import perform

    if options["connect"] is not None and options["folder"] is not None:
        raise CommandLineError("say --connect or --run, not both")
    options["secret"] = credentials_path(options["secret"], options.pop("keys"), [options["connect"]])
    if robot is not None and robots is not None:
        raise CommandLineError("say ID or --robots, not both")
    return perform(robots=robot or robots, **options)


def main(words: Sequence[str] | None = None, name: str = "rmr load") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
