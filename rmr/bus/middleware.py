"""zenoh as the processes of a run use it: its settings, its threads, and its errors in words that say what to do."""

import contextlib
import json
import os
import re
import secrets
import socket
import stat
import struct
import threading
import time
from collections.abc import Collection, Iterator, Sequence
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from rmr.bus import admission
from rmr.bus.certificates import LISTENERS, Certificate, Credentials
from rmr.bus.endpoint import BusError, check_endpoint, host_problem, is_tls
from rmr.bus.keys import ANY_LAB, Keys
from rmr.bus.rights import RIGHTS
from rmr.bus.secret import Secret

POOLS_VARIABLE = "ZENOH_RUNTIME"
"""Environment variable with zenoh's thread pools. zenoh reads it once in a process, as the first session is opened."""

CLIENT_POOLS = (
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app), app: (worker_threads: 1))"
)
"""The pools of a client, merged into one thread: fifty robots share a few cores. A router keeps zenoh's own, apart."""

LEASE_MS = 3000
"""Lease of a connection: a peer that is silent for longer counts as gone."""

RETRY_FIRST_MS = 100
RETRY_MAX_MS = 1000
"""First and longest pause between attempts to connect; it doubles in between."""

HANDSHAKE_MS = 1500
"""Limit for the answer of a router that has accepted the connection; a stopped process never answers."""


ECHO_S = 3.0


class InUseError(BusError):
    """Another process listens at the address already."""


class NobodyThereError(BusError):
    """No router answers at the endpoint (yet)."""


class NotAdmittedError(NobodyThereError):
    """What listens at the endpoint does not let this session in, or does not know its secret."""


_COMMON_SETTINGS: Final = {
    "connect/exit_on_failure": False,
    "connect/retry": {
        "period_init_ms": RETRY_FIRST_MS,
        "period_max_ms": RETRY_MAX_MS,
        "period_increase_factor": 2,
    },
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "transport/link/tx/lease": LEASE_MS,
    "transport/unicast/open_timeout": HANDSHAKE_MS,
    "transport/unicast/accept_timeout": HANDSHAKE_MS,
}


def _open(settings: dict[str, Any]) -> Any:
    """Return a session with `settings` and the threads that go with them. Raises ZError."""
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with _thread_pools(routes=settings["mode"] == "router"):
        return zenoh.open(config)


def router_settings(listen: str, connect: Sequence[str], secret: Credentials | None, name: str = "") -> dict[str, Any]:
    """Return the settings of zenoh, by key, for a router at `listen` that joins those at `connect` once they are there.

    Under a `secret` a router with a `name` has the same id each time.
    """
    return {
        "mode": "router",
        "listen/endpoints": [listen],
        "connect/endpoints": list(connect),
        "connect/timeout_ms": -1,  # it retries, in the background
        **_COMMON_SETTINGS,
        **({} if secret is None else secret.router_settings(name, joins=bool(connect))),
    }


def _client_settings(connect: str, secret: Credentials | None) -> dict[str, Any]:
    return {
        "mode": "client",
        "listen/endpoints": [],
        "connect/endpoints": [connect],
        "connect/timeout_ms": 0,  # once; it retries when it has been connected
        **_COMMON_SETTINGS,
        **({} if secret is None else secret.client_settings()),
    }


def _explain(error: Exception, endpoint: str) -> BusError:
    """Return zenoh's error as one that says what to do."""
    text = str(error)
    if "Address already in use" in text:
        return InUseError(f"{endpoint} is in use")
    if "Unable to connect" in text or "Timeout" in text:
        return NobodyThereError(f"nobody listens at {endpoint}")
    reason = re.sub(r"\s+at \S+\.rs:\d+\.?", "", text)
    return BusError(f"cannot use {endpoint}: {reason}")


def close_without_waiting() -> None:
    """Have the system, and not the thread that closes it, wait for what a TCP connection of this process has not sent.

    zenoh asks for 10 s of that (SO_LINGER). The thread also reads from other connections: a host that is cut off, with
    as many processes as a router has such threads, would stop it for all others (eclipse-zenoh/zenoh, issue 2718).
    """
    for number in map(int, os.listdir("/dev/fd")):
        with contextlib.suppress(OSError):  # the one that lists them is closed
            if not stat.S_ISSOCK(os.fstat(number).st_mode):
                continue
            with socket.socket(fileno=os.dup(number)) as connection:
                if connection.type == socket.SOCK_STREAM and connection.family in {socket.AF_INET, socket.AF_INET6}:
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))


@contextlib.contextmanager
def _thread_pools(*, routes: bool) -> Iterator[None]:
    """Give zenoh the pools of a router or a client, unless the user has, and no process that is started from here.

    A thread of the router that writes to a dead link waits for seconds; with merged pools it is the one that reads from
    all others, which then take the router for dead.
    """
    if routes or POOLS_VARIABLE in os.environ:
        yield
        return
    os.environ[POOLS_VARIABLE] = CLIENT_POOLS
    try:
        yield
    finally:
        os.environ.pop(POOLS_VARIABLE, None)


def open_router(listen: str, connect: Sequence[str] = (), secret: Credentials | None = None) -> Any:
    """Return the session of a router at `listen`; it joins the routers at `connect` as soon as they are there.

    Raises BusError (a bad endpoint, an address in use). Whether a router at `connect` is there, and lets this one in,
    is not known yet: `open_client` with the same secret tells.
    """
    for endpoint in (listen, *connect):
        check_endpoint(endpoint)
        _check_keys(endpoint, secret)
    if isinstance(secret, Certificate):
        secret.check_role(*LISTENERS)
    if problem := host_problem(listen):  # zenoh would look for a host as long as the system does
        raise BusError(f"cannot use {listen}{problem}")
    try:
        return _open(router_settings(listen, connect, secret))
    except zenoh.ZError as error:
        raise _explain(error, listen) from None


