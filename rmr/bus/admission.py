"""The reason for which a client gets no session at an endpoint, for an error message.

zenoh reports a refusal and a missing router in the same words, "unable to connect". So the endpoint is
asked once more, with the first message of zenoh's handshake (InitSyn, protocol version 9) and no credentials. A router
with a secret answers with Close, one without with InitAck, any other program with something else. What answers nothing
in time may be either: another program, or a world whose process is stopped, or busy, or far away.

With keys a handshake of TLS is made instead, with Python's `ssl` and the same files. It shows the certificate of the
listener, and its alert, which zenoh does not tell.
"""

import contextlib
import ipaddress
import os
import socket
import ssl
from datetime import UTC, datetime
from typing import Final

from rmr.bus.certificates import (
    CA_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    LISTENERS,
    Certificate,
    CertificateError,
    Credentials,
    holder_of,
    moment,
    parsed,
    problem,
    read_certificate,
    read_file,
)
from rmr.bus.endpoint import ENDPOINT, host_and_port, host_problem
from rmr.bus.secret import SECRET_FILE, Secret

ANSWER_S: Final = 0.5
"""Limit for a program at an endpoint to accept the connection, and then to answer."""

FOREIGN: Final = -1
SILENT: Final = -2
TLS: Final = -3
"""In place of a kind of message: what no router says, nothing within `ANSWER_S`, and an alert of TLS."""

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


TLS_ANSWER_S: Final = 1.0
"""Limit for each step of a handshake of TLS. A listener that has said nothing for as long does not refuse."""

ALERTS: Final = {
    "CERTIFICATE_EXPIRED": "takes the certificate of this process for expired, so the clocks differ: here it is {now}",
    "CERTIFICATE_REQUIRED": "wants a certificate, and this process has none",
    "UNKNOWN_CA": "has another CA than this process: take the keys of both from one rmr keys init",
    "DECRYPT_ERROR": "has another CA than this process: take the keys of both from one rmr keys init",
    "BAD_CERTIFICATE": "takes the certificate of this process for a bad one; here it is {now}",
}
"""End of the name of a TLS alert -> what a listener that sends it means."""


def refusal(endpoint: str, secret: Credentials | None) -> str | None:
    """Return why a client with this `secret` is not let in at `endpoint`, and what to do; None where it is not refused.

    None, too, where nobody answers, no router does, or the protocol is neither plain TCP nor TLS.
    """
    if isinstance(secret, Certificate):
        without = f"what listens at {endpoint} has no keys: start it with --keys, too, or this process without"
        return _tls_refusal(endpoint, secret) or (without if _first_answer(endpoint) in {INIT, CLOSE} else None)
    kind = _first_answer(endpoint)
    if kind == TLS:
        return (
            f"{endpoint} lets in processes with keys alone: connect to tls/{endpoint.partition('/')[2]} "
            "with --keys DIR, which rmr keys bundle writes"
        )
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

    None where nobody accepts the connection, or the protocol is neither TCP nor TLS.
    """
    match = ENDPOINT.fullmatch(endpoint)
    if match is None or match[1] not in {"tcp", "tls"}:
        return None
    asked = bytes([INIT, VERSION, (ID_OCTETS - 1) << 4 | CLIENT]) + os.urandom(ID_OCTETS)
    try:
        connection = socket.create_connection((match[2].strip("[]"), int(match[3])), ANSWER_S)
    except OSError:
        return None
    with connection:
        try:
            connection.sendall(len(asked).to_bytes(LENGTH_OCTETS, "little") + asked)
            # An InitAck has some 75 octets, a Close has 2.
            answer = connection.recv(1024)
        except TimeoutError:
            return SILENT
        except OSError:
            return FOREIGN
    if answer.startswith(b"\x15\x03"):  # first octets of what a program that expects TLS answers to anything else
        return TLS
    length = int.from_bytes(answer[:LENGTH_OCTETS], "little")
    whole = length and len(answer) == LENGTH_OCTETS + length
    return answer[LENGTH_OCTETS] & MESSAGE if whole else FOREIGN


# --- TLS


def _tls_refusal(endpoint: str, own: Certificate) -> str | None:
    """Return why no session opens at a valid `endpoint`, as far as a handshake shows; None where it does not.

    Takes three times `TLS_ANSWER_S` at most.
    """
    try:
        read_certificate(own.folder)  # it may have expired since it was read
    except CertificateError as error:
        return str(error)
    host, port = host_and_port(endpoint)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE  # it is judged below, in words
    context.load_cert_chain(own.folder / CERTIFICATE_FILE, own.folder / KEY_FILE)
    try:
        connection = socket.create_connection((host, port), TLS_ANSWER_S)
    except OSError:
        return None
    with connection:
        try:
            secured = context.wrap_socket(connection)
        except TimeoutError:
            return None
        except OSError:
            return f"what listens at {endpoint} does not speak TLS: it is another program, or a router without keys"
        with secured:
            octets = secured.getpeercert(binary_form=True)
            if octets is not None and (wrong := _wrong_listener(octets, host, own)):
                return f"what listens at {endpoint} is no router of this lab: {wrong}"
            alert = _alert(secured)
            return None if alert is None else f"what listens at {endpoint} {alert}"


def _wrong_listener(octets: bytes, host: str, own: Certificate) -> str:
    """Return what is wrong with the certificate of a listener that was to be `host`; nothing where it is good."""
    from cryptography import x509  # noqa: PLC0415

    certificate = x509.load_der_x509_certificate(octets)
    try:
        holder = holder_of(certificate)
    except ValueError as error:
        return f"its certificate is none of rmr keys issue ({error})"
    if wrong := problem(certificate, parsed(read_file(own.folder, CA_FILE), own.folder / CA_FILE), datetime.now(UTC)):
        return wrong
    if holder.role not in LISTENERS:
        return f"it has the certificate of {holder}, which may not listen"
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    known = [*names.get_values_for_type(x509.DNSName), *map(str, names.get_values_for_type(x509.IPAddress))]
    with contextlib.suppress(ValueError):
        host = str(ipaddress.ip_address(host))
    if host.lower() in known:
        return ""
    return f"its certificate is for {', '.join(known)} and not for {host}; issue it with --host {host}, too"


def _alert(secured: ssl.SSLSocket) -> str | None:
    """Return what a listener means that refuses this process after the handshake; None where it does not."""
    try:
        secured.settimeout(TLS_ANSWER_S)
        secured.recv(1)
    except ssl.SSLError as error:
        alert = str(error.reason)
        meant = next((words for end, words in ALERTS.items() if alert.endswith(end)), f"refuses this process: {alert}")
        return meant.format(now=moment(datetime.now(UTC)))
    except OSError:  # silence: it waits for the first message
        return None
    return None
