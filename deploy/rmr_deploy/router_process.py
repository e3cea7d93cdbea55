"""What `rmr router` does: it opens the router, says who is connected, and how it stands with other hosts' routers.

zenoh routes on threads of its own and joins the other routers by itself, again and again. But it tells nobody why it
cannot: so a client asks at each of their endpoints, as long as its router is not joined. One that refuses a client from
the beginning ends this process, for whoever started it gave it the wrong secret; one that refuses later is waited for.
"""

import argparse
import asyncio
import logging
import sys
import time

from rmr.base.printable import counted
from rmr.bus import refusals, wire
from rmr.bus.admission import why_no_session
from rmr.bus.certificates import Certificate, CertificateError, Credentials, secret_file
from rmr.bus.endpoint import BusError
from rmr.bus.listening import SAY_AGAIN_S, Refused, secret_of_listener, warn_if_open
from rmr.bus.middleware import InUseError, NotAdmittedError, Router
from rmr.bus.occupant import who_listens
from rmr.bus.process import Ending, Throttle, handle_signals, hold_lifeline, run_to_end, start_logging
from rmr.bus.secret import Secret, SecretError
from rmr.bus.session import open_when_there
from rmr.entry import ExitCode
from rmr.entry.files import unreadable

LOOK_S = 0.5
"""How often it is looked at who is connected."""


log = logging.getLogger("rmr")


def perform(options: argparse.Namespace) -> int:
    """Route until the end is asked for; return the exit code."""
    try:
        start_logging("rmr router", options.log)
    except OSError as error:
        print(f"rmr router: cannot write {options.log}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    is_made = not options.connect and options.secret is not None and not options.secret.exists()
    if missing := unreadable([None if is_made else secret_file(options.secret)]):
        print(f"rmr router: {missing[0]}", file=sys.stderr)
        return ExitCode.USAGE
    try:
        secret = secret_of_listener(options.secret, makes=not options.connect)
        if isinstance(secret, Certificate):
            secret.check_role("router", "world")  # that of a world may listen, too: `rmr up` has no other there
    except (SecretError, CertificateError) as error:
        print(error, file=sys.stderr)
        return ExitCode.INVALID
    except OSError as error:
        print(f"rmr router: {error.filename or options.secret}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    ending = Ending()
    return run_to_end(_live(options, secret, ending), ending, log)


async def _live(options: argparse.Namespace, secret: Credentials | None, ending: Ending) -> None:
    handle_signals(ending)
    hold_lifeline()
    if isinstance(secret, Secret):
        refusals.watch(Refused())
    try:
        router = Router(options.listen, options.connect, secret)
    except InUseError as error:
        raise BusError(f"{error}: {await who_listens(options.listen, secret)}") from None
    log.info("a router at %s", options.listen)
    warn_if_open(options.listen, opened=options.open)
    try:
        await ending.unless_asked(asyncio.ensure_future(_watch(router, options.connect, secret)))
    finally:
        router.close()


async def _watch(router: Router, connect: list[str], secret: Credentials | None) -> None:
    """Say what changes. Raises NotAdmittedError for a router at `connect` that refuses from the beginning."""
    await asyncio.gather(_tell_company(router, secret), *(_follow(router, endpoint, secret) for endpoint in connect))


async def _tell_company(router: Router, secret: Credentials | None) -> None:
    """Say how many are connected, at the beginning and on each change, and of whom nothing is carried."""
    told = ""
    denied: set[str] = set()
    while True:
        routers = list(router.connected().values())
        now = f"connected: {counted(sum(routers), 'router')}, {counted(routers.count(False), 'process')}"
        if now != told:
            log.info("%s", now)
        told = now
        if isinstance(secret, Certificate):
            before, denied = denied, {one for one in router.holders() if secret.denies(one)}
            for subject in sorted(denied - before):
                log.warning("%s is connected %s: nothing of it is carried", subject, secret.denies(subject))
        await asyncio.sleep(LOOK_S)


async def _follow(router: Router, endpoint: str, secret: Credentials | None) -> None:
    """Say when the router at `endpoint` is joined and when it is not, and why. Raises as `_watch`, and for this one."""
    other = await _router_at(endpoint, secret)
    while True:
        if other == router.id:
            raise BusError(f"{endpoint} is this router itself: name that of another host with --connect")
        # How long zenoh may take to join a router that lets a client in; after that it is asked again.
        joins = time.monotonic() + 5.0
        while other not in router.connected() and time.monotonic() < joins:
            await asyncio.sleep(LOOK_S)
        if other in router.connected():
            log.info("joined the router at %s", endpoint)
            while other in router.connected():
                await asyncio.sleep(LOOK_S)
            log.warning("lost the router at %s", endpoint)
        other = await _router_back_at(endpoint, secret)


async def _router_at(endpoint: str, secret: Credentials | None) -> str:
    """Return the id of the router at `endpoint` when it is there. Raises NotAdmittedError."""
    say = Throttle(lambda: log.info("waiting for the router at %s%s", endpoint, why_no_session(endpoint)), SAY_AGAIN_S)
    bus = await open_when_there(wire.OPERATOR_ID, endpoint, say, secret)
    try:
        return bus.router
    finally:
        bus.close()


async def _router_back_at(endpoint: str, secret: Credentials | None) -> str:
    """Return the id of the router at `endpoint` when it is there and lets this one in."""
    told = ""
    while True:
        try:
            return await _router_at(endpoint, secret)
        except NotAdmittedError as error:
            if str(error) != told:
                log.error("%s", error)
            told = str(error)
