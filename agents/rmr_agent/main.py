"""The command `rmr-agent`: one robot in one process.

Everything that can be wrong is found in the order in which a person can mend it: the arguments (exit code 2), the
byte-code and its actions (3), then the world (waited for). It imports little, so that fifty robots start in seconds.
"""

import argparse
import asyncio
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rmr import __version__
from rmr.base.values import ROBOT_ID_MAX
from rmr.bus.keys import Keys
from rmr.bus.process import (
    EXIT_FAILED,
    EXIT_INVALID,
    EXIT_USAGE,
    Ending,
    handle_signals,
    hold_lifeline,
    start_logging,
)
from rmr.bus.session import DEFAULT_ENDPOINT, BusError, check_endpoint
from rmr.node.actions import Handler
from rmr_agent.bytecode import Loaded, RefusedError, check_actions, load_handlers, load_program
from rmr_agent.robot import RobotProcess


def _robot_id(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) <= ROBOT_ID_MAX):
        raise argparse.ArgumentTypeError(f"'{text}' is no robot id (0 to {ROBOT_ID_MAX})")
    return int(text)


def _endpoint(text: str) -> str:
    try:
        return check_endpoint(text)
    except BusError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _lab(text: str) -> str:
    try:
        return Keys(text).lab
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    it = argparse.ArgumentParser(
        prog="rmr-agent",
        description="Run one robot: load byte-code, find the world, live.",
        epilog="Compile a program with rmrc; start its world with rmr-world; or let `rmr up LAB` do all of it.",
    )
    it.add_argument("program", metavar="PROG.rbc", type=Path, help="the byte-code to run")
    it.add_argument("--id", required=True, type=_robot_id, metavar="N", help="which robot of the lab this is")
    it.add_argument(
        "--connect",
        default=DEFAULT_ENDPOINT,
        type=_endpoint,
        metavar="ENDPOINT",
        help="where the world listens (default: %(default)s)",
    )
    it.add_argument("--actions", type=Path, metavar="FILE.py", help="handlers of the program's own actions")
    it.add_argument("--lab", type=_lab, metavar="NAME", help="the lab, where several run at one endpoint")
    it.add_argument("--log", type=Path, metavar="FILE", help="write a log as JSON lines, with the robot's trace")
    it.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return it


def _load(options: argparse.Namespace) -> tuple[Loaded, dict[str, Handler]]:
    loaded = load_program(options.program)
    handlers = load_handlers(options.actions)
    check_actions(loaded.program, handlers)
    return loaded, handlers


async def _live(options: argparse.Namespace, loaded: Loaded, handlers: dict[str, Handler], ending: Ending) -> None:
    handle_signals(ending)
    hold_lifeline()
    await RobotProcess(options.id, options.connect, options.lab, loaded, handlers, ending).run()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; ends the process."""
    options = parser().parse_args(arguments)
    who = f"rmr-agent {options.id}"
    try:
        log = start_logging(who, options.log)
        loaded, handlers = _load(options)
    except RefusedError as error:
        print(f"{who}: {error}", file=sys.stderr)
        sys.exit(EXIT_INVALID)
    except OSError as error:
        print(f"{who}: cannot write {options.log}: {error.strerror}", file=sys.stderr)
        sys.exit(EXIT_USAGE)
    ending = Ending()
    try:
        asyncio.run(_live(options, loaded, handlers, ending))
    except BusError as error:
        ending.ask(str(error), EXIT_FAILED)
    except KeyboardInterrupt:  # before the signal handlers stood
        ending.ask("SIGINT")
    except Exception as error:
        log.error("internal error: %s: %s", type(error).__name__, error, exc_info=error)
        ending.ask("", EXIT_FAILED)
    if ending.code and ending.reason:
        log.error("%s", ending.reason)
    elif ending.reason:
        log.info("ended (%s)", ending.reason)
    logging.shutdown()
    sys.stdout.flush()
    os._exit(ending.code)  # zenoh's threads and a user's action must not keep the process


if __name__ == "__main__":
    main()
