"""`rmr fault`: finds the lab, sends the request to its world, and shows the disturbances that result.

The world checks the request and keeps the list; this command is a client of the star for one query.
"""

import asyncio
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from math import isinf
from pathlib import Path
from typing import Any, NamedTuple

from rmr.base.time import NEVER, in_seconds
from rmr.bus import wire
from rmr.bus.admission import why_no_session
from rmr.bus.certificates import Certificate, CertificateError, default_endpoint, read_credentials, secret_file
from rmr.bus.endpoint import BusError, check_endpoint, is_tls
from rmr.bus.keys import ANY_LAB, Keys
from rmr.bus.middleware import NobodyThereError
from rmr.bus.secret import SecretError
from rmr.bus.session import Bus, open_bus
from rmr.entry import ExitCode, print_json
from rmr.entry.files import unreadable
from rmr.radio.links import Disturbance
from rmr_deploy.active_runs import REPORT_FILE, secret_of
from rmr_deploy.robot_orders import wait_for_start
from rmr_deploy.run_choice import FleetError, found_run, shown

ASK_S = 2.0
"""Limit for the world's answer, which takes milliseconds unless its machine is overloaded."""


class WorldAddress(NamedTuple):
    """The endpoint of a lab's world, and the secret of its bus."""

    endpoint: str
    secret: Path | None
    """The file with the secret, or the folder with keys; None if the bus has none."""


def perform(
    wish: str,
    added: Disturbance | None,
    *,
    connect: str | None,
    folder: Path | None,
    secret: Path | None,
    lab: str | None,
    as_json: bool,
) -> int:
    """Send `wish`, one of `wire.WISHES`, to the world; return the exit code."""
    try:
        place = find(connect, folder, secret, lab)
        keys = keys_of(lab)
        told = asyncio.run(_ask(place, keys, wire.AskDisturbances(wish, added)))
    except FleetError as error:
        print(f"rmr fault: {error}", file=sys.stderr)
        return error.exit_code
    if told.refused:
        print(f"rmr fault: {told.refused}", file=sys.stderr)
        return ExitCode.USAGE
    if as_json:
        print_json(record(told))
    else:
        print("\n".join(lines(told)))
    return ExitCode.OK


def find(
    connect: str | None, folder: Path | None, secret: Path | None, lab: str | None, verb: str = "fault"
) -> WorldAddress:
    """Return where the world listens: as said, or that of the run that every verb means; else at the default endpoint.

    There a lab listens that was started by hand. A lab that starts is waited for, and `rmr VERB` says so. Raises
    FleetError.
    """
    if connect is not None:
        try:
            return WorldAddress(check_endpoint(connect), secret)
        except BusError as error:
            raise FleetError(str(error), ExitCode.USAGE) from None
    run = found_run(folder, lab)
    if run is None:
        return WorldAddress(default_endpoint(secret), secret)
    if run.endpoint is None:
        raise FleetError(f"the record of the run in {shown(run.folder)} does not say where its world listens")
    if (run.folder / REPORT_FILE).exists():  # another run may listen at the same endpoint by now
        raise FleetError(f"the run in {shown(run.folder)} is over", ExitCode.FAILED)
    if run.launched:
        wait_for_start(run, verb)
    own = secret_of(run.folder)
    fits = secret is not None and secret.is_dir() == is_tls(run.endpoint)  # keys of the environment may not
    return WorldAddress(run.endpoint, secret if fits else own)


def keys_of(lab: str | None) -> Keys:
    """Return the keys of `lab`, None: of any. Raises FleetError."""
    try:
        return Keys(lab or ANY_LAB)
    except ValueError as error:
        raise FleetError(str(error), ExitCode.USAGE) from None


async def _ask(place: WorldAddress, keys: Keys, question: wire.AskDisturbances) -> wire.Disturbances:
    endpoint = place.endpoint
    with opened(place) as bus:
        if keys.lab == ANY_LAB:  # a wish must not reach two labs, so it is put to the one that is there
            there = await ask_world(bus, keys, wire.AskDisturbances("list", None), endpoint)
            if question.wish == "list":
                return there
            keys = Keys(there.lab)
        return await ask_world(bus, keys, question, endpoint)


