"""What `rmr-world` does: load the lab, open the bus, serve, and say how it ended.

It is the router of the star unless it is told to be a client of another one, which it then waits for.
"""

import argparse
import asyncio
import logging
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rmr.base.ids import spelled
from rmr.bus import refusals, wire
from rmr.bus.admission import why_no_session
from rmr.bus.certificates import CertificateError, Credentials, check_keys, secret_file
from rmr.bus.endpoint import BusError
from rmr.bus.keys import Keys
from rmr.bus.listening import SAY_AGAIN_S, Refused, secret_of_listener, warn_if_open
from rmr.bus.middleware import InUseError
from rmr.bus.occupant import ASK_S, who_listens
from rmr.bus.process import (
    Ending,
    Throttle,
    handle_signals,
    hold_lifeline,
    run_to_end,
    start_logging,
)
from rmr.bus.process_recorder import ProcessRecorder
from rmr.bus.secret import Secret, SecretError
from rmr.bus.session import Bus, open_bus, open_when_there
from rmr.bytecode.program import Program
from rmr.entry import ExitCode
from rmr.entry.files import unreadable
from rmr.record.run_files import attach_lab
from rmr_world.finding import LabError
from rmr_world.lab import Lab, ros_name
from rmr_world.lab_file import lab_path, load_lab
from rmr_world.server import WorldServer
from rmr_world.world_messages import map_of
from rmr_world.world_state import WorldFolder, WorldStateError

NO_RCLPY = "install rclpy by pip install 'rmr-robots[ros2]', or source the setup file of a ROS 2 installation before"
"""What to do where it is missing."""

if TYPE_CHECKING:
    from rmr_ros.ros_actions import ActionCall
    from rmr_ros.ros_bridge import RosBridge
    from rmr_ros.ros_facts import TopicReading

log = logging.getLogger("rmr")


class InvalidError(Exception):
    """The program does not go with the lab; the message is what a person is shown."""


def _load(options: argparse.Namespace) -> tuple[Lab, Program | None]:
    """Return the lab, and the program that it is checked against: that of the options, or one that its topics need."""
    program = None
    lab = load_lab(options.config)
    if options.seed is not None:
        lab = replace(lab, seed=options.seed)
    if options.program is not None or lab.topic_facts or lab.ros_actions:
        program = _checked_program(lab, options.program or lab.program)
    return lab if options.robots is None else lab.with_robots(options.robots), program


def _checked_program(lab: Lab, path: Path) -> Program:
    """Return the program in `path`. Raises InvalidError if it is none, LabError where it and the lab do not fit."""
    # The front end is heavy, and a world that is given no program starts without it.
    from rmr_world.lab_program import (  # noqa: PLC0415
        ProgramError,
        load_program,
        validated,
    )

    try:
        return validated(lab, load_program(path, stated=lab.given)).program
    except ProgramError as error:
        raise InvalidError(str(error)) from None


async def _open(options: argparse.Namespace, secret: Credentials | None, ending: Ending) -> Bus | None:
    """Return the session; None when the end was asked for while waiting for the router."""
    if options.connect is None:
        endpoint = options.listen
        if isinstance(secret, Secret):
            refusals.watch(Refused())
        try:
            return open_bus(wire.WORLD_ID, listen=endpoint, secret=secret)
        except InUseError as error:
            raise BusError(f"{error}: {await who_listens(endpoint, secret)}") from None
    router = options.connect
    say = Throttle(
        lambda: log.info("waiting for the router at %s%s", router, why_no_session(router)),
        SAY_AGAIN_S,
    )
    opening = asyncio.ensure_future(open_when_there(wire.WORLD_ID, options.connect, say, secret))
    return opening.result() if await ending.unless_asked(opening) else None


def _readings(lab: Lab, program: Program | None) -> "list[TopicReading]":
    """Return what each robot reads of topics."""
    from rmr_ros.ros_facts import TopicReading  # noqa: PLC0415 - as the bridge

    spaces = _namespaces(lab)
    found = []
    for each in lab.topic_facts:
        assert program is not None, "it is loaded for a lab with such facts"
        name = each.fact.name
        types = _types(program, name)
        for robot in (one for one in lab.roster if each.fact.owner in (None, one)):
            topic = ros_name(each.topic, robot, spaces[robot])
            found.append(TopicReading(each.item, robot, topic, each.type, name, each.fact.args, types, each.every))
    return found


def _calls(lab: Lab, program: Program | None) -> "list[ActionCall]":
    """Return what each robot's actions call or publish."""
    from rmr_ros.ros_actions import ActionCall  # noqa: PLC0415 - as the bridge

    spaces = _namespaces(lab)
    found = []
    for each in lab.ros_actions:
        assert program is not None, "it is loaded for a lab with such actions"
        about = each.name, _types(program, each.name), each.args, each.fields, each.type
        for robot in (one for one in lab.roster if each.owner in (None, one)):
            end = ros_name(each.topic or each.service, robot, spaces[robot])
            found.append(ActionCall(each.item, robot, *about, end, bool(each.service), each.within))
    return found


