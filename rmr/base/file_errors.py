"""Errors of files that name the file: Python names one that cannot be opened, not one that a full disk cuts short."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def disk_of(path: Path) -> Path:
    """Return where the disk is mounted on which `path` is, or would be."""
    whole = path.resolve()
    return next(folder for folder in (whole, *whole.parents) if os.path.ismount(folder))


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let an OSError from within name `path`, whatever file it came from."""
    try:
        yield
    except OSError as error:
        error.filename = os.fspath(path)
        raise
