"""The reason for which a client gets no session at an endpoint, for an error message.

zenoh reports a refusal and a missing router in the same words, "unable to connect". So the endpoint is
asked once more, with the first message of zenoh's handshake (InitSyn, protocol version 9) and no credentials. A router
with a secret answers with Close, one without with InitAck, any other program with something else. What answers nothing
in time may be either: another program, or a world whose process is stopped, or busy, or far away.
"""

import os
import socket
from typing import Final

from rmr.bus.endpoint import ENDPOINT, host_problem
from rmr.bus.secret import SECRET_FILE, Secret

ANSWER_S: Final = 0.5
"""Limit for a program at an endpoint to accept the connection, and then to answer."""

FOREIGN: Final = -1
SILENT: Final = -2
"""In place of a kind of message: what no router says, and nothing within `ANSWER_S`."""

ID_OCTETS: Final = 16
"""Length of a session's id, which is drawn at random."""

INIT: Final = 0x01
CLOSE: Final = 0x03
MESSAGE: Final = 0x1F
"""Kinds of message in zenoh's handshake, and the bits of the first octet that say which it is."""

VERSION: Final = 9

CLIENT: Final = 2
"""The role that this client claims in the handshake."""

LENGTH_OCTETS: Final = 2
"""Length of the length field, little-endian, before each message on TCP."""


ANSWER_OCTETS_MAX: Final = 1024
"""Octets of an answer that are read at most: an InitAck has some 75, a Close has 2."""


def refusal(endpoint: str, secret: Secret | None) -> str | None:
    """Return why a client with this `secret` is not let in at `endpoint`, and what to do; None where it is not refused.

    None, too, where nobody answers, no router does, or the protocol is not plain TCP.
    """
    kind = _first_answer(endpoint)
    if kind == CLOSE and secret is None:
        return (
            f"{endpoint} does not let this process in: it has a secret, so name the file with --secret "
            f"(of rmr up: {SECRET_FILE} in its run folder)"
        )
    if kind == CLOSE and secret is not None:
        return (
            f"{endpoint} does not let this process in: it has another secret than the one in {secret.file}, "
            "so name the file of that lab with --secret"
        )
    if kind == INIT and secret is not None:
        return (
            f"what listens at {endpoint} has no secret: start it with --secret {secret.file}, or this process without"
        )
    return None


def why_no_session(endpoint: str) -> str:
    """Return why no session opens at a valid endpoint, as far as it shows there, `: ` before it; else nothing.

    Takes `RESOLVE_S_MAX` and twice `ANSWER_S` at most.
    """
    if problem := host_problem(endpoint):
        return problem
    kind = _first_answer(endpoint)
    if kind == FOREIGN:
        return ": a program listens there that does not answer as a world does; choose another endpoint"
    if kind == SILENT:
        return (
            f": what listens there has not answered within {ANSWER_S:g} s; it is a world that is stopped or busy, "
            "or another program"
        )
    return ""


def impostor(endpoint: str, secret: Secret) -> str:
    """Return the message for a router that admits every client but does not know the secret."""
    return (
        f"what listens at {endpoint} does not know the secret in {secret.file}: it is no world or router of this lab, "
        "so find out which program it is, or choose another endpoint"
    )


def _first_answer(endpoint: str) -> int | None:
    """Return the kind of message that is answered to an InitSyn, `FOREIGN` or `SILENT`.

    None where nobody accepts the connection, or the protocol is not plain TCP.
    """
    match = ENDPOINT.fullmatch(endpoint)
    if match is None or match[1] != "tcp":
        return None
    asked = bytes([INIT, VERSION, (ID_OCTETS - 1) << 4 | CLIENT]) + os.urandom(ID_OCTETS)
    try:
        connection = socket.create_connection((match[2].strip("[]"), int(match[3])), ANSWER_S)
    except OSError:
        return None
    with connection:
        try:
            connection.sendall(len(asked).to_bytes(LENGTH_OCTETS, "little") + asked)
            answer = connection.recv(ANSWER_OCTETS_MAX)
        except TimeoutError:
            return SILENT
        except OSError:
            return FOREIGN
    length = int.from_bytes(answer[:LENGTH_OCTETS], "little")
    whole = length and len(answer) == LENGTH_OCTETS + length
    return answer[LENGTH_OCTETS] & MESSAGE if whole else FOREIGN
