"""Endpoints: where a router listens, as people write it. Imports no zenoh, so that help costs little."""

import math
import re
import socket
import time
from ipaddress import ip_address
from threading import Thread

DEFAULT_PORT = 17447
"""Not 7447, which is zenoh's own: a zenohd or another program of zenoh may listen there."""

DEFAULT_ENDPOINT = f"tcp/127.0.0.1:{DEFAULT_PORT}"
"""Default endpoint at which a world listens and to which a robot connects."""

ENDPOINT = re.compile(r"(tcp|tls|udp|ws)/(\[[0-9A-Fa-f:.]+\]|[^\s/:\[\]]+):(\d{1,5})")

DEFAULT_TLS_ENDPOINT = f"tls/127.0.0.1:{DEFAULT_PORT}"
"""The same for processes with keys."""

RESOLVE_S_MAX = 2.0
"""How long a name may take to be found."""


_not_found: dict[str, float] = {}
"""When each host that was not found was looked for last, monotonic seconds."""


class BusError(Exception):
    """The bus cannot be used as asked; the message says why and what to do."""


def check_endpoint(endpoint: str) -> str:
    """Return `endpoint` if it is one. Raises BusError."""
    if endpoint.startswith("quic/"):
        raise BusError(f"'{endpoint}': rmr does not use quic; write tls for an endpoint with keys, or tcp, udp or ws")
    match = ENDPOINT.fullmatch(endpoint)
    if not match or not 0 < int(match[3]) < 65536:
        raise BusError(f"'{endpoint}' is no endpoint: expected PROTOCOL/HOST:PORT, for example {DEFAULT_ENDPOINT}")
    return endpoint


def read_endpoint(text: str) -> str:
    """Return `text` if it is an endpoint: the reader of an option. Raises ValueError."""
    try:
        return check_endpoint(text)
    except BusError as error:
        raise ValueError(str(error)) from None


def is_tls(endpoint: str) -> bool:
    """Return whether an endpoint is one of processes with keys."""
    return endpoint.startswith("tls/")


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Return the parts of a valid endpoint."""
    match = ENDPOINT.fullmatch(endpoint)
    assert match is not None
    return match[2].strip("[]"), int(match[3])


def is_loopback(endpoint: str) -> bool:
    """Return whether a valid endpoint is reached from its machine alone. Of names, `localhost` counts alone."""
    match = ENDPOINT.fullmatch(endpoint)
    assert match is not None
    host = match[2].strip("[]")
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def host_problem(endpoint: str) -> str:
    """Return what is wrong with the host of a valid endpoint, `: ` before it; empty when it has an address.

    Takes `RESOLVE_S_MAX` at most.
    """
    match = ENDPOINT.fullmatch(endpoint)
    assert match is not None
    host = match[2].strip("[]")
    try:
        ip_address(host)
    except ValueError:
        # Time for which a host that was not found is not looked for again.
        if time.monotonic() - _not_found.get(host, -math.inf) < 1.0 or not _found(host):
            return f": there is no host {host}"
    return ""


def _found(host: str) -> bool:
    """Return whether `host` has an address, after `RESOLVE_S_MAX` at most."""
    found: list[bool] = []
    lookup = Thread(target=lambda: found.append(_resolves(host)), daemon=True)
    lookup.start()
    lookup.join(RESOLVE_S_MAX)
    if found != [True]:
        _not_found[host] = time.monotonic()
    return found == [True]


def _resolves(host: str) -> bool:
    try:
        return bool(socket.getaddrinfo(host, None))
    except (OSError, UnicodeError):
        return False
