"""The program `rmr-agent`: its options alone, so that help costs little; `agent_process` does the work."""
# ruff: noqa: PLC0415 - see rmr.entry; the bus and the node load only where a robot runs

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from rmr.entry import Loading, run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser


def main(words: Sequence[str] | None = None, name: str = "rmr-agent") -> NoReturn:
    """Run the command `name`; ends the process."""
    code = run(name, lambda: command().main(words, name))
    os._exit(code)  # zenoh's threads and a user's action must not keep the process


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(
        "Run one robot, or several: load byte-code, find the world, live.",
        _declare,
        _live,
        "Compile a program with rmrc; start its world with rmr-world; or let `rmr up LAB` do all of it.",
    )


SNAPSHOTS_KIB_MAX = 1 << 20
"""Longest segment of a journal, KiB: it is read into memory at a restart."""


def _kib(text: str) -> int:
    """Return a number of KiB: the reader of an option. Raises ValueError."""
    if not text.isascii() or not text.isdigit() or int(text) > SNAPSHOTS_KIB_MAX:
        raise ValueError(f"give a whole number of KiB, 0 to {SNAPSHOTS_KIB_MAX}")
    return int(text)


def _declare(parser: "Parser") -> None:
    from rmr.base.ids import listed
    from rmr.bus.endpoint import DEFAULT_ENDPOINT, read_endpoint
    from rmr.bus.keys import Keys

    parser.positional(
        "program", "PROG.rbc", count="?", usage="[PROG.rbc]", help="the byte-code to run; without: wait for rmr load"
    )
    parser.option(
        "--id", required=True, read=listed, metavar="N", help="which robot of the lab this is; 1-20: several robots"
    )
    where = f"where the world listens (default: {DEFAULT_ENDPOINT}; with keys tls)"
    parser.option("--connect", read=read_endpoint, metavar="ENDPOINT", help=where)
    parser.option("--actions", read=Path, metavar="FILE.py", help="handlers of the program's own actions")
    parser.option("--radio-key", read=Path, metavar="FILE", help="the radio's key, where the lab's is secured")
    parser.option(
        "--secret",
        read=Path,
        metavar="FILE",
        help="the secret of the world's bus (of rmr up: secret in the run folder)",
    )
    parser.option("--keys", read=Path, metavar="DIR", help="the robots' keys, for tls/HOST:PORT (default: RMR_KEYS)")
    parser.option(
        "--trust",
        read=Path,
        metavar="CA.pem",
        help="run programs alone that an operator of this CA has signed (rmr sign; default: the CA of --keys)",
    )
    parser.option(
        "--lab", read=lambda text: Keys(text).lab, metavar="NAME", help="the lab, where several run at one endpoint"
    )
    parser.option(
        "--state",
        read=Path,
        metavar="DIR",
        help="keep the robot's state here: killed and started again, it goes on (of several robots, DIR/N for robot N)",
    )
    parser.choice(
        "--durability",
        ("process", "power"),
        default="process",
        help="what the state survives: the end of the process, or a loss of power, too",
    )
    parser.option(
        "--snapshots",
        read=_kib,
        default=1024,
        metavar="KIB",
        help="take a snapshot of the state each time that its journal has grown by this (default: 1024; 0: none)",
    )
    parser.option(
        "--state-key",
        read=Path,
        metavar="FILE",
        help="the key of its snapshots, which is made if it does not exist (default: ~/.local/state/rmr/state.key)",
    )
    parser.option("--record", read=Path, metavar="FILE.mcap", help="record the robots; a file that is there stays")
    parser.option("--log", read=Path, metavar="FILE", help="write a log as JSON lines, with the robot's trace")


def _live(**options: Any) -> int:
    """Run the robots until their end; return the exit code."""
    from argparse import Namespace

    from rmr.bus.certificates import credentials_path, default_endpoint
    from rmr.entry.command_line import CommandLineError

    if options["durability"] == "power" and options["state"] is None:
        raise CommandLineError("--durability says what a state survives: name its folder with --state DIR")
    options["secret"] = credentials_path(options["secret"], options.pop("keys"), [options["connect"]])
    if options["trust"] is None and options["secret"] is not None and options["secret"].is_dir():
        options["trust"] = options["secret"]
    options["connect"] = options["connect"] or default_endpoint(options["secret"])
    for name in ("state", "record", "log", "secret", "trust"):  # a handler may change the present folder
        options[name] = options[name] and options[name].absolute()
    try:
        with Loading("rmr_agent.agent_process"):
            from rmr_agent.agent_process import perform

        return perform(Namespace(**options))
    except KeyboardInterrupt:  # before the signal handlers are installed: a request to stop is no failure
        from rmr.base.ids import spelled

        print(f"rmr-agent {spelled(options['id'])}: ended (SIGINT)", file=sys.stderr)
        return 0


if __name__ == "__main__":
    main()
