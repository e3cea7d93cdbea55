"""The journal of a durable robot: a file of records, each whole or absent (write-ahead log).

    record   length of the body, check sum, body
    body     kind, then what the kind holds

The check sum is the CRC-32 of the body, begun with the check sum of the record before. So a record counts only behind
the very records that it was written behind, and octets of an older file are none. `read_journal` takes the longest run
of whole records from the beginning; what follows it was being written when the robot died, or is damaged.

The first record is the header: whose journal it is, and what makes the node anew. It is written when the robot begins.

A journal is a row of *segments*, each a file of its own with a header. A segment that is full is closed between two
calls, and another one begins, whose header has the check sum of the last record before. A snapshot (`snapshot`) is the
robot's state at the begin of a segment, in place of all segments before.

This module has no input or output: `JournalFile` is what a host gives it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from struct import Struct
from typing import Any, Final, NamedTuple, Protocol
from zlib import crc32

from rmr.base.time import Instant
from rmr.mind.fact_values import pack, unpack

FORMAT: Final = 1
"""Format of the journal; another one is refused."""
MAGIC: Final = "rmr state"
SEGMENT_OCTETS: Final = 1 << 20
"""Octets after which a segment is closed: two minutes of a driving robot, and a second of execution at a restart."""
RECORD_MAX: Final = 1 << 26
"""Longest body that is taken for one, 64 MiB: a damaged length asks for more."""
_HEAD: Final = Struct("<II")
_CALLS: Final = Struct("<Bq")

HEADER: Final = 0
"""msgpack of the fields of `JournalHeader`."""
CALLS: Final = 1
"""Base instant, then operations of the mind (`mind_format`); they may go on with the call of the record before."""
RESUMED: Final = 2
"""Base instant: the robot was started again here, with all that is recorded before."""


class JournalError(ValueError):
    """A journal cannot be used, or written; the message says why and what to do."""


class JournalFile(Protocol):
    """Where a journal is kept."""

    def append(self, data: bytes) -> None:
        """Write `data` behind what is there, so that it survives the end of the process. Raises OSError."""

    def sync(self) -> None:
        """Make what was written survive a loss of power. Raises OSError."""

    def begin_segment(self, number: int, data: bytes) -> None:
        """Close the segment, and begin another one with `data`, which is there wholly or not at all. Raises OSError."""


@dataclass(frozen=True, slots=True)
class JournalHeader:
    """Whose journal it is."""

    robot: int
    lab: str
    run: int
    """Number of the world's session: lab time of another one begins anew."""
    program: int
    """Digest of the byte-code."""
    noted: bool
    """Whether entries of the trace are logged."""
    mind: bytes
    """The header of the mind's log (`mind_header`)."""
    segment: int = 0
    """Number of the segment."""
    before: int = 0
    """Check sum of the last record of the segment before."""

    def octets(self) -> bytes:
        """Return the body of the record."""
        fields = {name: getattr(self, name) for name in ("robot", "lab", "run", "program", "noted", "mind")}
        later = {"segment": self.segment, "before": self.before} if self.segment else {}
        return bytes([HEADER]) + pack({"what": MAGIC, "format": FORMAT} | fields | later)


class JournalRecord(NamedTuple):
    """One record."""

    kind: int
    base: Instant
    """Instant of the call before; 0 in the header."""
    octets: bytes


class ReadJournal(NamedTuple):
    """What could be read of a journal."""

    records: list[JournalRecord]
    whole: int
    """Octets of the whole records, from the beginning."""
    dropped: int
    """Octets behind them."""
    crc: int
    """Check sum with which the next record begins."""
    torn: bool
    """Whether what was dropped is the beginning of one record, which was being written: nothing of it had left."""

    @property
    def header(self) -> JournalHeader | None:
        """The header; None if the journal has no whole record. Raises JournalError if it is none of this format."""
        return _header(self.records[0]) if self.records else None


