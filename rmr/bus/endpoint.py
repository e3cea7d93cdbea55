"""Endpoints: where a router listens, as people write it. Imports no zenoh, so that help costs little."""

import re

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a world listens and a robot connects unless told otherwise."""

ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws)/(\[[0-9A-Fa-f:.]+\]|[^\s/:\[\]]+):(\d{1,5})")


class BusError(Exception):
    """The bus cannot be used as asked; the message says why and what to do."""


def check_endpoint(endpoint: str) -> str:
    """Return `endpoint` if it is one. Raises BusError."""
    match = ENDPOINT.fullmatch(endpoint)
    if not match or not 0 < int(match[3]) < 65536:
        raise BusError(f"'{endpoint}' is no endpoint: expected PROTOCOL/HOST:PORT, for example {DEFAULT_ENDPOINT}")
    return endpoint
