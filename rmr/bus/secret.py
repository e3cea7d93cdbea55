"""The secret of a bus: the router refuses a session that does not know it.

zenoh authenticates a session once, when it opens (``transport/auth/usrpwd``): the router draws a number, the client
answers with an HMAC of the password under it, and the password does not travel. Messages carry nothing for it.

A client does not learn from that whether the router knows the secret, too. The router's id, which zenoh lets the
router choose, therefore proves it: one half is drawn, the other follows from that and the secret. A program that takes
the endpoint before the world does cannot make such an id; whoever has seen that of an earlier router can show it again.
Routers of one secret have different ids, for zenoh connects no two of the same id.

The file is what zenoh calls a dictionary: one line ``NAME:PASSWORD``. Nothing here ever shows the password.
"""

import hashlib
import hmac
import os
import re
import secrets
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rmr.base.file_errors import naming
from rmr.bus.endpoint import BusError

SECRET_FILE: Final = "secret"
"""Name of the file with the secret in a run folder."""

USER: Final = "rmr"
"""User name in the files that rmr writes; a file written by hand may have another."""

ROUTER_ID: Final = re.compile("1([0-9a-f]{15})([0-9a-f]{16})")
"""What is drawn of a router's id, and what proves the secret. The first digit of an id must not be 0."""

PASSWORD_OCTETS: Final = 32
"""Random octets of a password that rmr makes; it is written in hexadecimal."""

FILE_OCTETS_MAX: Final = 1024

LINE: Final = re.compile(r"([A-Za-z0-9_.-]+):([\x21-\x7e]{16,})\n?")
"""Format of a secret file; a shorter password could be guessed."""


class SecretError(BusError):
    """The file holds no secret, or not safely; the message says what is wrong and what to do."""


@dataclass(frozen=True, slots=True)
class Secret:
    """User name and password of a bus, and the file that they came from."""

    file: Path
    user: str = field(repr=False)
    password: str = field(repr=False)

    def router_id(self, name: str = "") -> str:
        """Return a new id for a router that knows the secret, or the one that a router of this `name` always has."""
        drawn = hashlib.blake2s(name.encode()).hexdigest() if name else secrets.token_hex(8)
        return f"1{drawn[:15]}{self._proof(drawn[:15])}"

    def is_known_to(self, router: str) -> bool:
        """Return whether the id `router` is that of a router that knows the secret."""
        match = ROUTER_ID.fullmatch(router)
        return match is not None and hmac.compare_digest(match[2], self._proof(match[1]))

    def _proof(self, drawn: str) -> str:
        key = hashlib.blake2s(self.password.encode(), person=b"rmr-id").digest()
        return hashlib.blake2s(drawn.encode(), key=key, digest_size=8).hexdigest()

    def client_settings(self) -> dict[str, str]:
        """Return the settings of zenoh for whoever connects, by key."""
        return {"transport/auth/usrpwd/user": self.user, "transport/auth/usrpwd/password": self.password}

    def router_settings(self, name: str = "", *, joins: bool = False) -> dict[str, str]:
        """Return the settings of zenoh for a router with the id of this `name`, by key; `joins`: it connects, too."""
        own = {"id": self.router_id(name), "transport/auth/usrpwd/dictionary_file": str(self.file)}
        return own | self.client_settings() if joins else own


def make_secret(path: Path) -> None:
    """Write a new secret to `path`, which does not exist yet, readable by its owner only.

    Raises OSError, which names the file; half a secret does not stay.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with naming(path), os.fdopen(descriptor, "w") as file:
            file.write(f"{USER}:{secrets.token_hex(PASSWORD_OCTETS)}\n")
    except OSError:
        path.unlink()
        raise


def read_secret(path: Path) -> Secret:
    """Return the secret in `path`. Raises SecretError, also when other users can read or change the file."""
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            octets = file.read(FILE_OCTETS_MAX + 1)
    except (OSError, ValueError) as error:
        raise SecretError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if stat.S_IMODE(mode) & 0o077:
        raise SecretError(f"{path}: other users may read or change this secret; run: chmod 600 {path}")
    match = LINE.fullmatch(octets.decode("ascii", errors="replace"))
    if match is None or len(octets) > FILE_OCTETS_MAX:
        raise SecretError(
            f"{path}: no secret: expected one line NAME:PASSWORD with a password of 16 characters or more, "
            "as rmr-world --secret makes it in a file that does not exist yet"
        )
    return Secret(path, match[1], match[2])
