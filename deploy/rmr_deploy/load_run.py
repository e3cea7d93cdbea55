"""`rmr load`: finds the lab, distributes the program, and says what became of it.

Over the bus this process is the distributor: it talks to each robot, with lab time as the world tells it. Over the
radio it hands the program to one robot, the first of those that live, which distributes it.
"""

import asyncio
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from rmr.base.errors import ProgramError
from rmr.base.ids import spelled
from rmr.base.printable import counted
from rmr.base.time import NS_PER_S, Duration, Instant
from rmr.bus import wire
from rmr.bus.certificates import CertificateError
from rmr.bus.keys import ANY_LAB, ROBOT_ROLE, Keys, last_id
from rmr.bus.session import Bus
from rmr.entry import ExitCode, print_json
from rmr.load.load_coordinator import LoadCoordinator
from rmr.load.load_messages import LoadError
from rmr.load.load_pace import BUS
from rmr_deploy.disturb import WorldAddress, ask_world, find, keys_of, opened
from rmr_deploy.run_choice import FleetError
from rmr_deploy.sign import signed
from rmr_world.finding import LabError
from rmr_world.lab_program import LoadedProgram, load_program

TRUTH_S: Final = 3.0
"""Limit for the world's news of all bodies, which come ten times a second."""
RADIO_OCTETS_MAX: Final = 32 << 10
"""Larger programs are not distributed over the radio, where they would take minutes."""
TICK_S: Final = 0.02
"""Longest sleep of the distributor."""

Outcome = dict[str, Any]


def perform(
    *,
    program: Path,
    robots: Sequence[int] | None,
    via: str | None,
    dry_run: bool,
    connect: str | None,
    folder: Path | None,
    secret: Path | None,
    lab: str | None,
    as_json: bool,
) -> int:
    """Load `program`; return the exit code."""
    if not program.exists():
        print(f"rmr load: there is no file {program}", file=sys.stderr)
        return ExitCode.USAGE
    try:
        loaded = load_program(program)
        place = find(connect, folder, secret, lab, "load")
        outcome = asyncio.run(distribute(place, keys_of(lab), loaded, robots, via=via or "bus", dry=dry_run))
    except (ProgramError, LabError) as error:
        print(f"rmr load: {error}", file=sys.stderr)
        return ExitCode.INVALID
    except FleetError as error:
        print(f"rmr load: {error}", file=sys.stderr)
        return error.exit_code
    if loaded.warnings:
        print(loaded.warnings.rstrip("\n"), file=sys.stderr)
    if as_json:
        print_json(outcome)
    else:
        print("\n".join(lines(outcome)))
    return ExitCode.OK if all_ready(outcome) else ExitCode.FAILED


def all_ready(outcome: Outcome) -> bool:
    """Return whether all robots switch, or in a dry run could."""
    return bool(outcome["switched"] or (outcome["dry_run"] and not _problems(outcome)))


def _problems(outcome: Outcome) -> list[str]:
    return [robot for robot, told in outcome["robots"].items() if told["problem"] is not None]


def lines(outcome: Outcome) -> list[str]:
    """Return the lines that tell a person what became of a load."""
    robots = outcome["robots"]
    failed = _problems(outcome)
    if outcome["switched"]:
        first = f"{len(robots)} robots run program {outcome['program']} from {outcome['at_s']:.3f} s of lab time"
    elif outcome["dry_run"]:
        first = f"dry run: {len(robots) - len(failed)} of {len(robots)} robots could run program {outcome['program']}"
    else:
        first = f"no robot has switched: the old program goes on ({len(failed)} of {len(robots)} could not)"
    return [first, *(f"  @{robot}  {_told(told, outcome)}" for robot, told in robots.items())]


def _told(told: dict[str, Any], outcome: Outcome) -> str:
    if told["problem"] is not None:
        return str(told["problem"])
    if not (outcome["switched"] or outcome["dry_run"]):
        return "was ready" if told["ready"] else "was not asked to the end"
    facts = f"{counted(told['carried'], 'fact')} kept, {told['dropped']} dropped"
    return facts + (f": {told['drops']}" if told["drops"] else "")


async def distribute(
    place: WorldAddress,
    keys: Keys,
    program: LoadedProgram,
    robots: Sequence[int] | None,
    *,
    via: str = "bus",
    dry: bool = False,
) -> Outcome:
    """Distribute `program` to `robots` (None: all of the lab); return the outcome. Raises FleetError.

    On a bus with keys it is signed with the operator's, if nobody has signed it yet.
    """
    with opened(place) as bus:
        try:
            program = replace(program, octets=signed(program.octets, place.secret))
        except CertificateError as error:
            raise FleetError(str(error), ExitCode.INVALID) from None
        told = await _started(bus, keys, place.endpoint)
        heard_ns = time.monotonic_ns()
        keys = Keys(told.lab) if keys.lab == ANY_LAB else keys
        roster = await _roster(bus, keys)
        wanted = list(roster if robots is None else dict.fromkeys(robots))
        strangers = [robot for robot in wanted if robot not in roster]
        if strangers:
            message = f"lab {keys.lab} has no robot {spelled(strangers)}; its robots are {spelled(roster)}"
            raise FleetError(message, ExitCode.USAGE)
        if told.stamp < 0:
            raise FleetError(f"lab {told.lab} has not started yet: robots get programs while they run", ExitCode.FAILED)
        named = sorted(wanted) != sorted(roster)
        try:
            if via == "radio":
                return await _over_radio(bus, keys, program, wanted, named=named, dry=dry)
            coordinator = LoadCoordinator(program.octets, program.digest, wanted, BUS, dry=dry, named=named)
        except LoadError as error:
            raise FleetError(str(error), ExitCode.USAGE) from None
        return await _over_bus(bus, keys, coordinator, lambda: told.stamp + time.monotonic_ns() - heard_ns)


