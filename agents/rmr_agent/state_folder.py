"""The folder of a durable robot: its journal and snapshots, and the lock that keeps a second process out.

    journal        the first segment of the journal (`rmr.mind.journal`); `journal-N` is segment N
    snapshot-N     the robot's state at the begin of segment N (`rmr.mind.snapshot`)
    program.rbc    the byte-code, for the process that takes snapshots
    lock           the process that has the folder. The lock is the kernel's (flock): it ends with the process

A file gets its name when it is whole. When a segment is closed, `SnapshotTaker` has the snapshot behind it taken by
another process; what is superfluous then is removed by this one, which has the lock.
"""

import errno
import fcntl
import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, TypeVar

from rmr.bus.secret import SecretError
from rmr.mind.journal import SEGMENT_OCTETS, DurableState, Journal, JournalError, JournalHeader
from rmr.mind.mind_header import decode_header, encode_header
from rmr.mind.mind_versions import differences, is_compiled
from rmr.mind.segments import NEW, FoundState, find_state
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import NodeConfig
from rmr_agent.bytecode import Loaded, RefusedError
from rmr_agent.snapshot_taker import SnapshotTaker
from rmr_agent.state_files import (
    JOURNAL,
    PROGRAM,
    SEGMENTS,
    SNAPSHOTS,
    StateKey,
    begun_file,
    default_key_file,
    listed,
    read_files,
    remove_superfluous,
    segment_name,
    snapshot_name,
    state_key,
    sync_folder,
)

LOCK: Final = "lock"
ANEW: Final = "begin anew with an empty folder"

log = logging.getLogger("rmr")


T = TypeVar("T")


class StateRefusedError(RefusedError):
    """The folder cannot be used; the message says why and what to do."""


class StateFullError(OSError):
    """The state cannot be written any more; the message says where and why."""

    def __str__(self) -> str:
        """Return the message, without the number."""
        return str(self.args[1])


class _AppendedFile:
    """A row of files, of which the last one is written at its end (`rmr.mind.journal.JournalFile`)."""

    def __init__(self, path: Path, *, synced: bool, closed: Callable[[int], None]) -> None:
        """`closed` is called with the number of a segment that has begun. Raises OSError."""
        self.path = path
        self._synced = synced
        self._closed = closed
        self._descriptor = _opened(path)

    def close(self) -> None:
        """Write nothing more."""
        os.close(self._descriptor)

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

    def begin_segment(self, number: int, data: bytes) -> None:
        """Begin the file of segment `number` with `data`. Raises StateFullError."""
        path = self.path.with_name(segment_name(number))
        try:
            descriptor = begun_file(path, data, synced=self._synced)
        except OSError as error:
            raise self._full(error) from None
        os.close(self._descriptor)
        self._descriptor = descriptor
        self.path = path
        self._closed(number)

    def _full(self, error: OSError) -> StateFullError:
        return StateFullError(
            error.errno or errno.EIO,
            f"the robot's state cannot be written to {self.path}: {error.strerror}; "
            "the robot has stopped before anything left it that is not on disk",
        )


def _opened(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)


