"""The segments and snapshots of a durable robot: with which ones it goes on, and which ones are superfluous.

It goes on with the newest snapshot that is whole, and the segments of the journal from there on. A snapshot that is
damaged is passed over for the one before; before the first one there is the begin of the journal. A segment counts only
behind the very record that its header names. Nothing is believed beside a snapshot that was written with another key.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from rmr.mind.journal import JournalError, JournalHeader, JournalRecord, ReadJournal, read_journal
from rmr.mind.snapshot import KEPT, ForeignSnapshotError, Snapshot, SnapshotError, read_snapshot


class FoundState(NamedTuple):
    """What a durable robot goes on with."""

    snapshot: Snapshot | None
    records: list[JournalRecord]
    """Of the segments from that of the snapshot on; none if the robot is new."""
    header: JournalHeader | None
    """Of the last segment; None if the robot is new."""
    whole: int
    """Octets of the whole records of the last segment."""
    crc: int
    """Check sum with which the next record begins."""
    dropped: int
    """Octets behind these records, in all segments."""
    torn: bool
    """Whether what was dropped is the beginning of one record, which was being written: nothing of it had left."""
    passed_over: tuple[tuple[int, str], ...] = ()
    """Snapshots that are not used, by segment, each with the reason; newest first."""

    @property
    def last(self) -> int:
        """Number of the last segment, in which the journal goes on."""
        return 0 if self.header is None else self.header.segment


NEW = FoundState(None, [], None, 0, 0, 0, torn=True)
"""That of a new robot."""


def find_state(segments: Mapping[int, bytes], snapshots: Mapping[int, bytes], key: bytes) -> FoundState:
    """Return with what the robot goes on; `key` is that of its snapshots.

    Raises JournalError if nothing of its journal can be read, or a snapshot was written with another key.
    """
    if not segments and not snapshots:
        return NEW
    passed: list[tuple[int, str]] = []
    for number in sorted(snapshots, reverse=True):
        try:
            snapshot = read_snapshot(snapshots[number], key)
        except ForeignSnapshotError as error:
            raise JournalError(
                f"its snapshot {number} {error}, by somebody else or elsewhere: if you trust who wrote it, "
                "name the key with --state-key FILE"
            ) from None
        except SnapshotError as error:
            passed.append((number, str(error)))
            continue
        found = _behind(segments, number, snapshot)
        if found is not None and snapshot.segment == number:
            return found._replace(passed_over=tuple(passed))
        passed.append((number, "the journal behind it is missing or damaged at its beginning"))
    found = _behind(segments, 0, None)
    if found is None:
        raise JournalError("its journal is damaged at the beginning, and nothing of it can be read")
    return found._replace(passed_over=tuple(passed))


def _behind(segments: Mapping[int, bytes], first: int, snapshot: Snapshot | None) -> FoundState | None:
    """Return the state from segment `first` on, as far as it is whole; None if there is not even that one's header."""
    before = None if snapshot is None else snapshot.before
    read = _segment(segments, first, before)
    if read is None:
        return None
    records = [*read.records]
    last = first
    while not read.dropped and (following := _segment(segments, last + 1, read.crc)) is not None:
        read = following
        records += read.records
        last += 1
    lost = sum(len(data) for number, data in segments.items() if number > last)
    return FoundState(
        snapshot, records, read.header, read.whole, read.crc, read.dropped + lost, torn=read.torn and not lost
    )


def _segment(segments: Mapping[int, bytes], number: int, before: int | None) -> ReadJournal | None:
    """Return a segment; None if it is not there, its header is damaged, or it is behind another record."""
    read = read_journal(segments.get(number, b""))
    header = read.header
    if header is None or header.segment != number or (number and header.before != before):
        return None
    return read


def superfluous(segments: Iterable[int], snapshots: Mapping[int, bytes], key: bytes) -> tuple[list[int], list[int]]:
    """Return the numbers of the segments and snapshots before the two newest snapshots that are whole."""
    kept = [number for number in sorted(snapshots) if _is_whole(snapshots[number], key)][-KEPT:]
    first = kept[0] if len(kept) == KEPT else 0
    return [each for each in sorted(segments) if each < first], [each for each in sorted(snapshots) if each < first]


def _is_whole(data: bytes, key: bytes) -> bool:
    try:
        read_snapshot(data, key)
    except SnapshotError:
        return False
    return True
