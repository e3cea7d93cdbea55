"""Whatever a file holds, reading it gives a prefix of what was written, or one sentence."""

import itertools
import subprocess
import sys
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader
from record_maker import about, end_without_closing, trace, write_part

from rmr.record.joining import NothingToDoError, recover
from rmr.record.mcap_format import HEAD, MAGIC, RecordCode
from rmr.record.mcap_scan import RecordingError
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import open_recording


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_part(tmp_path_factory.mktemp("whole") / "run.mcap", "sim").read_bytes()


def record_ends(octets: bytes) -> list[int]:
    """Return the offsets behind each record."""
    at = len(MAGIC)
    ends = [at]
    while at + HEAD.size < len(octets):
        _, length = HEAD.unpack_from(octets, at)
        at += HEAD.size + length
        ends.append(at)
    return ends


def instants(path) -> list[int] | None:
    """Return the instants of the messages in `path`; None if it is told in a sentence that it cannot be read."""
    problem = ""
    try:
        with open_recording(path) as recording:
            return [message.at for message in recording.messages()]
    except RecordingError as error:
        problem = str(error)
    assert problem.startswith(str(path))
    assert "\n" not in problem
    return None


def test_a_file_cut_at_the_end_of_a_record_or_beside_it_gives_a_prefix(whole, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole)
    everything = instants(path)
    assert everything is not None
    read = []
    for end in record_ends(whole):
        for at in (end - 1, end, end + 1):
            path.write_bytes(whole[:at])
            found = instants(path)
            assert found is None or found == everything[: len(found)]
            read.append(-1 if found is None else len(found))
    assert read[0] == -1
    assert {0, 100, 200, 300} <= set(read)


@given(st.data())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_cut_or_damaged_anywhere_never_raises_anything_but_a_recording_error(whole, tmp_path, data):
    octets = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for _ in range(data.draw(st.integers(0, 3))):
        if octets:
            octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "damaged.mcap"
    path.write_bytes(octets)
    found = instants(path)
    assert found is None or len(found) <= 300


def test_a_cut_file_tells_how_far_it_goes_and_what_is_lost(whole, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: record_ends(whole)[8] - 5])
    with open_recording(path) as recording:
        [problem] = recording.problems
    assert "was cut short" in problem
    assert "octets at its end are no whole record" in problem
    assert "its last message is of 0.990 s" in problem


def test_a_damaged_chunk_is_left_out_and_told(whole, tmp_path):
    ends = record_ends(whole)
    chunks = [start for start in ends[:-1] if whole[start] == RecordCode.CHUNK]
    octets = bytearray(whole)
    octets[chunks[1] + 100] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(octets)
    with open_recording(path) as recording:
        assert len(list(recording.messages())) == 200
        [problem] = recording.problems
    assert "from 1.000 s to 1.990 s is damaged and left out" in problem


