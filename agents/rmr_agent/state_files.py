"""The files of a durable robot's folder (`state_folder`): their names, and how they are written whole."""

import os
import re
from pathlib import Path
from typing import Final

from rmr.mind.segments import superfluous

JOURNAL: Final = "journal"
"""The first segment of the journal."""
PROGRAM: Final = "program.rbc"
SEGMENTS: Final = re.compile(r"journal(?:-([1-9][0-9]{0,8}))?")
SNAPSHOTS: Final = re.compile(r"snapshot-([1-9][0-9]{0,8})")
"""Names of files, with the number."""


def segment_name(number: int) -> str:
    """Return the name of a segment's file."""
    return f"{JOURNAL}-{number}" if number else JOURNAL


def snapshot_name(number: int) -> str:
    """Return the name of the file of the snapshot before a segment."""
    return f"snapshot-{number}"


def listed(folder: Path, names: re.Pattern[str]) -> dict[int, Path]:
    """Return the files with such names, by number. Raises OSError."""
    found = [(match, path) for path in folder.iterdir() if (match := names.fullmatch(path.name))]
    return {int(match[1] or 0): path for match, path in found}


def read_files(folder: Path, names: re.Pattern[str]) -> dict[int, bytes]:
    """Return the contents of the files with such names that are not empty, by number. Raises OSError."""
    return {number: data for number, path in listed(folder, names).items() if (data := path.read_bytes())}


def remove_superfluous(folder: Path) -> None:
    """Remove the segments and snapshots before the two newest snapshots. Raises OSError."""
    segments, snapshots = listed(folder, SEGMENTS), listed(folder, SNAPSHOTS)
    old_segments, old_snapshots = superfluous(segments, {n: path.read_bytes() for n, path in snapshots.items()})
    for path in [*(snapshots[number] for number in old_snapshots), *(segments[number] for number in old_segments)]:
        path.unlink()


def begun_file(path: Path, data: bytes, *, synced: bool) -> int:
    """Write a file that gets its name when it is whole; return its descriptor, for appending. Raises OSError."""
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    descriptor = os.open(new, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
    try:
        if os.write(descriptor, data) < len(data):
            raise OSError(28, os.strerror(28))
        if synced:
            os.fdatasync(descriptor)
        new.rename(path)
        if synced:
            sync_folder(path.parent)
    except OSError:
        os.close(descriptor)
        new.unlink(missing_ok=True)
        raise
    return descriptor


def sync_folder(folder: Path) -> None:
    """Let the names in a folder survive a loss of power. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
