"""A recording that was written is read again: by rmr, and by the library of the format's authors."""

import io

import pytest
from mcap.reader import make_reader

from rmr.record.record_writer import RecordWriter
from rmr.record.recording import Message, open_recording
from rmr.record.run_about import about_run

ABOUT = about_run("corridor", "simulated", 7, (1, 2, 3), "sim")


def trace(at_s: float, what: str) -> dict[str, object]:
    return {"t": at_s, "robot": 1, "what": what}


@pytest.fixture
def written(tmp_path):
    writer = RecordWriter(tmp_path / "run.mcap", ABOUT)
    writer.attach("program.rbc", b"\x00\x01")
    for number in range(3000):
        writer.write("/trace", (number * 37 % 1000) * 10**6, trace(number, "said"))
        if number % 500 == 0:
            writer.flush()
    writer.mind(2 * 10**9, 3, 1, b"\xff\x00")
    writer.close()
    assert writer.failure is None
    return writer.path


def test_messages_come_back_in_order_of_time(written):
    recording = open_recording(written)
    messages = list(recording.messages())
    assert len(messages) == 3001
    assert [message.at for message in messages] == sorted(message.at for message in messages)
    assert messages[-1] == Message("/mind", 2 * 10**9, {"robot": 3, "epoch": 1, "data": b"\xff\x00"})
    assert recording.problems == ()
    assert recording.about == ABOUT


def test_topics_and_instants_choose_messages(written):
    recording = open_recording(written.parent)
    assert [message.topic for message in recording.messages({"/mind"})] == ["/mind"]
    chosen = list(recording.messages({"/trace"}, 10**8, 2 * 10**8))
    assert {message.at for message in chosen} == {number * 10**6 for number in range(100, 200)}


def test_attachments_come_back(written):
    recording = open_recording(written)
    assert recording.attachments == ["program.rbc"]
    assert recording.attachment("program.rbc") == b"\x00\x01"
    assert recording.attachment("report.json") is None


def test_the_mcap_library_reads_the_file_by_its_index(written):
    with written.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 3001
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count >= 7
        times = [message.log_time for _, _, message in reader.iter_messages()]
        assert len(times) == 3001
        assert times == sorted(times)
        assert [attachment.data for attachment in reader.iter_attachments()] == [b"\x00\x01"]
        assert [metadata.name for metadata in reader.iter_metadata()] == ["rmr", "rmr"], "at both ends"
        assert reader.get_header().profile == "rmr"


def test_an_instant_before_the_start_counts_as_zero(tmp_path):
    writer = RecordWriter(tmp_path / "run.mcap", ABOUT)
    writer.write("/trace", -5, trace(0.0, "said"))
    writer.close()
    assert [message.at for message in open_recording(writer.path).messages()] == [0]


class FullDisk(io.RawIOBase):
    """A file that takes a number of octets and no more."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.octets = b""

    def write(self, octets):
        if len(self.octets) >= self.room:
            raise OSError(28, "No space left on device")
        taken = bytes(octets[: self.room - len(self.octets)])
        self.octets += taken
        return len(taken)


@pytest.mark.parametrize("room", [0, 5, 40, 500, 5000, 20_000])
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path, room):
    disk = FullDisk(room)
    writer = RecordWriter(tmp_path / "run.mcap", ABOUT, disk)
    writer.attach("program.rbc", bytes(3000))
    for number in range(2000):
        writer.write("/trace", number * 10**6, trace(number, "said"))
        if number % 100 == 0:
            writer.flush()
    writer.close()
    file = tmp_path / "run.mcap"
    words = f"the recording {file} ends early" if room > 400 else f"cannot write {file}"
    assert writer.failure == f"{words}: No space left on device"
    assert len(disk.octets) == room


def test_a_folder_that_is_not_there_ends_the_recording_and_nothing_else(tmp_path):
    writer = RecordWriter(tmp_path / "no" / "run.mcap", ABOUT)
    writer.write("/trace", 0, trace(0.0, "said"))
    writer.close()
    assert writer.failure is not None
    assert "No such file" in writer.failure
