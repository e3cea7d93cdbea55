"""Snapshots of a durable robot: its state between two segments of its journal, in place of all segments before.

A snapshot is not taken of the robot that lives: that would cost one of its ticks some 50 ms, and what a handler of a
user keeps in its variables cannot be told. It is the state of a *shadow* (`durable_node`): beside the robot, another
process makes the node anew, brings it to the newest snapshot, executes the segments that were closed since, and writes
down its graph (`object_graph`). So the snapshot is what a restart would have come to there, the executed calls have
been compared with what the robot did, and the robot's own ticks cost nothing more.

    file     length of what follows the head, its CRC-32; HMAC-SHA256 of the body; body (msgpack): segment before which
             it is, check sum of the last record before that, digest of the program, graph state

A snapshot is made of objects, and so is believed only with the authentication code of a key that its owner alone can
read: the CRC tells damage, the code tells whose it is.

This module has no input or output.
"""

import hmac
from collections.abc import Sequence
from dataclasses import replace
from struct import Struct
from typing import Final, NamedTuple
from zlib import crc32

from rmr.base.geometry import Pose, Twist
from rmr.base.time import NEVER, Duration, Instant
from rmr.bytecode.program import Program
from rmr.mind.durable_node import DurableNode
from rmr.mind.fact_values import pack, unpack
from rmr.mind.journal import Journal, JournalError, JournalHeader, JournalRecord
from rmr.mind.mind_header import MindHeader, decode_header
from rmr.mind.object_graph import Skeleton, UnsavedError
from rmr.node.ports import Confirmed, Ports, Received, Sensed

FORMAT: Final = 2
"""Format of snapshots; another one is passed over."""
MAGIC: Final = "rmr snapshot"
KEPT: Final = 2
"""Snapshots that are kept, with the segments behind the older one."""
_HEAD: Final = Struct("<II")
_CODE_OCTETS: Final = 32
"""Length of the authentication code."""


class SnapshotError(ValueError):
    """A file is no whole snapshot; the message says why."""


class ForeignSnapshotError(SnapshotError):
    """A whole snapshot that was not written with the key at hand."""


class Snapshot(NamedTuple):
    """A robot's state at the begin of a segment."""

    segment: int
    before: int
    """Check sum of the last record before."""
    program: int
    """Digest of the byte-code."""
    state: bytes

    def octets(self, key: bytes) -> bytes:
        """Return the file's octets, authenticated with `key`."""
        body = pack({"what": MAGIC, "format": FORMAT} | self._asdict())
        sealed = hmac.digest(key, body, "sha256") + body
        return _HEAD.pack(len(sealed), crc32(sealed)) + sealed


def read_snapshot(data: bytes, key: bytes) -> Snapshot:
    """Return the snapshot in a file that was written with `key`.

    Raises SnapshotError for a damaged one, and for one of another format, and ForeignSnapshotError for another key's.
    """
    if len(data) < _HEAD.size:
        raise SnapshotError("it is cut short")
    length, crc = _HEAD.unpack_from(data)
    sealed = data[_HEAD.size :]
    if len(sealed) < length:
        raise SnapshotError("it is cut short")
    if len(sealed) > length or crc32(sealed) != crc:
        raise SnapshotError("it is damaged")
    code, body = sealed[:_CODE_OCTETS], sealed[_CODE_OCTETS:]
    if not hmac.compare_digest(code, hmac.digest(key, body, "sha256")):
        raise ForeignSnapshotError("was written with another key")
    try:
        found = unpack(body)
        if found["what"] != MAGIC or found["format"] != FORMAT:
            raise SnapshotError("it has another format")
        return Snapshot(found["segment"], found["before"], found["program"], found["state"])
    except (ValueError, KeyError, TypeError) as error:
        raise SnapshotError(f"it is no snapshot ({error})") from None


class _NoPort:
    """The ports of a shadow, which is never live, and its journal, which is never written."""

    def __init__(self, payload_max: int) -> None:
        self.payload_max = payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Send nothing."""

    def receive(self) -> list[Received]:
        """Return nothing."""
        return []

    def confirmations(self) -> list[Confirmed]:
        """Return nothing."""
        return []

    def sense(self) -> list[Sensed]:
        """Return nothing."""
        return []

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Do nothing."""

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        """Do nothing."""

    def spent(self) -> Duration:
        """Return nothing spent."""
        return 0

    def neighbors(self) -> Sequence[tuple[int, float]]:
        """Return nobody."""
        return ()

    def append(self, data: bytes) -> None:
        """Write nothing."""

    def sync(self) -> None:
        """Do nothing."""

    def begin_segment(self, number: int, data: bytes) -> None:
        """Do nothing."""


def taken_snapshot(
    program: Program,
    header: JournalHeader,
    records: Sequence[JournalRecord],
    before: Snapshot | None,
    segment: int,
    crc: int,
) -> Snapshot:
    """Return the snapshot at the begin of `segment`.

    `records` are those of all segments from that of the snapshot `before` on; without it they begin with the journal.
    `crc` is the check sum of the last of them.

    Raises JournalError if they do not come out as recorded, or the state cannot be told.
    """
    node, skeleton = shadow_of(program, header, records, None if before is None else before.state)
    node.settle()
    try:
        return Snapshot(segment, crc, header.program, skeleton.state())
    except UnsavedError as error:
        raise JournalError(f"no snapshot can be taken: {error}") from None


def shadow_of(
    program: Program, header: JournalHeader, records: Sequence[JournalRecord], state: bytes | None
) -> tuple[DurableNode, Skeleton]:
    """Return a shadow behind `records`, which follow `state`, and its skeleton. Raises JournalError."""
    mind = _mind(header)
    config = mind.config
    if mind.witnessed:
        config = replace(config, witness=_unseen)
    port = _NoPort(mind.payload_max)
    ports = Ports(
        port,
        port if mind.bodily else None,
        port.spent if mind.timed else None,
        port.neighbors if mind.neighbors else None,
    )
    skeletons: list[Skeleton] = []
    journal = Journal(port, synced=False)
    handlers = {each.name: each for each in mind.actions}  # a shadow calls none
    node = DurableNode(
        config, program, ports, handlers, header.program, journal, records, header.noted, state, skeletons.append
    )
    return node, skeletons[0]


def _mind(header: JournalHeader) -> MindHeader:
    try:
        return decode_header(header.mind)
    except ValueError as error:
        raise JournalError(str(error)) from None


def _unseen(robot: int, now: Instant, event: object) -> None:
    """Take no note of an event."""