def _namespaces(lab: Lab) -> dict[int, str]:
    """Return the namespace in ROS 2 of each robot."""
    return {robot: f"/robot_{robot}" for robot in lab.roster} | {body.robot: body.namespace for body in lab.bodies}


def _types(program: Program, name: str) -> tuple[str, ...]:
    """Return the types of the arguments of a predicate, in words."""
    return tuple(kind.base.name.lower() for kind in program.predicates[program.index(name) or 0].types)


async def _bridge(
    lab: Lab, ending: Ending, program: Program | None = None, *, shows: bool = False
) -> "RosBridge | None":
    """Return the lab in ROS 2, once its robots there have come; None without any, or where the end came before."""
    if not (lab.bodies or lab.topic_facts or lab.ros_actions or shows):
        return None
    try:
        from rmr_ros.ros_bridge import BridgeError, RosBridge  # noqa: PLC0415 - rclpy, for labs that ask for it
    except ImportError as error:
        robots = spelled([body.robot for body in lab.bodies])
        others = "the lab has facts from topics" if lab.topic_facts else "--ros2 shows the robots in ROS 2"
        others = "the lab has actions of ROS 2" if lab.ros_actions else others
        why = f"robots {robots} have bodies in ROS 2" if robots else others
        ending.ask(f"{why}: {NO_RCLPY} ({error})", ExitCode.FAILED)
        return None
    try:
        starts = {robot.id: robot.pose for robot in lab.robots}
        bridge = RosBridge(
            lab.name, lab.bodies, lab.arena, starts, _readings(lab, program), _calls(lab, program), shows=shows
        )
    except BridgeError as error:
        ending.ask(str(error), ExitCode.FAILED)
        return None
    waiting = asyncio.ensure_future(bridge.ready())
    try:
        if lab.bodies or lab.ros_actions:
            log.info("waiting for the robots of ROS 2")
        if await ending.unless_asked(waiting):
            waiting.result()
            return bridge
    except BridgeError as error:
        ending.ask(str(error), ExitCode.FAILED)
    bridge.close()
    return None


async def _live(
    options: argparse.Namespace,
    lab: Lab,
    program: Program | None,
    secret: Credentials | None,
    folder: WorldFolder | None,
    ending: Ending,
) -> None:
    handle_signals(ending)
    hold_lifeline()
    bridge = await _bridge(lab, ending, program, shows=options.ros2)
    bus = None if ending.asked else await _open(options, secret, ending)
    if bus is None:
        if bridge is not None:
            bridge.close()
        return
    log.info("lab %s, %d robots, at %s", lab.name, len(lab.robots), options.connect or options.listen)
    warn_if_open(options.listen, opened=options.open)
    attach = partial(attach_lab, floor=lab.arena, lab=lab.path, program=options.program or lab.program)
    recorder = None if options.record is None else ProcessRecorder(options.record, "world", attach)
    tasks = [] if recorder is None else [asyncio.ensure_future(recorder.keep_flushed())]
    try:
        if bus.is_client and await bus.ask(Keys(lab.name).clock, wire.AskClock(), ASK_S):
            raise BusError(f"lab {lab.name} has a world at {options.connect} already: end it, or rename this one")
        when_ready = options.when_ready
        server = WorldServer(
            lab, lab.seed, bus, ending, when_ready=when_ready, recorder=recorder, folder=folder, bridge=bridge
        )
        await server.run()
    finally:
        if bridge is not None:
            bridge.close()
        for task in tasks:
            task.cancel()
        if recorder is not None:
            recorder.end()
        bus.close()
        if folder is not None:
            folder.close()


def perform(options: argparse.Namespace) -> int:
    """Serve the world that `options` describe until its end; return the exit code."""
    try:
        start_logging("rmr-world", options.log)
    except OSError as error:
        print(f"rmr-world: cannot write {options.log}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    is_made = options.connect is None and options.secret is not None and not options.secret.exists()
    given = None if is_made else secret_file(options.secret)
    if missing := unreadable((lab_path(options.config), options.program, given)):
        print("\n".join(f"rmr-world: {line}" for line in missing), file=sys.stderr)
        return ExitCode.USAGE
    try:
        lab, program = _load(options)
        secret = secret_of_listener(options.secret, makes=options.connect is None)
        check_keys(secret, "world", of=lab.name if lab.mtls else None)
        folder = None if options.state is None else WorldFolder(options.state, map_of(lab, lab.seed))
    except (LabError, InvalidError, SecretError, CertificateError, WorldStateError) as error:
        print(error, file=sys.stderr)
        return ExitCode.INVALID
    except OSError as error:
        print(f"rmr-world: {error.filename or options.config}: {error.strerror}", file=sys.stderr)
        return ExitCode.INVALID
    ending = Ending()
    return run_to_end(_live(options, lab, program, secret, folder, ending), ending, log)