def open_client(connect: str, secret: Credentials | None) -> Any:
    """Return the session of a client of the router at `connect`. May be called on any thread.

    Raises BusError (a bad endpoint), NobodyThereError and NotAdmittedError.
    """
    check_endpoint(connect)
    _check_keys(connect, secret)
    if problem := host_problem(connect):
        raise NobodyThereError(f"nobody listens at {connect}{problem}")
    began_s = time.monotonic()
    try:
        session = _open(_client_settings(connect, secret))
    except zenoh.ZError as error:
        explained = _explain(error, connect)
        in_time = time.monotonic() - began_s < HANDSHAKE_MS / 2000  # else the router is overloaded or stopped
        if isinstance(explained, NobodyThereError) and (in_time or is_tls(connect)):
            refusal = admission.refusal(connect, secret)
            explained = explained if refusal is None else NotAdmittedError(refusal)
        raise explained from None
    if isinstance(secret, Certificate) and (denied := _denied(session, connect, secret)):
        session.close()
        raise NotAdmittedError(f"{connect} lets {secret.holder} in, but {denied}")
    if isinstance(secret, Secret) and not any(secret.is_known_to(str(router)) for router in session.info.routers_zid()):
        session.close()
        raise NotAdmittedError(admission.impostor(connect, secret))
    return session


def _check_keys(endpoint: str, credentials: Credentials | None) -> None:
    """Raise BusError unless the endpoint is one of TLS exactly where this process has keys."""
    if is_tls(endpoint) != isinstance(credentials, Certificate):
        needs = "needs keys, and this process has none" if is_tls(endpoint) else "is not for a process with keys"
        raise BusError(f"{endpoint} {needs}: name an endpoint tls/HOST:PORT and --keys DIR, or neither")


def _denied(session: Any, connect: str, certificate: Certificate) -> str:
    """Return what the router at `connect` does not carry of what the holder may say, and what to do; else nothing.

    A router that lets a process do less than its role may does not say so. So the process says something to a session
    of its own, under its role, for each robot that it may be; if that does not come, under other roles, too. Takes
    `ECHO_S` at most.
    """
    try:
        other = _open(_client_settings(connect, certificate))
    except zenoh.ZError:
        return ""  # the router has gone meanwhile: nothing is known, and the session sees that, too
    role, token = certificate.holder.role, secrets.token_hex(8)

    def echoes(*roles: str) -> dict[str, str]:
        who = [(each, robot) for each in roles for robot in certificate.holder.robots * (each == "robot") or (0,)]
        return {Keys(ANY_LAB).echo(*each, token): f"{each[0]}/{each[1]}".removesuffix("/0") for each in who}

    own = echoes(role)
    try:
        heard = _heard(session, other, own, own, ECHO_S / 3)
        if heard >= own.keys():
            return ""
        every = own | echoes(*(each for each in RIGHTS if each != role))
        heard |= _heard(session, other, every, own, ECHO_S * 2 / 3)
    finally:
        other.close()
    if heard >= own.keys():
        return ""
    if not heard:
        return (
            "carries nothing of it: its certificate is revoked there, or its holder was not known yet when the keys of "
            "what listens were bundled; issue it anew with rmr keys issue, or bundle those anew and restart that"
        )
    rights = ", ".join(who for key, who in every.items() if key in heard)
    return (
        f"it may not act in this lab; its rights are those of {rights}: start what listens with the version of rmr "
        "that this process has, and a zenohd with what rmr router config prints"
    )


def _heard(speaker: Any, listener: Any, keys: Collection[str], enough: Collection[str], limit_s: float) -> set[str]:
    """Return on which of `keys` the session `listener` hears `speaker`, until it has `enough` or the limit is over."""
    heard: set[str] = set()
    came = threading.Event()

    def hear(sample: Any) -> None:
        heard.add(str(sample.key_expr))
        came.set()

    ears = [listener.declare_subscriber(key, Callback(hear, indirect=False)) for key in keys]
    end_s = time.monotonic() + limit_s
    while not heard.issuperset(enough) and time.monotonic() < end_s:
        for key in set(keys) - heard:
            speaker.put(key, b"")  # again: the router may have heard of the subscriber since
        # So long its own message may take to come back through the router; then it is repeated.
        came.wait(0.01)
        came.clear()
    for ear in ears:
        ear.undeclare()
    return heard


class Router:
    """A router without a world: it listens, and joins others as soon as they are there.

    It carries messages between whoever is connected, and takes part in no lab. zenoh does all of it on threads of its
    own; here is only who is connected. The methods may be called on any thread.
    """

    def __init__(self, listen: str, connect: Sequence[str], secret: Credentials | None) -> None:
        """Open it. Raises BusError as `open_router`."""
        self._session: Any = open_router(listen, connect, secret)
        callback: Any = Callback(lambda _: close_without_waiting(), indirect=False)
        self._connections = self._session.info.declare_transport_events_listener(callback, history=True)
        self.id = str(self._session.info.zid())

    def connected(self) -> dict[str, bool]:
        """Return the ids of all that are connected, and whether each is a router."""
        return {str(each.zid): each.whatami == zenoh.WhatAmI.ROUTER for each in self._session.info.transports()}

    def holders(self) -> set[str]:
        """Return the subjects of the certificates of all that are connected; none on a bus without keys."""
        return {each.auth_identifier for each in self._session.info.links() if each.auth_identifier}

    def close(self) -> None:
        """End it; whoever is connected loses it at once."""
        self._connections.undeclare()
        self._session.close()
