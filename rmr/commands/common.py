"""Shared functions of the subcommands: octets on stdout, and atomic writes of files."""
# ruff: noqa: PLC0415 - see rmr.commands

import os
import sys
from pathlib import Path

from rmr.entry import ExitCode


def print_octets(octets: bytes) -> None:
    """Write `octets` to stdout as they are."""
    sys.stdout.flush()
    sys.stdout.buffer.write(octets)


def reason(error: Exception) -> str:
    """Return why a file could not be read or written."""
    return getattr(error, "strerror", None) or str(error)


def write(target: Path, octets: bytes, mode: int | None = None) -> int:
    """Write `target` atomically, with the permissions `mode` or those of a new file; return the exit code.

    A symbolic link is followed; a device or pipe is written to in place.
    """
    import tempfile

    temporary = ""
    try:
        target = target.resolve()
        if target.exists() and not target.is_file() and not target.is_dir():
            target.write_bytes(octets)
            return 0
        descriptor, temporary = tempfile.mkstemp(prefix=".rmr-", dir=target.parent)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(octets)
        os.chmod(temporary, 0o666 & ~_umask() if mode is None else mode)
        os.replace(temporary, target)
    except (OSError, ValueError) as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        print(f"{target}: error: {reason(error)}", file=sys.stderr)
        return ExitCode.FAILED
    return 0


def _umask() -> int:
    """Return the process's umask, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
