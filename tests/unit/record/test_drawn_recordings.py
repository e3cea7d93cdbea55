"""Recordings of any shape, damaged or cut: what is recovered every reader takes, and what is lost is told."""

from collections import Counter
from dataclasses import replace

import pytest
from drawn_recordings import drawn, write_drawn
from mcap.writer import CompressionType, IndexType
from recovery_check import check

from rmr.record.joining import NothingToDoError, UnwritableError, recover
from rmr.record.recording import open_recording

SEEDS = {97: range(36), 1: range(12)}
"""Recordings by the step from octet to octet. Two of three are written as by a run, each third as by another tool."""
EVERY = [
    pytest.param(97, marks=pytest.mark.medium, id="each 97th octet"),
    pytest.param(1, marks=[pytest.mark.slow, pytest.mark.timeout(900)], id="each octet"),
]


@pytest.mark.parametrize("step", EVERY)
def test_a_recording_of_any_shape_with_an_octet_flipped_is_recovered_for_every_reader(tmp_path, step):
    path = tmp_path / "run.mcap"
    recovered = 0
    for seed in SEEDS[step]:
        recording = drawn(seed)
        whole = write_drawn(path, recording)
        for at in range(seed % step, len(whole), step):
            octets = bytearray(whole)
            octets[at] ^= (0xFF, 0x01, 0x80)[at % 3]
            recovered += check(recording, bytes(octets), path, f"seed {seed}, octet {at}")
    assert recovered > 100


@pytest.mark.parametrize("step", EVERY)
def test_a_recording_of_any_shape_that_is_cut_is_recovered_for_every_reader_up_to_there(tmp_path, step):
    path = tmp_path / "run.mcap"
    recovered = 0
    for seed in SEEDS[step]:
        recording = drawn(seed)
        whole = write_drawn(path, recording)
        for length in range(seed % step, len(whole), step):
            where = f"seed {seed}, {length} octets"
            recovered += check(replace(recording, finished=False), whole[:length], path, where)
    assert recovered > 100


def test_a_recording_of_any_shape_is_read_whole_and_one_that_is_finished_is_left_as_it_is(tmp_path):
    path = tmp_path / "run.mcap"
    shapes = Counter()
    for seed in range(300):
        recording = drawn(seed)
        octets = write_drawn(path, recording)
        with open_recording(path) as opened:
            rows = [(raw.topic, raw.at, raw.octets) for raw in opened.raw_messages()]
            assert {name: opened.attachment(name) for name in opened.attachments} == recording.attachments, seed
            assert bool(opened.problems) == (not recording.finished), seed
            if recording.finished and opened.check():
                with pytest.raises(NothingToDoError):
                    recover(path)
                assert path.read_bytes() == octets
        assert Counter(rows) == Counter(recording.rows), seed
        shapes[recording.tool is None, len(recording.chunks), bool(recording.attachments), recording.finished] += 1
    assert len(shapes) > 30, "the draw reaches most of the shapes"


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.NONE},
        {"use_chunking": False},
        {"repeat_channels": False},
        {"index_types": IndexType.NONE},
        {"enable_crcs": False},
    ],
)
def test_what_another_tool_has_written_anew_is_read_whole(tmp_path, options):
    recording = replace(drawn(5), tool=options, finished=True)
    write_drawn(tmp_path / "run.mcap", recording)
    with open_recording(tmp_path / "run.mcap") as opened:
        assert Counter((raw.topic, raw.at, raw.octets) for raw in opened.raw_messages()) == Counter(recording.rows)
        assert opened.check()
        assert not opened.problems
    assert recording.rows


def test_a_compression_that_rmr_does_not_read_is_told_and_costs_nothing(tmp_path):
    path = tmp_path / "run.mcap"
    octets = write_drawn(path, replace(drawn(5), tool={"compression": CompressionType.LZ4}, finished=True))
    with open_recording(path) as opened:
        assert list(opened.messages()) == []
        assert "compression 'lz4', which rmr does not read" in opened.problems[0]
    path.write_bytes(octets[:-9])
    with pytest.raises(UnwritableError, match="another tool has compressed it with lz4"):
        recover(path)
    assert path.read_bytes() == octets[:-9]
