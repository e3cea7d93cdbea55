"""The program `rmr-world`: its options alone, so that help costs little; `world_process` does the work."""
# ruff: noqa: PLC0415 - see rmr.entry; physics and lab schema load only where a world runs

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from rmr.entry import Loading, run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser


def main(words: Sequence[str] | None = None, name: str = "rmr-world") -> NoReturn:
    """Run the command `name`; ends the process."""
    code = run(name, lambda: command().main(words, name))
    os._exit(code)  # zenoh's threads must not keep the process


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(
        "Run a lab's world: physics, sensors, lab time, and the router that robots connect to.",
        _declare,
        _serve,
        "Robots come and go with rmr-agent, in any order; `rmr up LAB` starts everything.",
    )


def _declare(parser: "Parser") -> None:
    from rmr.base.streams import SEED_MAX
    from rmr.bus.endpoint import DEFAULT_ENDPOINT, read_endpoint
    from rmr.entry.command_line import whole

    parser.option("--config", required=True, read=Path, metavar="LAB.yaml", help="the lab file, or its folder")
    parser.option(
        "--listen", read=read_endpoint, metavar="ENDPOINT", help=f"where robots connect (default: {DEFAULT_ENDPOINT})"
    )
    parser.option("--connect", read=read_endpoint, metavar="ENDPOINT", help="be a client of the router there")
    parser.option(
        "--program", read=Path, metavar="PROG", help="check the lab's facts against this program (.rmr or .rbc)"
    )
    parser.option("--robots", read=whole(1), metavar="N", help="only the first N robots of the lab")
    parser.option("--seed", read=whole(0, SEED_MAX), metavar="S", help="another seed than the lab file's")
    parser.option(
        "--secret",
        read=Path,
        metavar="FILE",
        help="admit only processes that know the secret in FILE, which is made if it does not exist (default: all)",
    )
    parser.option(
        "--keys",
        read=Path,
        metavar="DIR",
        help="the folder with the keys of the world, for an endpoint tls/HOST:PORT (default: that in RMR_KEYS)",
    )
    parser.flag("--open", help="admit everybody who reaches --listen, on other machines, too, without a secret")
    parser.flag("--when-ready", help="lab time starts when all robots are ready")
    parser.flag("--ros2", help="show the simulated robots as robots of ROS 2, which drives those that have no mind")
    parser.option(
        "--state",
        read=Path,
        metavar="DIR",
        help="keep the world's state here: killed and started again, it goes on, and its robots with it",
    )
    parser.option("--record", read=Path, metavar="FILE.mcap", help="record the world; a file that is there stays")
    parser.option("--log", read=Path, metavar="FILE", help="write a log as JSON lines")


def _serve(**options: Any) -> int:
    """Serve the world until its end; return the exit code."""
    from argparse import Namespace

    from rmr.bus.certificates import credentials_path, default_endpoint
    from rmr.bus.listening import check_open
    from rmr.entry.command_line import CommandLineError

    if options["listen"] is not None and options["connect"] is not None:
        raise CommandLineError("--connect is not allowed with --listen: name one of them")
    ends = options["listen"], options["connect"]
    options["secret"] = credentials_path(options["secret"], options.pop("keys"), ends)
    if ends == (None, None):
        options["listen"] = default_endpoint(options["secret"])
    check_open(options["listen"], secret=options["secret"] is not None, opened=options["open"])
    try:
        with Loading("rmr_world.world_process"):
            from rmr_world.world_process import perform

        return perform(Namespace(**options))
    except KeyboardInterrupt:  # before the signal handlers stood: a world that is told to stop has not failed
        print("rmr-world: ended (SIGINT)", file=sys.stderr)
        return 0


if __name__ == "__main__":
    main()
