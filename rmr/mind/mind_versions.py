"""What a replay depends on beside the log: the sources of rmr, Python, the platform's floating point.

Two runs of one log are equal if these are equal. Whether modules are compiled makes no difference; it is kept for
information only.
"""

import hashlib
import platform
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Final

import rmr
from rmr.base import time as some_module

PARTS: Final = ("analysis", "base", "bytecode", "coord", "mind", "node", "radio", "vm")
"""The parts of rmr whose sources decide what a mind does, or what its log means."""

TITLES: Final = {
    "rmr": "version of rmr",
    "sources": "sources of rmr",
    "python": "Python",
    "system": "operating system",
    "machine": "processor",
    "libc": "C library",
}
"""What each entry of `versions` is, in words."""


@cache
def versions() -> dict[str, str]:
    """Return what a replay depends on."""
    return {
        "rmr": rmr.__version__,
        "sources": source_digest(),
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "system": platform.system(),
        "machine": platform.machine(),
        "libc": " ".join(platform.libc_ver()).strip(),
    }


@cache
def source_digest() -> str:
    """Return the BLAKE2b digest of the sources of PARTS, with their names."""
    root = Path(rmr.__file__).parent
    return digest_of(root / part for part in PARTS)


def digest_of(packages: Iterable[Path]) -> str:
    """Return the BLAKE2b digest of the Python sources in some packages, with their names."""
    digest = hashlib.blake2b(digest_size=8)
    for package in packages:
        for path in sorted(package.rglob("*.py")):
            digest.update(path.relative_to(package.parent).as_posix().encode() + b"\0")
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()


def is_compiled() -> bool:
    """Return whether the hot modules are compiled."""
    return not str(some_module.__file__).endswith(".py")


def differences(recorded: dict[str, str]) -> list[tuple[str, str, str]]:
    """Return (what, recorded, here) for each entry of `versions` in which this process differs."""
    here = versions()
    return [
        (TITLES[name], recorded.get(name, "unknown"), here[name]) for name in TITLES if recorded.get(name) != here[name]
    ]
