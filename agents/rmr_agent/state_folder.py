"""The folder of a durable robot: its journal, and the lock that keeps a second process out.

The folder holds `journal` (`rmr.mind.journal`) and `lock`, which names the process that has it. The lock is the
kernel's (flock): it ends with the process, however that ends.
"""

import errno
import fcntl
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rmr.mind.journal import DurableState, Journal, JournalError, JournalHeader, ReadJournal, read_journal
from rmr.mind.mind_header import decode_header, encode_header
from rmr.mind.mind_versions import differences
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import NodeConfig
from rmr_agent.bytecode import Loaded, RefusedError

JOURNAL: Final = "journal"
LOCK: Final = "lock"
DURABILITIES: Final = ("process", "power")
"""What the state survives: the end of the process, or of the machine's power, too."""
ANEW: Final = "begin anew with an empty folder"

log = logging.getLogger("rmr")


class StateRefusedError(RefusedError):
    """The folder cannot be used; the message says why and what to do."""


class StateFullError(OSError):
    """The state cannot be written any more; the message says where and why."""

    def __str__(self) -> str:
        """Return the message, without the number."""
        return str(self.args[1])


class _AppendedFile:
    """A file that is written at its end (`rmr.mind.journal.JournalFile`)."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self._descriptor = descriptor

    def append(self, data: bytes) -> None:
        """Write `data` at the end. Raises StateFullError."""
        try:
            written = os.write(self._descriptor, data)
        except OSError as error:
            raise self._full(error) from None
        if written < len(data):
            raise self._full(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))

    def sync(self) -> None:
        """Wait until the disk has it. Raises StateFullError."""
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            raise self._full(error) from None

    def _full(self, error: OSError) -> StateFullError:
        return StateFullError(
            error.errno or errno.EIO,
            f"the robot's state cannot be written to {self.path}: {error.strerror}; "
            "the robot has stopped before anything left it that is not on disk",
        )


class StateFolder:
    """One robot's folder, locked by this process."""

    def __init__(self, path: Path, robot: int, program: int, durability: str) -> None:
        """Take the folder of `robot`, which runs the `program` of this digest. Raises StateRefusedError."""
        self.path = path
        self._robot = robot
        self._program = program
        self._synced = durability == "power"
        self._file: int | None = None
        self._lock = -1
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            self._take_lock()
            if (path / JOURNAL).exists():
                self._file = self._open(path / JOURNAL)
            data = b"" if self._file is None else (path / JOURNAL).read_bytes()
        except OSError as error:
            self.close()
            raise StateRefusedError(f"--state {path}: {error.strerror or error}") from None
        self.found: ReadJournal = read_journal(data)
        """What the folder held."""
        self.header: JournalHeader | None = None
        """The header of the journal; None if the robot begins."""
        self.config: NodeConfig | None = None
        """The configuration with which the robot began."""
        try:
            self._check(data)
        except JournalError as error:
            self.close()
            raise self._refused(str(error)) from None

    def _refused(self, why: str) -> StateRefusedError:
        return StateRefusedError(f"--state {self.path}: {why}; {ANEW}, or give another one")

    def _take_lock(self) -> None:
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(self._lock, 32, 0).decode("ascii", "replace").strip()
            by = f" (process {holder})" if holder.isdigit() else ""
            self.close()
            raise StateRefusedError(
                f"--state {self.path}: another robot's process uses the folder{by}; end it, or give another folder"
            ) from None
        os.ftruncate(self._lock, 0)
        os.pwrite(self._lock, f"{os.getpid()}\n".encode(), 0)

    @staticmethod
    def _open(path: Path) -> int:
        return os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)

    def _check(self, data: bytes) -> None:
        """Raise JournalError if the journal is none that this robot can go on from."""
        self.header = header = self.found.header
        if header is None:
            if data:  # the first record is there before the file has its name: it was not torn
                raise JournalError("its journal is damaged at the beginning, and nothing of it can be read")
            return
        if header.robot != self._robot:
            raise JournalError(f"it holds the state of robot {header.robot}, not {self._robot}")
        if header.program != self._program:
            raise JournalError(
                f"it holds the state of another program (digest {header.program:08x}, this one has {self._program:08x})"
            )
        try:
            mind = decode_header(header.mind)
        except ValueError as error:
            raise JournalError(str(error)) from None
        if changed := differences(mind.versions):
            what, recorded, here = changed[0]
            raise JournalError(f"it was written by another version: {what} {recorded}, here {here}")
        self.config = mind.config

    def taken_up(self, header: JournalHeader, config: NodeConfig) -> tuple[NodeConfig, DurableState]:
        """Return the configuration and the records with which the robot goes on, or begins by `header` and `config`.

        Raises StateRefusedError if the state is of another lab or run, whose lab time is another one.
        """
        held = self.header
        if held is not None and held.lab != header.lab:
            raise self._refused(f"it holds the state of a robot of lab {held.lab}, not {header.lab}")
        if held is not None and held.run != header.run:
            raise self._refused(f"it holds the state of an earlier run of lab {held.lab}, whose time is another one")
        if self.found.dropped:
            log.warning("%s", self.dropped)
        return self.config or config, DurableState(self._journal(header), self.found.records)

    def _journal(self, header: JournalHeader) -> Journal:
        """Return the journal behind what could be read; `header` begins it if there is none.

        Raises StateRefusedError if it cannot be written.
        """
        path = self.path / JOURNAL
        try:
            if self._file is None:
                return self._begin(path, header)
            os.ftruncate(self._file, self.found.whole)
        except OSError as error:
            raise StateRefusedError(f"--state {self.path}: {error.strerror or error}") from None
        return Journal(_AppendedFile(path, self._file), synced=self._synced, crc=self.found.crc)

    def _begin(self, path: Path, header: JournalHeader) -> Journal:
        """Write the header into a file that gets its name when it is whole. Raises OSError."""
        new = path.with_suffix(".new")
        new.write_bytes(b"")
        self._file = self._open(new)
        self.header = header
        journal = Journal(_AppendedFile(path, self._file), synced=self._synced)
        journal.header(header)
        new.rename(path)
        if self._synced:
            self._sync_folder()
        return journal

    def _sync_folder(self) -> None:
        folder = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    @property
    def dropped(self) -> str:
        """What of the journal was dropped, in words; empty if nothing was."""
        if not self.found.dropped:
            return ""
        what = f"{self.path / JOURNAL}: the last {self.found.dropped} octets are no whole record and are dropped; "
        if self.found.torn:
            return what + "the robot died while it wrote them, before anything came of them"
        return what + (
            "the file is damaged there: the robot goes on from an older state, and others may take what it sends for "
            "what they have; begin the run anew where that matters"
        )

    def close(self) -> None:
        """Leave the folder to others."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def begun_header(
    config: NodeConfig, loaded: Loaded, handlers: Mapping[str, Handler], payload_max: int, lab: str, run: int
) -> JournalHeader:
    """Return the header of the journal of a robot that begins in this process."""
    mind = encode_header(
        config,
        loaded.digest,
        handlers,
        payload_max=payload_max,
        bodily=True,
        timed=True,
        neighbors=False,
        witnessed=False,
    )
    return JournalHeader(config.robot, lab, run, loaded.digest, False, mind)
