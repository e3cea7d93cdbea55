"""zenoh as the processes of a run use it: its settings, its threads, and its errors in words that say what to do."""

import contextlib
import json
import os
import re
import time
from collections.abc import Iterator
from typing import Any

import zenoh

from rmr.bus import admission
from rmr.bus.endpoint import BusError, check_endpoint, host_problem
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


class InUseError(BusError):
    """Another process listens at the address already."""


class NobodyThereError(BusError):
    """No router answers at the endpoint (yet)."""


class NotAdmittedError(NobodyThereError):
    """What listens at the endpoint does not let this session in, or does not know its secret."""


def _config(listen: str | None, connect: str | None, secret: Secret | None = None) -> Any:
    settings = {
        "mode": "client" if listen is None else "router",
        "listen/endpoints": [] if listen is None else [listen],
        "connect/endpoints": [] if connect is None else [connect],
        "connect/timeout_ms": 0,
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
        **({} if secret is None else secret.settings(is_router=listen is not None)),
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _explain(error: Exception, listen: str | None, connect: str | None) -> BusError:
    """Return zenoh's error as one that says what to do."""
    text = str(error)
    if "Address already in use" in text:
        return InUseError(f"{listen} is in use")
    if "Unable to connect" in text or "Timeout" in text:
        return NobodyThereError(f"nobody listens at {connect}")
    reason = re.sub(r"\s+at \S+\.rs:\d+\.?", "", text)
    return BusError(f"cannot use {listen or connect}: {reason}")


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


def open_session(listen: str | None, connect: str | None, secret: Secret | None) -> Any:
    """Return a session of zenoh. Raises as `open_bus` does; may be called on any thread."""
    for endpoint in (listen, connect):
        if endpoint is not None:
            check_endpoint(endpoint)
    # zenoh would look for a host as long as the system does.
    if listen and (problem := host_problem(listen)):
        raise BusError(f"cannot use {listen}{problem}")
    if connect and (problem := host_problem(connect)):
        raise NobodyThereError(f"nobody listens at {connect}{problem}")
    began_s = time.monotonic()
    try:
        with _thread_pools(routes=listen is not None):
            session: Any = zenoh.open(_config(listen, connect, secret))
    except zenoh.ZError as error:
        explained = _explain(error, listen, connect)
        in_time = time.monotonic() - began_s < HANDSHAKE_MS / 2000  # else the router is overloaded or stopped
        if connect and isinstance(explained, NobodyThereError) and in_time:
            refusal = admission.refusal(connect, secret)
            explained = explained if refusal is None else NotAdmittedError(refusal)
        raise explained from None
    if connect and secret is not None and secret.router not in map(str, session.info.routers_zid()):
        session.close()
        raise NotAdmittedError(admission.impostor(connect, secret))
    return session
