"""What `rmr-agent` does: load, find the world, live, and say how it ended.

Mistakes are reported in the order in which a user can correct them: the log file, and files that cannot be
read (exit code 2), the byte-code and its actions (3), then the world (waited for). It imports little, so that fifty
robots start in seconds.
"""

import argparse
import sys
from functools import partial

from rmr.base.ids import spelled
from rmr.bus.process import (
    Ending,
    handle_signals,
    hold_lifeline,
    run_to_end,
    start_logging,
)
from rmr.bus.process_recorder import ProcessRecorder
from rmr.bus.secret import Secret, SecretError, read_secret
from rmr.entry import ExitCode
from rmr.entry.files import unreadable
from rmr.radio.key_file import KeyFileError, read_key
from rmr.record.run_files import attach_program
from rmr_agent.bytecode import Loaded, RefusedError, check_actions, load_handlers, load_program, no_program
from rmr_agent.robot_process import live
from rmr_agent.robot_setup import RobotSetup
from rmr_agent.state_folder import StateFolder


def _load(options: argparse.Namespace) -> RobotSetup:
    loaded = no_program() if options.program is None else load_program(options.program)
    check_actions(loaded.program, load_handlers(options.actions))
    try:
        key = None if options.radio_key is None else read_key(options.radio_key)
    except KeyFileError as error:
        raise RefusedError(str(error)) from None
    return RobotSetup(loaded, partial(load_handlers, options.actions), key, _states(options, loaded))


def _states(options: argparse.Namespace, loaded: Loaded) -> dict[int, StateFolder]:
    """Return the folders of the robots, if they are durable. Raises StateRefusedError."""
    if options.state is None:
        return {}
    if options.program is None:
        raise RefusedError("--state needs a program: the state of a robot belongs to the program that it began with")
    several = len(options.id) > 1
    folders = {robot: options.state / str(robot) if several else options.state for robot in options.id}
    own = (options.durability, loaded.octets, options.snapshots << 10, options.state_key)
    return {robot: StateFolder(path, robot, loaded.digest, *own) for robot, path in folders.items()}


async def _live(options: argparse.Namespace, setup: RobotSetup, secret: Secret | None, ending: Ending) -> None:
    handle_signals(ending)
    hold_lifeline()
    attach = partial(attach_program, byte_code=setup.loaded.octets, actions=options.actions)
    name = f"robots-{spelled(options.id)}"
    recorder = None if options.record is None else ProcessRecorder(options.record, name, attach)
    try:
        await live(options.id, options.connect, options.lab, setup, ending, secret, recorder)
    finally:
        for folder in setup.states.values():
            folder.close()


def perform(options: argparse.Namespace) -> int:
    """Run the robots that `options` describe until their end; return the exit code."""
    who = f"rmr-agent {spelled(options.id)}"
    try:
        log = start_logging(who, options.log)
    except OSError as error:
        print(f"{who}: cannot write {options.log}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    if missing := unreadable((options.program, options.actions, options.radio_key, options.secret)):
        print("\n".join(f"{who}: {line}" for line in missing), file=sys.stderr)
        return ExitCode.USAGE
    try:
        setup = _load(options)
        secret = None if options.secret is None else read_secret(options.secret)
    except (RefusedError, SecretError) as error:
        print(f"{who}: {error}", file=sys.stderr)
        return ExitCode.INVALID
    ending = Ending()
    return run_to_end(_live(options, setup, secret, ending), ending, log)