def recovered(path) -> tuple[list[int], tuple[str, ...]] | None:
    """Recover `path`; return the instants that other readers find in it, and what is told. None: told as unreadable."""
    try:
        problems, told = recover(path).problems, ""
    except NothingToDoError:
        problems, told = (), ""
    except RecordingError as error:
        problems, told = (), str(error)
    if told:
        assert told.startswith(str(path))
        return None
    with path.open("rb") as file:
        read = [message.log_time for _, _, message in make_reader(file, validate_crcs=True).iter_messages()]
        file.seek(0)
        streamed = NonSeekingReader(file, validate_crcs=True).iter_messages()
        assert [message.log_time for _, _, message in streamed] == read
    return read, problems


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A recording of three chunks with two messages each, an attachment, and nothing that a run would not have."""
    path = tmp_path_factory.mktemp("small") / "run.mcap"
    writer = RecordWriter(path, about())
    writer.attach("floor.json", b"{}")
    for number in range(6):
        writer.write("/mind", number, {"robot": 1, "epoch": 0, "data": b"octets"})
        if number % 2:
            writer.flush()
    writer.close()
    return path.read_bytes()


def check_flip(small: bytes, at: int, mask: int, path) -> None:
    """Check what becomes of a recording in which the octet `at` is damaged."""
    octets = bytearray(small)
    octets[at] ^= mask
    path.write_bytes(octets)
    found = recovered(path)
    assert found is not None, f"octet {at}"
    read, problems = found
    lost = sorted(set(range(6)) - set(read))
    assert lost in ([], [0, 1], [2, 3], [4, 5]), f"octet {at}"
    assert problems, f"octet {at}"
    assert sum("damaged and left out" in each for each in problems) == bool(lost) + (not attached(path)), f"octet {at}"
    with open_recording(path) as recording:
        assert replace(recording.about, process="") == replace(about(), process=""), f"octet {at}"
    assert not set(read) - set(range(6))


def attached(path) -> bool:
    with open_recording(path) as recording:
        return recording.attachment("floor.json") == b"{}"


EVERY = [
    pytest.param(41, marks=pytest.mark.fast, id="each 41st octet"),
    pytest.param(1, marks=[pytest.mark.slow, pytest.mark.timeout(600)], id="each octet"),
]


@pytest.mark.parametrize("step", EVERY)
def test_a_recording_with_any_octet_damaged_is_recovered_for_every_reader_without_the_chunk_alone(
    small, tmp_path, step
):
    path = tmp_path / "run.mcap"
    for at in range(0, len(small), step):
        check_flip(small, at, (0xFF, 0x01, 0x80)[at % 3], path)


@pytest.mark.parametrize("step", EVERY)
def test_a_recording_cut_anywhere_is_recovered_for_every_reader_up_to_there(small, tmp_path, step):
    path = tmp_path / "run.mcap"
    longest = 0
    for length in range(0, len(small), step):
        path.write_bytes(small[:length])
        found = recovered(path)
        if found is None:
            assert longest == 0
            continue
        read, problems = found
        assert read == list(range(len(read)))
        assert len(read) >= longest
        assert "the file was cut short" in problems[0]
        longest = len(read)
    assert longest == 6


@given(st.data())
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_recording_damaged_in_several_places_is_recovered_for_every_reader_or_told(small, tmp_path, data):
    octets = bytearray(small[: data.draw(st.integers(0, len(small)))])
    for _ in range(data.draw(st.integers(0, 4))):
        if octets:
            octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "damaged.mcap"
    path.write_bytes(octets)
    found = recovered(path)
    assert found is None or set(found[0]) <= set(range(6))


def test_a_whole_recording_is_left_as_it_is(small, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(small)
    with pytest.raises(NothingToDoError):
        recover(path)
    assert path.read_bytes() == small


def test_a_damaged_attachment_is_left_out_and_told(small, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(small.replace(b"{}", b"{]", 1))
    with open_recording(path) as recording:
        assert recording.attachment("floor.json") is None
        [problem] = recording.problems
    assert problem == f"{path}: floor.json is damaged and left out (a wrong checksum)"


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        (b"", "the file is empty"),
        (b"\x89MC", "cut short within its first octets"),
        (b"PK\x03\x04 something else", "no MCAP file"),
        (b"\x89MCAP1\r\n" + bytes(100), "another version of that format"),
    ],
)
def test_what_is_no_recording_is_told(tmp_path, octets, words):
    path = tmp_path / "run.mcap"
    path.write_bytes(octets)
    with pytest.raises(RecordingError, match=words):
        open_recording(path)


def test_a_recording_of_another_format_is_refused(tmp_path):
    path = tmp_path / "run.mcap"
    octets = write_part(path, "sim").read_bytes()
    path.write_bytes(
        octets.replace(b"\x06\x00\x00\x00format\x01\x00\x00\x001", b"\x06\x00\x00\x00format\x01\x00\x00\x009")
    )
    with pytest.raises(RecordingError, match=r"format '9'; this version of rmr reads format 1"):
        open_recording(path)


def test_an_mcap_file_of_somebody_else_is_refused(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "somebody")
        writer.finish()
    with pytest.raises(RecordingError, match="no recording of rmr"):
        open_recording(path)


@pytest.mark.parametrize("name", ["nothing.mcap", ".", "\0"])
def test_a_path_without_a_recording_is_told(tmp_path, name):
    with pytest.raises(RecordingError):
        open_recording(tmp_path / name)


def test_a_message_that_is_no_json_is_left_out_and_told(tmp_path):
    writer = RecordWriter(tmp_path / "run.mcap", about())
    writer.write("/trace", 0, b"{no")
    writer.write("/trace", 1, trace(0.0))
    writer.close()
    with open_recording(writer.path) as recording:
        assert [message.at for message in recording.messages()] == [1]
        assert "a message of /trace at 0.000 s cannot be read" in recording.problems[0]


@pytest.mark.medium
def test_a_large_recording_is_read_in_bounded_memory(tmp_path):
    """64 MB of messages, read by a process that may use 40 MB more than it has after its imports."""
    writer = RecordWriter(tmp_path / "run.mcap", about())
    noise = [f"{number * 2654435761 % 2**32:x}" * 1000 for number in range(16)]
    for number, text in zip(range(8_000), itertools.cycle(noise), strict=False):
        writer.write("/trace", number * 10**6, trace(number / 1000, text=text))
    end_without_closing(writer)
    script = f"""
import resource, sys
from pathlib import Path
from rmr.record.recording import open_recording
list(open_recording(Path({str(tmp_path / "small.mcap")!r})).messages())
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
count = sum(1 for _ in open_recording(Path({str(writer.path)!r})).messages())
print(count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    write_part(tmp_path / "small.mcap", "sim")
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    count, more_kb = map(int, answer.stdout.split())
    assert count >= 7_900
    assert more_kb < 40_000
