"""The file with a lab's radio key: 32 hexadecimal digits, white space anywhere between them.

Nothing here, and nothing that reads a key, ever shows any part of it.
"""

from pathlib import Path
from typing import Final

from rmr.radio.security import KEY_OCTETS

FILE_OCTETS_MAX: Final = 1024
"""Greatest size of a key file: digits with room for groups and lines."""

_DIGITS: Final = frozenset(b"0123456789abcdefABCDEF")


class KeyFileError(Exception):
    """The file holds no key; the message says what is wrong and how to make one."""


def read_key(path: Path) -> bytes:
    """Return the key in `path`, 16 octets. Raises KeyFileError."""
    try:
        with path.open("rb") as file:
            octets = file.read(FILE_OCTETS_MAX + 1)
    except (OSError, ValueError) as error:
        raise _wrong(path, getattr(error, "strerror", None) or str(error)) from None
    if len(octets) > FILE_OCTETS_MAX:
        raise _wrong(path, f"more than {FILE_OCTETS_MAX} octets are no key")
    for number, line in enumerate(octets.split(b"\n"), 1):
        if not _DIGITS.issuperset(b"".join(line.split())):
            raise _wrong(path, f"line {number} has something else than hexadecimal digits")
    digits = b"".join(octets.split())
    if len(digits) != 2 * KEY_OCTETS:
        raise _wrong(path, f"{len(digits)} hexadecimal digits instead of {2 * KEY_OCTETS}")
    return bytes.fromhex(digits.decode())


def _wrong(path: Path, what: str) -> KeyFileError:
    return KeyFileError(f"{path}: {what}; to make a key: openssl rand -hex {KEY_OCTETS} > {path.name}")
