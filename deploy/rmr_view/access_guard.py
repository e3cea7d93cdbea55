"""Who may talk to the page's server: checks of Host, Origin and token, before any route runs.

The server listens on loopback, which every program of the machine can reach, the browser included, and with it every
web page that is open in it.

- *User*: the client must belong to the user who serves the page, for every user can connect to a loopback port. On
  Linux `/proc/net/tcp` names the owner of each socket (proc(5)). Elsewhere, and where a connection is not listed,
  nothing is known, and nobody is kept out by this.
- *Host* must be a loopback name with the server's port. Against DNS rebinding: a hostile name that is resolved to
  127.0.0.1 arrives with that name as its Host.
- *Origin*, where there is one, must be the page's own. Against other pages: requests across origins carry theirs, and
  a WebSocket is opened without asking the server first.
- *Token* (orders only): a random number that is printed with the address, in its fragment, which browsers do not send.
"""

import hmac
import os
import struct
from collections.abc import Iterable
from pathlib import Path
from secrets import token_urlsafe

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
"""Names under which the page may be opened."""
TOKEN_HEADER = "x-rmr-token"
SOCKET_TABLE = Path("/proc/net/tcp")
LOCAL, REMOTE, OWNER = 1, 2, 7
"""Columns of that table."""


def new_token() -> str:
    """Return a token nobody can guess: 128 bits."""
    return token_urlsafe(16)


class AccessGuard:
    """The checks of one server."""

    def __init__(self, port: int, token: str | None) -> None:
        """`port` is the server's; without `token` all orders are refused."""
        self._port = port
        self._hosts = frozenset(f"{name}:{port}" for name in LOOPBACK) | (frozenset(LOOPBACK) if port == 80 else set())
        self._token = token

    def refusal(self, headers: Iterable[tuple[bytes, bytes]], client: tuple[str, int] | None = None) -> str | None:
        """Return why a request or a WebSocket with these headers is refused; None if it is not.

        `client` is its address and port.
        """
        if client is not None and is_stranger(*client, self._port):
            return "this page belongs to another user of this machine"
        told = {name: value.decode("latin-1") for name, value in headers}
        host = told.get(b"host", "")
        if host not in self._hosts:
            return f"this page answers only to the host names {', '.join(LOOPBACK)}, not to {host!r:.80}"
        origin = told.get(b"origin")
        if origin is not None and origin.removeprefix("http://") not in self._hosts:
            return f"requests of other pages are refused, such as of {origin!r:.80}"
        return None

    def order_refusal(self, token: str | None) -> str | None:
        """Return why an order with `token` is refused; None if it is not."""
        if self._token is None:
            return "orders are refused: the page was started without --control"
        if token is None or not hmac.compare_digest(token.encode(), self._token.encode()):
            return "the token is missing or wrong: open the page by the whole address that was printed"
        return None


# --- whose program is at the other end


def is_stranger(host: str, port: int, own_port: int) -> bool:
    """Return whether the client at `host`:`port` of the server at `own_port` belongs to another user."""
    owner = owner_of(host, port, own_port)
    # The superuser can read everything anyway; sockets without an owner, such as closed ones, show it, too.
    return owner is not None and owner not in {0, os.geteuid()}


def owner_of(host: str, port: int, own_port: int) -> int | None:
    """Return the user id of the client's socket; None if it is not known."""
    try:
        address = _hexadecimal(host)
        lines = SOCKET_TABLE.read_text().splitlines()
    except (OSError, ValueError):
        return None
    local = f"{address}:{port:04X}"
    remote_port = f":{own_port:04X}"
    for line in lines:
        if local in line:
            columns = line.split()
            if columns[LOCAL] == local and columns[REMOTE].endswith(remote_port):
                return int(columns[OWNER])
    return None


def _hexadecimal(host: str) -> str:
    """Return an IPv4 address as the table has it: in the byte order of the machine. Raises ValueError."""
    octets = bytes(map(int, host.split(".")))
    if len(octets) != 4:
        raise ValueError(host)
    return f"{struct.unpack('=I', octets)[0]:08X}"