async def _started(bus: Bus, keys: Keys, endpoint: str) -> wire.Disturbances:
    """Return what the world says, once lab time runs: when all robots are ready, its begin may be a moment ahead."""
    # The world sets the beginning of lab time less than a second ahead when all robots are ready.
    end = time.monotonic() + 2.0
    while True:
        told = await ask_world(bus, keys, wire.AskDisturbances("list", None), endpoint)
        if told.stamp >= 0 or time.monotonic() > end:
            return told
        await asyncio.sleep(0.05)  # period with which it looks


async def _roster(bus: Bus, keys: Keys) -> list[int]:
    """Return the ids of all robots of the lab, as the world sees their bodies."""
    found: asyncio.Future[list[int]] = asyncio.get_running_loop().create_future()

    def take(_key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.Truth) and not found.done():
            found.set_result(sorted(row[0] for row in message.body.robots))

    withdraw = bus.subscribe(keys.truth, take)
    try:
        return await asyncio.wait_for(found, TRUTH_S)
    except TimeoutError:
        raise FleetError(f"the world of lab {keys.lab} does not say which robots it has", ExitCode.FAILED) from None
    finally:
        withdraw()


async def _over_bus(bus: Bus, keys: Keys, coordinator: LoadCoordinator, now: Callable[[], Instant]) -> Outcome:
    """Be the distributor until the load is over."""
    stir = asyncio.Event()

    def take(_key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.Load):
            coordinator.received(now(), message.body.payload, message.sender)
            stir.set()

    withdraw = bus.subscribe(keys.answers("*"), take)
    try:
        coordinator.start(now())
        while coordinator.result is None:
            at = now()
            if at >= coordinator.next_wake:
                coordinator.wake(at)
            _send(bus, keys, coordinator)
            stir.clear()
            await _sleep(stir, coordinator.next_wake - now())
    finally:
        withdraw()
    result = coordinator.result
    if result.switched and not result.dry and result.at is not None:
        await asyncio.sleep(max(0.0, (result.at - now()) / NS_PER_S))  # say it when it is so
    return result.as_dict()


def _send(bus: Bus, keys: Keys, coordinator: LoadCoordinator) -> None:
    said, coordinator.out = coordinator.out, []
    for out in said:
        body = wire.Load(out.message.encode(BUS.octets_max))
        for robot in coordinator.robots if out.destination is None else (out.destination,):
            bus.publish(keys.load(robot), body)


async def _sleep(stir: asyncio.Event, delay: Duration) -> None:
    """Sleep until something comes, or something is due."""
    try:
        await asyncio.wait_for(stir.wait(), min(max(delay / NS_PER_S, 0.001), TICK_S))
    except TimeoutError:
        return


async def _over_radio(
    bus: Bus, keys: Keys, program: LoadedProgram, robots: list[int], *, named: bool, dry: bool
) -> Outcome:
    """Let a robot distribute the program."""
    if len(program.octets) > RADIO_OCTETS_MAX:
        message = (
            f"the program has {len(program.octets)} octets, too many for the radio ({RADIO_OCTETS_MAX}): --via bus"
        )
        raise FleetError(message, ExitCode.USAGE)
    by = await _first_alive(bus, keys, robots)
    loop = asyncio.get_running_loop()
    told: asyncio.Future[wire.LoadOutcome] = loop.create_future()

    def take(_key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.LoadOutcome) and message.sender == by and not told.done():
            told.set_result(message.body)

    withdraw = bus.subscribe(keys.answers("*"), take)
    try:
        bus.publish(keys.load(by), wire.LoadOrder(program.octets, tuple(robots), named, dry))
        # Over the radio a long program takes seconds, a silent robot ten.
        answer = await asyncio.wait_for(told, 120.0)
    except TimeoutError:
        message = f"robot {by}, which was to distribute the program, has not answered: ask again with --dry-run"
        raise FleetError(message, ExitCode.FAILED) from None
    finally:
        withdraw()
    if answer.refused:
        raise FleetError(f"robot {by}: {answer.refused}", ExitCode.FAILED)
    return {"by": by, **json.loads(answer.result)}


async def _first_alive(bus: Bus, keys: Keys, robots: list[int]) -> int:
    """Return the first of `robots` that is heard of as alive."""
    found: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    def take(key: str, up: bool) -> None:
        ident = last_id(key)
        if ident in robots and up and not found.done():
            found.set_result(ident)

    bus.watch_alive(keys.alive(ROBOT_ROLE, "*"), take)
    try:
        return await asyncio.wait_for(found, TRUTH_S)
    except TimeoutError:
        message = f"no robot of {spelled(sorted(robots))} runs in lab {keys.lab}"
        raise FleetError(message, ExitCode.FAILED) from None
