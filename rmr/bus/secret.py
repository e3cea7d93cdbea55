"""The secret of a bus: the router refuses a session that does not know it.

zenoh authenticates a session once, when it opens (``transport/auth/usrpwd``): the router draws a number, the client
answers with an HMAC of the password under it, and the password does not travel. Messages carry nothing for it.

A client does not learn from that whether the router knows the secret, too. The router's id, which zenoh lets the
router choose, is therefore derived from the secret: a program that takes the endpoint before the world does cannot
know it. Whoever has seen the id of an earlier router of the same secret can.

The file is what zenoh calls a dictionary: one line ``NAME:PASSWORD``. Nothing here ever shows the password.
"""

import hashlib
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

    @property
    def router(self) -> str:
        """The id of a router that knows the secret: 32 hexadecimal digits, the first of which is not 0."""
        digest = hashlib.blake2s(self.password.encode(), digest_size=16, person=b"rmr-id").hexdigest()
        return f"1{digest[1:]}"

    def settings(self, *, is_router: bool) -> dict[str, str]:
        """Return the settings of zenoh, by key."""
        if is_router:
            return {"id": self.router, "transport/auth/usrpwd/dictionary_file": str(self.file)}
        return {"transport/auth/usrpwd/user": self.user, "transport/auth/usrpwd/password": self.password}


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
