"""The files of a durable robot's folder (`state_folder`): their names, and how they are written whole.

The key of its snapshots lies elsewhere, where its user alone can read and write: one beside them would come along with
a folder that somebody else has made.
"""

import errno
import os
import re
from pathlib import Path
from typing import Final, NamedTuple

from rmr.bus.secret import make_secret, read_secret
from rmr.mind.segments import superfluous

JOURNAL: Final = "journal"
"""The first segment of the journal."""
PROGRAM: Final = "program.rbc"
SEGMENTS: Final = re.compile(r"journal(?:-([1-9][0-9]{0,8}))?")
SNAPSHOTS: Final = re.compile(r"snapshot-([1-9][0-9]{0,8})")
"""Names of files, with the number."""


def default_key_file() -> Path:
    """Return where a user's key of snapshots is. Raises FileNotFoundError for a user without a home."""
    states = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    if not os.path.isabs(states):
        raise FileNotFoundError(errno.ENOENT, "this user has no home folder", states)
    return Path(states) / "rmr" / "state.key"


class StateKey(NamedTuple):
    """The key of a robot's snapshots."""

    file: Path
    octets: bytes


def state_key(path: Path) -> StateKey:
    """Return the key in a file, which is made if it does not exist. Raises SecretError, OSError.

    Robots that start together take the same one: the file gets its name when it is whole, and only once.
    """
    if not path.exists():
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        new = path.with_name(f"{path.name}.{os.getpid()}.new")
        make_secret(new)
        try:
            os.link(new, path)
        except FileExistsError:
            pass
        finally:
            new.unlink()
    return StateKey(path, read_secret(path).password.encode())


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


def remove_superfluous(folder: Path, key: StateKey) -> None:
    """Remove the segments and snapshots before the two newest snapshots. Raises OSError."""
    segments, snapshots = listed(folder, SEGMENTS), listed(folder, SNAPSHOTS)
    read = {number: path.read_bytes() for number, path in snapshots.items()}
    old_segments, old_snapshots = superfluous(segments, read, key.octets)
    for path in [*(snapshots[number] for number in old_snapshots), *(segments[number] for number in old_segments)]:
        path.unlink()


def begun_file(path: Path, data: bytes, *, synced: bool) -> int:
    """Write a file that gets its name when it is whole; return its descriptor, for appending. Raises OSError."""
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    descriptor = os.open(new, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
    try:
        if os.write(descriptor, data) < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
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
