"""The command `rmr-world`: a lab's world as one process, and the router of the star unless told to be a client."""

import argparse
import asyncio
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rmr import __version__
from rmr.bus import wire
from rmr.bus.process import (
    EXIT_FAILED,
    EXIT_INVALID,
    EXIT_USAGE,
    Ending,
    Seldom,
    handle_signals,
    hold_lifeline,
    start_logging,
)
from rmr.bus.session import DEFAULT_ENDPOINT, Bus, BusError, check_endpoint, open_bus, open_when_there
from rmr_world.lab import Lab, LabError, load_lab
from rmr_world.server import WorldServer

SAY_AGAIN_S = 5.0
"""How often a waiting world says that it waits for its router."""

log = logging.getLogger("rmr")


class InvalidError(Exception):
    """The program does not go with the lab; the message is what a person is shown."""


def _endpoint(text: str) -> str:
    try:
        return check_endpoint(text)
    except BusError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"'{text}' is no number of robots")
    return int(text)


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    it = argparse.ArgumentParser(
        prog="rmr-world",
        description="Run a lab's world: physics, sensors, lab time, and the router that robots connect to.",
        epilog="Robots come and go with rmr-agent, in any order; `rmr up LAB` starts everything.",
    )
    it.add_argument("--config", required=True, type=Path, metavar="LAB.yaml", help="the lab file, or its folder")
    place = it.add_mutually_exclusive_group()
    place.add_argument(
        "--listen", type=_endpoint, metavar="ENDPOINT", help=f"where robots connect (default: {DEFAULT_ENDPOINT})"
    )
    place.add_argument("--connect", type=_endpoint, metavar="ENDPOINT", help="be a client of the router there")
    it.add_argument(
        "--program", type=Path, metavar="PROG", help="check the lab's facts against this program (.rmr or .rbc)"
    )
    it.add_argument("--robots", type=_count, metavar="N", help="only the first N robots of the lab")
    it.add_argument("--seed", type=int, metavar="S", help="another seed than the lab file's")
    it.add_argument("--when-ready", action="store_true", help="lab time starts when all robots are ready")
    it.add_argument("--log", type=Path, metavar="FILE", help="write a log as JSON lines")
    it.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return it


def _load(options: argparse.Namespace) -> Lab:
    path = options.config / "lab.yaml" if options.config.is_dir() else options.config
    lab = load_lab(path)
    if options.program is not None:
        _check_facts(lab, options.program)
    return lab if options.robots is None else lab.with_robots(options.robots)


def _check_facts(lab: Lab, path: Path) -> None:
    """Raise InvalidError unless the program in `path` knows what the lab file states and wants to see finished."""
    # The front end is heavy, and a world that is given no program starts without it.
    from rmr.lang.facts import FactError, parse_fact, parse_pattern  # noqa: PLC0415
    from rmr_world.program import ProgramError, load_program  # noqa: PLC0415

    try:
        program = load_program(path).program
    except ProgramError as error:
        raise InvalidError(str(error)) from None
    wrong: list[str] = []
    checks = [*((text, parse_fact) for text in lab.facts), *((text, parse_pattern) for text in [lab.finish] if text)]
    for text, check in checks:
        try:
            check(text, program)
        except FactError as error:
            wrong.append(f"{lab.path}: {text}: {error}")
    if wrong:
        raise InvalidError("\n".join(wrong))


async def _open(options: argparse.Namespace, ending: Ending) -> Bus | None:
    """Return the session; None when the end was asked for while waiting for the router."""
    if options.connect is None:
        return open_bus(wire.WORLD_ID, listen=options.listen or DEFAULT_ENDPOINT)
    say = Seldom(lambda: log.info("waiting for the router at %s", options.connect), SAY_AGAIN_S)
    opening = asyncio.ensure_future(open_when_there(wire.WORLD_ID, options.connect, say))
    ended = asyncio.ensure_future(ending.wait())
    await asyncio.wait([opening, ended], return_when=asyncio.FIRST_COMPLETED)
    ended.cancel()
    if opening.done():
        return opening.result()
    opening.cancel()
    return None


async def _live(options: argparse.Namespace, lab: Lab, ending: Ending) -> None:
    handle_signals(ending)
    hold_lifeline()
    bus = await _open(options, ending)
    if bus is None:
        return
    seed = lab.seed if options.seed is None else options.seed
    log.info(
        "lab %s, %d robots, at %s", lab.name, len(lab.robots), options.connect or options.listen or DEFAULT_ENDPOINT
    )
    try:
        await WorldServer(lab, seed, bus, ending, when_ready=options.when_ready).run()
    finally:
        bus.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; ends the process."""
    options = parser().parse_args(arguments)
    try:
        start_logging("rmr-world", options.log)
    except OSError as error:
        print(f"rmr-world: cannot write {options.log}: {error.strerror}", file=sys.stderr)
        sys.exit(EXIT_USAGE)
    try:
        lab = _load(options)
    except (LabError, InvalidError) as error:
        print(error, file=sys.stderr)
        sys.exit(EXIT_INVALID)
    except OSError as error:
        print(f"rmr-world: {error.filename or options.config}: {error.strerror}", file=sys.stderr)
        sys.exit(EXIT_INVALID)
    ending = Ending()
    try:
        asyncio.run(_live(options, lab, ending))
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
    os._exit(ending.code)  # zenoh's threads must not keep the process


if __name__ == "__main__":
    main()
