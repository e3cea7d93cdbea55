"""The state of a durable world: one file in a folder of its own, written anew every 100 ms of lab time.

It holds what robots know the world by, and what they rely on: the run, lab time, where the bodies are and what their
encoders show, the lives of each robot, and what `rmr fault` has added. A world that is killed and started again goes on
from it as the same run. Lab time resumes at the latest instant that any robot can have been told, so it never goes
back; the bodies are where they were up to 100 ms before, and stand, which their encoders show.

The folder belongs to the process that has locked it (flock), so to one world at a time.
"""

import fcntl
import hashlib
import json
import os
from pathlib import Path
from typing import Any, Final

from rmr.bus import checks, wire
from rmr.bus.checks import MalformedError

STATE: Final = "world.json"
LOCK: Final = "lock"
VERSION: Final = 1
ANEW: Final = "begin anew with an empty folder"
SAVE_EVERY: Final = 6
"""The state is written at every sixth tick: 10 times a second."""

_BODY = checks.group(checks.robot, *[checks.number] * 6, checks.instant)
_LIFE = checks.group(checks.count, checks.optional(checks.instant))
_CONTACT = checks.group(checks.instant, checks.robot, checks.optional(checks.robot), checks.number, checks.number)
_HELD = checks.fields(
    {
        "version": checks.count,
        "lab": checks.text,
        "run": checks.count,
        "runs": checks.flag,
        "tick": checks.count,
        "here": checks.each(checks.robot),
        "bodies": checks.each(_BODY),
        "collisions": checks.count,
        "contacts": checks.each(_CONTACT),
        "closest_m": checks.optional(checks.number),
        "lives": checks.each(checks.group(checks.robot, checks.each(_LIFE))),
        "added": checks.each(checks.disturbance),
        "late": checks.count,
        "set_back": checks.count,
    }
)


class WorldStateError(Exception):
    """The folder cannot be used; the message says why and what to do."""


def lab_digest(known: wire.Map) -> str:
    """Return what distinguishes one configuration of a run from another: lab file, seed, number of robots."""
    return hashlib.blake2s(repr(known).encode(), digest_size=16).hexdigest()


class WorldFolder:
    """The folder of a durable world."""

    def __init__(self, path: Path, known: wire.Map) -> None:
        """Make the folder if there is none, lock it and read what it holds of the lab `known`.

        Raises WorldStateError, and OSError, which names the file.
        """
        self.path = path
        self._digest = lab_digest(known)
        path.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise WorldStateError(f"{path}: another world has this state; end it, or name another folder") from None
        self.held = self._read()
        """What it holds, checked; None if it is new."""

    def _read(self) -> dict[str, Any] | None:
        file = self.path / STATE
        try:
            held: dict[str, Any] = _HELD(json.loads(file.read_bytes()))
        except FileNotFoundError:
            return None
        except (ValueError, RecursionError) as error:
            what = error if isinstance(error, MalformedError) else "not JSON"
            raise WorldStateError(f"{file}: no state of a world ({what}); {ANEW}") from None
        if held["version"] != VERSION:
            raise WorldStateError(f"{file}: of another version of rmr; {ANEW}")
        if held["lab"] != self._digest:
            raise WorldStateError(f"{file}: of another lab, seed or number of robots than this world's; {ANEW}")
        return held

    def close(self) -> None:
        """Give up the lock."""
        os.close(self._lock)

    def write(self, state: dict[str, Any]) -> None:
        """Replace what it holds. Raises OSError, which names the file."""
        new = self.path / f"{STATE}.new"
        new.write_text(json.dumps({"version": VERSION, "lab": self._digest, **state}, allow_nan=False))
        new.replace(self.path / STATE)
