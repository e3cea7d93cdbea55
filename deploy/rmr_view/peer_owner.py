"""Whose program is at the other end of a loopback connection: other users of the machine may not look at a run.

Every user can connect to a loopback port. On Linux `/proc/net/tcp` names the owner of each socket (proc(5)); elsewhere,
and where a connection is not listed, nothing is known, and nobody is kept out by this.
"""

import os
import struct
from pathlib import Path

TABLE = Path("/proc/net/tcp")
ROOT = 0
"""The superuser can read everything anyway; sockets without an owner, such as closed ones, show it, too."""
LOCAL, REMOTE, OWNER = 1, 2, 7
"""Columns of the table."""


def is_stranger(host: str, port: int, own_port: int) -> bool:
    """Return whether the client at `host`:`port` of the server at `own_port` belongs to another user."""
    owner = owner_of(host, port, own_port)
    return owner is not None and owner not in {ROOT, os.geteuid()}


def owner_of(host: str, port: int, own_port: int) -> int | None:
    """Return the user id of the client's socket; None if it is not known."""
    try:
        address = _hexadecimal(host)
        lines = TABLE.read_text().splitlines()
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