@contextmanager
def opened(place: WorldAddress) -> Iterator[Bus]:
    """Open the bus at `place` for an operator, and close it in the end. Raises FleetError."""
    bus = open_at(place, "operator")
    try:
        yield bus
    finally:
        bus.close()


def open_at(place: WorldAddress, *roles: str) -> Bus:
    """Return the bus at `place`, for whoever has keys of one of `roles`. Raises FleetError."""
    endpoint = place.endpoint
    if missing := unreadable((secret_file(place.secret),)):
        raise FleetError(missing[0], ExitCode.USAGE)
    try:
        secret = read_credentials(place.secret)
        if isinstance(secret, Certificate):
            secret.check_role(*roles)
        return open_bus(wire.OPERATOR_ID, connect=endpoint, secret=secret)
    except (SecretError, CertificateError) as error:
        raise FleetError(str(error), ExitCode.INVALID) from None
    except NobodyThereError as error:
        why = why_no_session(endpoint)
        raise FleetError(f"no world at {endpoint}{why}" if why else str(error), ExitCode.FAILED) from None
    except BusError as error:
        raise FleetError(str(error), ExitCode.FAILED) from None


async def ask_world(bus: Bus, keys: Keys, question: wire.AskDisturbances, endpoint: str) -> wire.Disturbances:
    """Return the world's answer to `question`. Raises FleetError."""
    replies = await bus.ask(keys.disturbances, question, ASK_S)
    told = [envelope.body for envelope, _ in replies if isinstance(envelope.body, wire.Disturbances)]
    labs = sorted({one.lab for one in told})
    if len(labs) > 1:
        message = f"several labs run at {endpoint}: {', '.join(labs)}; choose with --lab"
        raise FleetError(message, ExitCode.USAGE)
    if not told:
        who = "no lab's world" if keys.lab == ANY_LAB else f"no world of lab {keys.lab}"
        raise FleetError(f"{who} answers at {endpoint}, though a zenoh router does", ExitCode.FAILED)
    return told[0]


def current(told: wire.Disturbances) -> list[tuple[str, Disturbance]]:
    """Return (origin, disturbance) of each disturbance that is active or will be."""
    return [
        ("lab file" if index < told.given else "rmr fault", one)
        for index, one in enumerate(told.held)
        if one.until > told.stamp
    ]


def record(told: wire.Disturbances) -> dict[str, Any]:
    """Return what disturbs the radio as plain data: seconds of lab time, null for the end of the run."""
    held = [
        {
            "by": source,
            "since_s": round(in_seconds(one.since), 3),
            "until_s": None if one.until >= NEVER else round(in_seconds(one.until), 3),
            "groups": one.groups,
            "one_way": one.one_way,
            "loss": one.loss,
            "attenuation_db": 0.0 if isinf(one.attenuation_db) else one.attenuation_db,
            "cut": isinf(one.attenuation_db),
        }
        for source, one in current(told)
    ]
    return {"lab": told.lab, "time_s": round(in_seconds(max(0, told.stamp)), 3), "disturbances": held}


def lines(told: wire.Disturbances) -> Iterator[str]:
    """Yield the lines that show the disturbances to a person."""
    held = current(told)
    yield f"lab {told.lab}, {in_seconds(max(0, told.stamp)):.1f} s:" + ("" if held else " nothing disturbs the radio")
    for source, one in held:
        until = "the end" if one.until >= NEVER else f"{in_seconds(one.until):.1f} s"
        yield f"  {source:9}  {in_seconds(one.since):.1f} s to {until}: {_links(one)}, {_harm(one)}"


def _links(one: Disturbance) -> str:
    groups = list(map(_ids, one.groups))
    if not groups:
        return "all links"
    return f"from {' to '.join(groups)}" if one.one_way else f"between {' and '.join(groups)}"


def _ids(group: tuple[int, ...]) -> str:
    return ",".join(map(str, group))


def _harm(one: Disturbance) -> str:
    if isinf(one.attenuation_db):
        return "cut"
    harms = [f"loss {one.loss:g}"] if one.loss or not one.attenuation_db else []
    return " and ".join([*harms, *([f"attenuation {one.attenuation_db:g} dB"] if one.attenuation_db else [])])
