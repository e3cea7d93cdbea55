"""With which snapshot and segments a durable robot goes on, whatever of its files is damaged or missing."""

import pytest

from rmr.mind.journal import Journal, JournalError, JournalHeader
from rmr.mind.segments import NEW, find_state, superfluous
from rmr.mind.snapshot import Snapshot

KEY = b"the key of these robots"
HEADER = JournalHeader(4, "bench", 99, 7, False, b"mind")


class Files:
    """Segments in memory."""

    def __init__(self):
        self.segments = {0: b""}
        self.checks = {}
        self.number = 0

    def append(self, data):
        self.segments[self.number] += data

    def begin_segment(self, number, data):
        self.number = number
        self.segments[number] = data

    def sync(self):
        raise AssertionError("nothing is synced")


def written(segments=4):
    """Return segments with two records each, and the snapshots before all but the first."""
    files = Files()
    journal = Journal(files, synced=False)
    journal.header(HEADER)
    snapshots = {}
    for number in range(segments):
        if number:
            snapshots[number] = Snapshot(number, journal._crc, 7, f"state {number}".encode()).octets(KEY)
            journal.next_segment()
        journal.calls(number, b"one")
        journal.calls(number, b"two")
    return files.segments, snapshots


def going_on(segments, snapshots):
    """Return the snapshot and segments that are used, and how many octets are not."""
    found = find_state(segments, snapshots, KEY)
    state = None if found.snapshot is None else found.snapshot.state.decode()
    bases = sorted({record.base for record in found.records if record.kind == 1})
    return state, bases, found.dropped


def test_a_robot_without_files_is_new():
    assert find_state({}, {}, KEY) == NEW
    assert NEW.last == 0


def test_the_newest_snapshot_and_the_segments_from_there_on_are_used():
    segments, snapshots = written()
    assert going_on(segments, snapshots) == ("state 3", [3], 0)
    assert going_on(segments, {1: snapshots[1]}) == ("state 1", [1, 2, 3], 0)
    assert going_on(segments, {}) == (None, [0, 1, 2, 3], 0)
    assert going_on({2: segments[2], 3: segments[3]}, snapshots) == ("state 3", [3], 0)


def test_a_snapshot_damaged_or_cut_at_any_octet_is_passed_over_for_the_one_before():
    segments, snapshots = written()
    whole = snapshots[3]
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << place % 8
        for data in (bytes(damaged), whole[:place]):
            found = find_state(segments, snapshots | {3: data}, KEY)
            assert found.snapshot.state == b"state 2"
            [(number, why)] = found.passed_over
            assert number == 3
            assert why in ("it is cut short", "it is damaged")


def test_a_segment_damaged_at_any_octet_ends_the_journal_there():
    segments, snapshots = written()
    for place in range(len(segments[2])):
        damaged = bytearray(segments[2])
        damaged[place] ^= 0x41
        found = find_state(segments | {2: bytes(damaged)}, {1: snapshots[1]}, KEY)
        assert found.snapshot.state == b"state 1"
        assert found.last in (1, 2)
        assert {record.base for record in found.records if record.kind == 1} <= {1, 2}
        assert found.dropped >= len(segments[3])
        assert not found.torn


def test_a_torn_last_record_is_told_as_such():
    segments, snapshots = written()
    found = find_state(segments | {3: segments[3][:-2]}, snapshots, KEY)
    assert found.torn
    assert 0 < found.dropped < 30
    assert len(found.records) == 2


def test_a_segment_behind_another_record_does_not_count():
    segments, _ = written()
    other, _ = written(5)
    longer = Files()
    journal = Journal(longer, synced=False)
    journal.header(HEADER)
    journal.calls(9, b"another past")
    journal.next_segment()
    mixed = {0: longer.segments[0], **{number: other[number] for number in (1, 2)}}
    assert going_on(mixed, {})[:2] == (None, [9])
    found = find_state({**mixed, 3: segments[3]}, {3: Snapshot(3, 12345, 7, b"x").octets(KEY)}, KEY)
    assert found.passed_over == ((3, "the journal behind it is missing or damaged at its beginning"),)


def test_a_folder_of_which_nothing_can_be_read_is_refused():
    segments, snapshots = written()
    with pytest.raises(JournalError, match="damaged at the beginning"):
        find_state({3: segments[3]}, {3: snapshots[3][:-1]}, KEY)


@pytest.mark.parametrize("number", [1, 3, 4])
def test_a_whole_snapshot_of_another_key_is_refused_before_anything_of_it_is_read(number):
    segments, snapshots = written()
    foreign = Snapshot(number, 12345, 7, b"a crafted state").octets(b"a key of somebody else")
    with pytest.raises(JournalError, match=rf"snapshot {number} was written with another key.* --state-key FILE"):
        find_state(segments, {number: foreign}, KEY)
    with pytest.raises(JournalError, match="another key"):
        find_state(segments, {2: foreign, 3: snapshots[3][:-1]}, KEY)
    assert superfluous(segments, {**snapshots, 3: foreign}, KEY) == ([0], []), "it counts as little as a torn one"


def test_what_is_before_the_two_newest_whole_snapshots_is_superfluous():
    segments, snapshots = written()
    assert superfluous(segments, {}, KEY) == ([], [])
    assert superfluous(segments, {1: snapshots[1]}, KEY) == ([], [])
    assert superfluous(segments, snapshots, KEY) == ([0, 1], [1])
    assert superfluous(segments, snapshots | {3: b"torn"}, KEY) == ([0], [])