def read_journal(data: bytes) -> ReadJournal:
    """Return the whole records at the beginning of `data`."""
    records: list[JournalRecord] = []
    place = 0
    crc = 0
    torn = True
    while place + _HEAD.size <= len(data):
        length, found = _HEAD.unpack_from(data, place)
        body = data[place + _HEAD.size : place + _HEAD.size + length]
        if 0 < length <= RECORD_MAX and len(body) < length:
            break
        record = _record(body) if 0 < length <= RECORD_MAX and crc32(body, crc) == found else None
        if record is None:
            torn = False
            break
        records.append(record)
        crc = found
        place += _HEAD.size + length
    return ReadJournal(records, place, len(data) - place, crc, torn)


def _record(body: bytes) -> JournalRecord | None:
    if body[0] == HEADER:
        return JournalRecord(HEADER, 0, body[1:])
    if body[0] not in (CALLS, RESUMED) or len(body) < _CALLS.size:
        return None
    kind, base = _CALLS.unpack_from(body)
    return JournalRecord(kind, base, body[_CALLS.size :])


def _header(record: JournalRecord) -> JournalHeader:
    found: Any = None
    if record.kind == HEADER:
        try:
            found = unpack(record.octets)
        except ValueError:
            found = None
    if not isinstance(found, dict) or found.get("what") != MAGIC:
        raise JournalError("it does not begin as a robot's state does")
    if found.get("format") != FORMAT:
        raise JournalError(f"it has format {found.get('format')}; this rmr reads format {FORMAT}")
    try:
        own = (found["robot"], found["lab"], found["run"], found["program"], found["noted"], found["mind"])
        return JournalHeader(*own, found.get("segment", 0), found.get("before", 0))
    except KeyError as error:
        raise JournalError(f"its header has no {error.args[0]}") from None


class DurableState(NamedTuple):
    """What a durable robot begins with."""

    journal: "Journal"
    stored: Sequence[JournalRecord]
    """Its records; none if it is new. Behind a snapshot: those of the segments from there on."""
    noted: bool = False
    """Whether entries of the trace are logged."""
    snapshot: bytes | None = None
    """The graph state with which it goes on (`object_graph`); None: its journal begins with it."""


class Journal:
    """Writes records behind those that are there."""

    def __init__(
        self,
        file: JournalFile,
        *,
        synced: bool,
        crc: int = 0,
        header: JournalHeader | None = None,
        filled: int = 0,
        segment_octets: int = 0,
    ) -> None:
        """`synced`: each record survives a loss of power, too. `crc` is the check sum of the last record.

        `header` is that of the segment, which has `filled` octets and is closed at `segment_octets`; 0: never.
        """
        self._file = file
        self._synced = synced
        self._crc = crc
        self._header = header
        self._filled = filled
        self._segment_octets = segment_octets
        self.records = 0
        """Records written."""
        self.octets = 0
        """Octets written."""

    def header(self, header: JournalHeader) -> None:
        """Write the first record. Raises OSError."""
        self._header = header
        self._write(header.octets())

    @property
    def full(self) -> bool:
        """Whether the segment is to be closed at the next end of a call."""
        return 0 < self._segment_octets <= self._filled

    def next_segment(self) -> None:
        """Close the segment and begin another one. Raises OSError."""
        assert self._header is not None
        header = replace(self._header, segment=self._header.segment + 1, before=self._crc)
        body = header.octets()
        self._crc = 0
        data = self._sealed(body)
        self._file.begin_segment(header.segment, data)
        self._header = header
        self._crc = crc32(body)
        self._filled = len(data)
        self.records += 1
        self.octets += len(data)

    def calls(self, base: Instant, octets: bytes) -> None:
        """Write operations. Raises OSError."""
        self._write(_CALLS.pack(CALLS, base) + octets)

    def resumed(self, base: Instant) -> None:
        """Write that the robot goes on from what is recorded. Raises OSError."""
        self._write(_CALLS.pack(RESUMED, base))

    def next_calls(self, base: Instant, octets: bytes) -> bytes:
        """Return the record of operations as `calls` would write it now."""
        return self._sealed(_CALLS.pack(CALLS, base) + octets)

    def _sealed(self, body: bytes) -> bytes:
        return _HEAD.pack(len(body), crc32(body, self._crc)) + body

    def _write(self, body: bytes) -> None:
        data = self._sealed(body)
        self._file.append(data)
        if self._synced:
            self._file.sync()
        self._crc = crc32(body, self._crc)
        self._filled += len(data)
        self.records += 1
        self.octets += len(data)
