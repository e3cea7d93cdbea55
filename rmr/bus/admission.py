"""Why a router does not let a client in, in words for people.

zenoh tells a client that is refused the same as one that finds nobody: it is "unable to connect". A refusal is what
is left when the endpoint accepts a connection and the handshake fails at once.
"""

import contextlib
import socket
from typing import Final

from rmr.bus.endpoint import ENDPOINT
from rmr.bus.secret import SECRET_FILE, Secret

CONNECT_S: Final = 0.5
"""How long an endpoint may take to accept a connection."""

ON_TCP: Final = ("tcp", "tls", "ws")
"""Protocols in which a connection is accepted before the handshake; in others a refusal is not recognised."""

OTHERWISE: Final = "if another program listens there, choose another endpoint"


def accepts(endpoint: str) -> bool:
    """Whether a process accepts connections at `endpoint`; False where the protocol does not tell."""
    match = ENDPOINT.fullmatch(endpoint)
    if match is None or match[1] not in ON_TCP:
        return False
    with contextlib.suppress(OSError), socket.create_connection((match[2].strip("[]"), int(match[3])), CONNECT_S):
        return True
    return False


def without(endpoint: str) -> str:
    """Return the words for a client without a secret that is refused."""
    return (
        f"{endpoint} does not let this process in: its world has a secret, so name the file with --secret "
        f"(of rmr up: {SECRET_FILE} in its run folder); {OTHERWISE}"
    )


def wrong(endpoint: str, secret: Secret) -> str:
    """Return the words for a client with a secret that is refused."""
    return (
        f"{endpoint} does not let this process in: its world has another secret than the one in {secret.file}, "
        f"so name the file of that world with --secret; {OTHERWISE}"
    )


def needless(endpoint: str, secret: Secret) -> str:
    """Return the words for a client with a secret whose world has none."""
    return f"the world at {endpoint} has no secret: start it with --secret {secret.file}, or this process without"


def impostor(endpoint: str, secret: Secret) -> str:
    """Return the words for a router that lets everybody in but does not know the secret."""
    return (
        f"what listens at {endpoint} does not know the secret in {secret.file}: it is not the world, "
        "so find out which program it is, or choose another endpoint"
    )