class StateFolder:
    """One robot's folder, locked by this process."""

    def __init__(
        self,
        path: Path,
        robot: int,
        program: int,
        durability: str,
        octets: bytes = b"",
        segment_octets: int = SEGMENT_OCTETS,
        key_file: Path | None = None,
        trust: Path | None = None,
    ) -> None:
        """Take the folder of `robot`, which runs the `program` of this digest. Raises StateRefusedError.

        `octets` are the program. A snapshot is taken each time that the journal has grown by `segment_octets`; without
        a program, or at 0, or where rmr is compiled, there are none. Their key is in `key_file`, which is made where
        one is needed; None: the user's own. Where there is `trust`, snapshots are taken with a program that it allows.
        """
        self.path = path
        self._octets = octets
        self._segment_octets = segment_octets if octets and not is_compiled() else 0
        self._taker: SnapshotTaker | None = None
        self._robot = robot
        self._program = program
        self._synced = durability == "power"
        self._file: _AppendedFile | None = None
        self._lock = -1
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            self._take_lock()
            segments = read_files(path, SEGMENTS)
            snapshots = read_files(path, SNAPSHOTS)
        except OSError as error:
            self.close()
            raise StateRefusedError(f"--state {path}: {error.strerror or error}") from None
        self._key = StateKey(path, b"")
        if snapshots or self._segment_octets:
            self._key = self._owned_key(key_file)
            self._taker = SnapshotTaker(path, robot, self._key, trust)
        self.found: FoundState = NEW
        """What the folder held."""
        self.header: JournalHeader | None = None
        """The header of the journal; None if the robot begins."""
        self.config: NodeConfig | None = None
        """The configuration with which the robot began."""
        try:
            self.found = find_state(segments, snapshots, self._key.octets)
            self._check()
        except JournalError as error:
            self.close()
            raise self._refused(str(error)) from None

    def _refused(self, why: str) -> StateRefusedError:
        return StateRefusedError(f"--state {self.path}: {why}; {ANEW}, or give another one")

    def _owned_key(self, file: Path | None) -> StateKey:
        """Return the key of snapshots in `file`; None: the user's own. Raises StateRefusedError."""
        try:
            return state_key(default_key_file() if file is None else file)
        except OSError as error:
            self.close()
            where = error.filename or file
            raise StateRefusedError(
                f"the key of snapshots cannot be had from {where}: {error.strerror}; "
                "name a file for it with --state-key FILE, or take no snapshots with --snapshots 0"
            ) from None
        except SecretError as error:
            self.close()
            raise StateRefusedError(str(error)) from None

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

    def _check(self) -> None:
        """Raise JournalError if the journal is none that this robot can go on from."""
        self.header = header = self.found.header
        if header is None:
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
        for warning in (*self.passed_over, self.dropped):
            if warning:
                log.warning("%s", warning)
        found = self.found
        state = None if found.snapshot is None else found.snapshot.state
        return self.config or config, DurableState(self._journal(header), found.records, snapshot=state)

    def go_on(self, header: JournalHeader, config: NodeConfig, make: Callable[[NodeConfig, DurableState], T]) -> T:
        """Return what `make` makes of the state as `taken_up` returns it.

        If a snapshot does not lead to what is recorded behind it, it is passed over for the one before, too. Raises
        StateRefusedError as `taken_up` does, and JournalError if the robot cannot go on from any.
        """
        while True:
            own, state = self.taken_up(header, config)
            try:
                return make(own, state)
            except JournalError as error:
                if not self._pass_over(str(error)):
                    raise

    def _pass_over(self, why: str) -> bool:
        """Remove the snapshot that was used, and look for the one before; return False if there is none."""
        snapshot = self.found.snapshot
        snapshots = read_files(self.path, SNAPSHOTS)
        if snapshot is None or snapshots.pop(snapshot.segment, None) is None:
            return False
        try:
            found = find_state(read_files(self.path, SEGMENTS), snapshots, self._key.octets)
        except JournalError:
            return False
        self.found = found._replace(passed_over=((snapshot.segment, why), *found.passed_over))
        if self._file is not None:
            self._file.close()
            self._file = None
        return True

    def _journal(self, header: JournalHeader) -> Journal:
        """Return the journal behind what could be read; `header` begins it if there is none.

        Raises StateRefusedError if it cannot be written.
        """
        found = self.found
        try:
            if self._octets:
                (self.path / PROGRAM).write_bytes(self._octets)
            if found.header is None:
                return self._begin(header)
            path = self.path / segment_name(found.last)
            os.truncate(path, found.whole)
            self._remove_unused(found)
            self._file = self._opened(path)
        except OSError as error:
            raise StateRefusedError(f"--state {self.path}: {error.strerror or error}") from None
        return Journal(
            self._file,
            synced=self._synced,
            crc=found.crc,
            header=found.header,
            filled=found.whole,
            segment_octets=self._segment_octets,
        )

    def _opened(self, path: Path) -> _AppendedFile:
        return _AppendedFile(path, synced=self._synced, closed=self._closed)

    def _closed(self, segment: int) -> None:
        if self._taker is not None:
            self._taker.take(segment)

    def _begin(self, header: JournalHeader) -> Journal:
        """Write the header into a file that gets its name when it is whole. Raises OSError."""
        path = self.path / JOURNAL
        new = path.with_suffix(".new")
        new.write_bytes(b"")
        file = self._file = self._opened(new)
        self.header = header
        journal = Journal(file, synced=self._synced, segment_octets=self._segment_octets)
        journal.header(header)
        new.rename(path)
        file.path = path
        if self._synced:
            sync_folder(self.path)
        return journal

    def _remove_unused(self, found: FoundState) -> None:
        """Remove segments and snapshots that are not gone on from. Raises OSError."""
        passed = [number for number, _ in found.passed_over]
        for number, path in listed(self.path, SNAPSHOTS).items():
            if number > found.last or number in passed:
                path.unlink()
        for number, path in listed(self.path, SEGMENTS).items():
            if number > found.last:
                path.unlink()
        remove_superfluous(self.path, self._key)

    @property
    def passed_over(self) -> list[str]:
        """Which snapshots are not used, and why, in words."""
        found = self.found
        on = "the one before" if found.snapshot is not None else "the begin of the journal"
        return [
            f"{self.path / snapshot_name(number)}: {why}; it is passed over, and the robot goes on from {on}"
            for number, why in found.passed_over
        ]

    @property
    def dropped(self) -> str:
        """What of the journal was dropped, in words; empty if nothing was."""
        if not self.found.dropped:
            return ""
        path = self.path / segment_name(self.found.last)
        what = f"{path}: the last {self.found.dropped} octets are no whole record and are dropped; "
        if self.found.torn:
            return what + "the robot died while it wrote them, before anything came of them"
        return what + (
            "the file is damaged there: the robot goes on from an older state, and others may take what it sends for "
            "what they have; begin the run anew where that matters"
        )

    def close(self) -> None:
        """Leave the folder to others."""
        if self._taker is not None:
            self._taker.close()
        if self._file is not None:
            self._file.close()
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
