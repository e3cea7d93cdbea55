"""What `rmr-agent` does: load, find the world, live, and say how it ended.

Mistakes are reported in the order in which a user can correct them: the log file, and files that cannot be
read (exit code 2), the byte-code and its actions (3), then the world (waited for). It imports little, so that fifty
robots start in seconds.

Normally a process has one robot, so a failure affects no other robot. Several robots in a process are for density:
fifty robots then need a few interpreters, and one subscription for each cell of the floor instead of fifty. They share
the session on the bus and the event loop, nothing else.
"""

import argparse
import asyncio
import logging
import sys
from collections.abc import Sequence
from functools import partial

from rmr.base.ids import spelled
from rmr.bus.admission import why_no_session
from rmr.bus.certificates import Certificate, CertificateError, Credentials, read_credentials, secret_file
from rmr.bus.process import (
    Ending,
    Throttle,
    handle_signals,
    hold_lifeline,
    run_to_end,
    start_logging,
)
from rmr.bus.process_recorder import ProcessRecorder
from rmr.bus.secret import SecretError
from rmr.bus.session import open_when_there, watch_admission
from rmr.entry import ExitCode
from rmr.entry.files import unreadable
from rmr.radio.key_file import KeyFileError, read_key
from rmr.record.run_files import attach_program
from rmr_agent.bytecode import Loaded, RefusedError, load_handlers, load_program, no_program
from rmr_agent.robot import SAY_AGAIN_S, HostedRobot
from rmr_agent.robot_setup import RobotSetup
from rmr_agent.state_folder import StateFolder

log = logging.getLogger("rmr")


def _load(options: argparse.Namespace) -> RobotSetup:
    trust = None
    if options.trust is not None:
        from rmr.bus.signing import read_trust  # noqa: PLC0415 - heavy, and used with trust alone

        trust = read_trust(options.trust)
    loaded = no_program(trust) if options.program is None else load_program(options.program, trust)
    load_handlers(options.actions)
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
    own = (options.durability, loaded.octets, options.snapshots << 10, options.state_key, options.trust)
    return {robot: StateFolder(path, robot, loaded.digest, *own) for robot, path in folders.items()}


async def live(
    robots: Sequence[int],
    connect: str,
    lab: str | None,
    setup: RobotSetup,
    ending: Ending,
    secret: Credentials | None = None,
    recorder: ProcessRecorder | None = None,
) -> None:
    """Let `robots` live until `ending` is asked for, or each of them has been asked to leave."""
    whose = f"lab {lab}'s" if lab else "the"
    waiting = Throttle(
        lambda: log.info("waiting for %s world at %s%s", whose, connect, why_no_session(connect)),
        SAY_AGAIN_S,
    )
    opening = asyncio.ensure_future(open_when_there(robots[0], connect, waiting, secret))
    if not await ending.unless_asked(opening):
        return
    bus = opening.result()
    buses = [bus, *map(bus.seat, robots[1:])]
    seated = zip(robots, buses, strict=True)
    hosted = [HostedRobot(robot, robots[0], seat, connect, lab, setup, ending, recorder) for robot, seat in seated]
    tasks = [] if recorder is None else [asyncio.ensure_future(recorder.keep_flushed())]
    lives = asyncio.gather(*(robot.run() for robot in hosted))
    asking = asyncio.ensure_future(_pass_on(ending, hosted))
    admission = asyncio.ensure_future(watch_admission(bus, connect, secret, lambda why: log.warning("%s", why)))
    try:
        await lives
    finally:
        for task in (asking, admission, *tasks):
            task.cancel()
        if recorder is not None:
            recorder.end()
    ending.ask(hosted[-1].leaving.reason)


async def _pass_on(ending: Ending, hosted: Sequence[HostedRobot]) -> None:
    """Ask every robot to leave once the process shall end."""
    await ending.wait()
    for robot in hosted:
        robot.leaving.ask(ending.reason, ending.code)


async def _run(options: argparse.Namespace, setup: RobotSetup, secret: Credentials | None, ending: Ending) -> None:
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
        log_file = start_logging(who, options.log)
    except OSError as error:
        print(f"{who}: cannot write {options.log}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    if missing := unreadable(
        (options.program, options.actions, options.radio_key, *map(secret_file, (options.secret, options.trust)))
    ):
        print("\n".join(f"{who}: {line}" for line in missing), file=sys.stderr)
        return ExitCode.USAGE
    try:
        secret = read_credentials(options.secret)
        if isinstance(secret, Certificate):
            secret.check_role("robot", robots=options.id)
        setup = _load(options)
    except (RefusedError, SecretError, CertificateError) as error:
        print(f"{who}: {error}", file=sys.stderr)
        return ExitCode.INVALID
    ending = Ending()
    return run_to_end(_run(options, setup, secret, ending), ending, log_file)
