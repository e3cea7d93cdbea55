"""What `rmr-agent` does: load, find the world, live, and say how it ended.

Everything that can be wrong is found in the order in which a person can mend it: the log file (exit code 2), the
byte-code and its actions (3), then the world (waited for). It imports little, so that fifty robots start in seconds.
"""

import argparse
import asyncio
import logging
import sys

from rmr.bus.endpoint import BusError
from rmr.bus.process import (
    EXIT_FAILED,
    EXIT_INVALID,
    EXIT_USAGE,
    Ending,
    handle_signals,
    hold_lifeline,
    start_logging,
)
from rmr.node.actions import Handler
from rmr_agent.bytecode import Loaded, RefusedError, check_actions, load_handlers, load_program
from rmr_agent.robot import RobotProcess


def _load(options: argparse.Namespace) -> tuple[Loaded, dict[str, Handler]]:
    loaded = load_program(options.program)
    handlers = load_handlers(options.actions)
    check_actions(loaded.program, handlers)
    return loaded, handlers


async def _live(options: argparse.Namespace, loaded: Loaded, handlers: dict[str, Handler], ending: Ending) -> None:
    handle_signals(ending)
    hold_lifeline()
    await RobotProcess(options.id, options.connect, options.lab, loaded, handlers, ending).run()


def perform(options: argparse.Namespace) -> int:
    """Run the robot that `options` describe until its end; return the exit code."""
    who = f"rmr-agent {options.id}"
    try:
        log = start_logging(who, options.log)
    except OSError as error:
        print(f"{who}: cannot write {options.log}: {error.strerror}", file=sys.stderr)
        return EXIT_USAGE
    try:
        loaded, handlers = _load(options)
    except RefusedError as error:
        print(f"{who}: {error}", file=sys.stderr)
        return EXIT_INVALID
    ending = Ending()
    try:
        asyncio.run(_live(options, loaded, handlers, ending))
    except BusError as error:
        ending.ask(str(error), EXIT_FAILED)
    except Exception as error:
        ending.break_down(error)
    if ending.code and ending.reason:
        log.error("%s", ending.reason)
    elif ending.reason:
        log.info("ended (%s)", ending.reason)
    logging.shutdown()
    return ending.code
