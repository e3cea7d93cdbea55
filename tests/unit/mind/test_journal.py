"""The journal: whole records up to the first that is torn or damaged, and nothing behind it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.mind.fact_values import pack
from rmr.mind.journal import CALLS, HEADER, RESUMED, Journal, JournalError, JournalHeader, read_journal

OWN = JournalHeader(4, "corridor", 77, 0xABCD, False, b"mind")


class Memory:
    """A file in memory."""

    def __init__(self, data=b""):
        self.data = data
        self.synced = 0

    def append(self, data):
        self.data += data

    def sync(self):
        self.synced = len(self.data)


def written(bodies, synced=False):
    """Return the file of a journal with these records, and the places where they end."""
    file = Memory()
    journal = Journal(file, synced=synced)
    journal.header(OWN)
    ends = [len(file.data)]
    for base, body in bodies:
        journal.calls(base, body)
        ends.append(len(file.data))
    return file, ends


def test_records_come_back_as_they_were_written():
    file, _ = written([(5, b"abc"), (9, b"")])
    Journal(file, synced=False, crc=read_journal(file.data).crc).resumed(11)
    found = read_journal(file.data)
    assert found.header == OWN
    assert [(each.kind, each.base, each.octets) for each in found.records[1:]] == [
        (CALLS, 5, b"abc"),
        (CALLS, 9, b""),
        (RESUMED, 11, b""),
    ]
    assert (found.whole, found.dropped) == (len(file.data), 0)


@given(st.lists(st.tuples(st.integers(0, 1 << 60), st.binary(max_size=40)), max_size=4))
@settings(max_examples=25)
def test_a_journal_cut_at_any_octet_gives_exactly_the_whole_records(bodies):
    file, ends = written(bodies)
    for cut in range(len(file.data) + 1):
        found = read_journal(file.data[:cut])
        whole = [end for end in ends if end <= cut]
        assert len(found.records) == len(whole)
        assert found.whole == (whole[-1] if whole else 0)
        assert found.dropped == cut - found.whole
        assert found.torn


@given(st.lists(st.tuples(st.integers(0, 1 << 60), st.binary(max_size=40)), max_size=3), st.integers(1, 255))
@settings(max_examples=25)
def test_an_octet_changed_anywhere_drops_its_record_and_all_behind_it(bodies, change):
    file, ends = written(bodies)
    sound = read_journal(file.data).records
    for place in range(len(file.data)):
        damaged = bytearray(file.data)
        damaged[place] ^= change
        found = read_journal(bytes(damaged))
        before = [end for end in ends if end <= place]
        assert found.records == sound[: len(before)]
        assert found.dropped == len(file.data) - (before[-1] if before else 0)


def test_what_is_written_behind_a_cut_journal_counts_and_octets_of_the_old_tail_do_not():
    file, ends = written([(1, b"one"), (2, b"two"), (3, b"three")])
    cut = read_journal(file.data[: ends[1] + 5])
    again = Memory(file.data[: cut.whole])
    Journal(again, synced=False, crc=cut.crc).calls(2, b"TWO")
    # The third record of the old file follows another one now.
    found = read_journal(again.data + file.data[ends[2] :])
    assert [each.octets for each in found.records[1:]] == [b"one", b"TWO"]
    assert found.dropped == ends[3] - ends[2]


def test_damage_in_the_middle_is_told_from_a_record_that_was_being_written():
    file, ends = written([(1, b"one"), (2, b"two")])
    damaged = bytearray(file.data)
    damaged[ends[0] + 9] ^= 1
    assert not read_journal(bytes(damaged)).torn
    assert read_journal(file.data[:-1]).torn


def test_each_record_is_synced_where_power_may_fail():
    file, _ = written([(1, b"one")], synced=True)
    assert file.synced == len(file.data)
    file, _ = written([(1, b"one")])
    assert file.synced == 0


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (b"\xc1", "does not begin as a robot's state does"),
        (pack({"what": "another"}), "does not begin as a robot's state does"),
        (pack({"what": "rmr state", "format": 9}), "it has format 9; this rmr reads format 1"),
        (pack({"what": "rmr state", "format": 1, "robot": 3}), "its header has no lab"),
    ],
)
def test_a_header_of_something_else_is_refused(body, why):
    file = Memory()
    Journal(file, synced=False)._write(bytes([HEADER]) + body)
    with pytest.raises(JournalError, match=why):
        _ = read_journal(file.data).header


def test_an_empty_file_has_no_header():
    assert read_journal(b"").header is None
    assert read_journal(b"\0" * 4096).records == []
