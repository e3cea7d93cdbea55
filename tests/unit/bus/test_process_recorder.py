"""The recording of one process: it begins with its run, takes log lines, and never replaces a file."""

import logging

import pytest

from rmr.bus.process_recorder import ProcessRecorder
from rmr.record.recording import open_recording

log = logging.getLogger("rmr")


@pytest.fixture
def recorder(tmp_path):
    recorder = ProcessRecorder(tmp_path / "robots-4.mcap", "robots-4")
    level = log.level
    log.setLevel(logging.INFO)
    yield recorder
    recorder.end()
    log.setLevel(level)


def lines(path) -> list[tuple[int, str, str]]:
    with open_recording(path) as recording:
        return [(m.at, m.data["name"], m.data["message"]) for m in recording.messages({"/log"})]


def test_log_lines_from_before_the_run_are_recorded_when_it_begins(recorder, tmp_path):
    log.info("waiting for the world")
    recorder.begin("corridor", 7, (4,), 1, lambda: 5)
    log.warning("deadline missed: %s", "crossing")
    log.debug("an entry of the trace")
    recorder.end()
    log.info("too late")
    assert lines(tmp_path / "robots-4.mcap") == [
        (5, "robots-4", "waiting for the world"),
        (5, "robots-4", "deadline missed: crossing"),
    ]


def test_robots_of_one_process_share_the_recording_of_a_run(recorder):
    first = recorder.begin("corridor", 7, (4, 5), 1, lambda: 0)
    assert recorder.begin("corridor", 7, (4, 5), 1, lambda: 0) is first


def test_another_run_and_another_process_take_a_name_that_is_free(recorder, tmp_path):
    recorder.begin("corridor", 7, (4,), 1, lambda: 0)
    recorder.begin("corridor", 7, (4,), 2, lambda: 0)
    other = ProcessRecorder(tmp_path / "robots-4.mcap", "robots-4")
    other.begin("corridor", 7, (4,), 2, lambda: 0)
    other.end()
    recorder.end()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["robots-4.1.mcap", "robots-4.2.mcap", "robots-4.mcap"]
    runs = []
    for name in names:
        with open_recording(tmp_path / name) as recording:
            runs.append(recording.about.run)
    assert runs == ["2", "2", "1"]


def test_a_file_that_cannot_be_written_is_told_once_in_the_log(tmp_path, caplog):
    recorder = ProcessRecorder(tmp_path / "none" / "a.mcap", "world")
    writer = recorder.begin("corridor", 7, (4,), 1, lambda: 0)
    writer.write("/log", 0, {})
    recorder.end()
    told = [record.getMessage() for record in caplog.records]
    assert told == [f"cannot write {tmp_path / 'none' / 'a.mcap'}: No such file or directory"]
