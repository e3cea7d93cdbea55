"""The options of `rmr router`; `rmr_deploy.router_process` carries it out.

Importing this module loads next to nothing (see `rmr.entry`), and its help not the bus.
"""
# ruff: noqa: PLC0415

import os
import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

ABOUT = """\
Run a router between the hosts of a lab: the processes of a host connect to it, and it to the routers of other hosts.

With `config LAB` it prints a configuration with which zenohd does the same, and ends.
"""

EPILOG = """\
A router needs no world and no lab; it waits for routers that are not there yet. On one machine none is needed: there \
the world is the router.
"""


def _declare(parser: "Parser") -> None:
    from rmr.bus.endpoint import DEFAULT_ENDPOINT, read_endpoint
    from rmr.entry.command_line import one_of

    parser.positional("action", "config", read=one_of(("config",)), count="?", usage="[config", help="print for zenohd")
    parser.positional("lab", "LAB", count="?", usage="LAB]", help="config: the lab file, its folder or a provided lab")
    parser.option("--host", metavar="HOST", help="config: the host of zenohd, by the name or address that others use")
    parser.option(
        "--listen",
        read=read_endpoint,
        metavar="ENDPOINT",
        help=f"where processes and other routers connect (default: {DEFAULT_ENDPOINT}; config: HOST, the same port)",
    )
    parser.option(
        "--connect",
        read=read_endpoint,
        metavar="ENDPOINT",
        repeatable=True,
        help="the router of another host; repeatable",
    )
    parser.option(
        "--secret",
        read=Path,
        metavar="FILE",
        help="admit only processes and routers that know the secret in FILE, which is made if it does not exist and "
        "nothing is connected to (default: all)",
    )
    parser.option(
        "--keys",
        read=Path,
        metavar="DIR",
        help="the folder with the keys of this router, for an endpoint tls/HOST:PORT (default: that in RMR_KEYS)",
    )
    parser.flag("--open", help="admit everybody who reaches --listen, on other machines, too, without a secret")
    parser.option("--log", read=Path, metavar="FILE", help="write a log as JSON lines")


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(ABOUT, _declare, _perform, EPILOG)


def _perform(
    *, action: str | None, lab: Path | None, host: str | None, listen: str | None, log: Path | None, **common: Any
) -> int:
    """Run the router until its end, or print a configuration; return the exit code."""
    from rmr.bus.certificates import credentials_path, default_endpoint
    from rmr.bus.endpoint import DEFAULT_PORT, read_endpoint
    from rmr.bus.listening import check_open
    from rmr.entry.command_line import CommandLineError

    if action is None and host is not None:
        raise CommandLineError("--host goes with config LAB")
    if action is not None and (lab is None or host is None):
        raise CommandLineError("config needs a lab and its host: rmr router config LAB --host HOST")
    if action is not None and log is not None:
        raise CommandLineError("--log goes without config")
    common["secret"] = credentials_path(common["secret"], common.pop("keys"), [listen, *common["connect"]])
    if listen is None:
        listen = default_endpoint(common["secret"])
        protocol = listen.partition("/")[0]
        try:
            listen = listen if host is None else read_endpoint(f"{protocol}/{host}:{DEFAULT_PORT}")
        except ValueError:
            raise CommandLineError(f"--host: '{host}' is no name or address of a host") from None
    check_open(listen, secret=common["secret"] is not None, opened=common["open"])
    if lab is not None and host is not None:
        from rmr_deploy.router_config import show

        return show(lab, host, listen, common["connect"], common["secret"])
    try:
        from rmr_deploy.router_process import perform

        return perform(Namespace(listen=listen, log=log, **common))
    except KeyboardInterrupt:  # before the signal handlers stood: a router that is told to stop has not failed
        print("rmr router: ended (SIGINT)", file=sys.stderr)
        return 0


def main(words: Sequence[str] | None = None, name: str = "rmr router") -> NoReturn:
    """Run the command `name`; ends the process."""
    code = run(name, lambda: command().main(words, name))
    os._exit(code)  # zenoh's threads must not keep the process


if __name__ == "__main__":
    main()
