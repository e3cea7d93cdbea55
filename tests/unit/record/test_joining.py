"""The files of a run's processes become one; what is missing is told."""

import pytest
from mcap.reader import make_reader
from record_maker import about, end_without_closing, trace, write_part

from rmr.base.time import seconds
from rmr.record.joining import NothingToDoError, join_files, join_run, recover
from rmr.record.mcap_scan import RecordingError
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import GrowingRecording, open_recording


@pytest.fixture
def run(tmp_path):
    """A run of three robots, of which the third was killed."""
    (tmp_path / "report.json").write_text('{"lab": "corridor"}')
    write_part(tmp_path / "record" / "world.mcap", "world", run="5", robot=0)
    write_part(tmp_path / "record" / "launcher.mcap", "launcher", messages=0)
    write_part(tmp_path / "record" / "robots-1-2.mcap", "robots-1-2", run="5", robot=1)
    write_part(tmp_path / "record" / "robots-3.mcap", "robots-3", run="5", robot=3, messages=150, finish=False)
    return tmp_path


def test_the_joined_file_has_all_messages_in_order_of_time(run):
    joined = join_run(run)
    assert joined.messages == 300 + 300 + 100
    with joined.file.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        in_file = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    assert in_file == sorted(in_file)
    with open_recording(run) as recording:
        assert [message.at for message in recording.messages()] == in_file
        assert recording.about.process == "joined"
        assert recording.attachment("report.json") == b'{"lab": "corridor"}'


def test_joining_removes_the_parts(run):
    join_run(run)
    assert not (run / "record").exists()
    with pytest.raises(NothingToDoError):
        join_run(run)


def test_the_joined_file_tells_what_is_missing_in_its_parts(run):
    (run / "record" / "robots-1-2.mcap").unlink()
    problems = join_run(run).problems
    assert [problem for problem in problems if "no file of robots 1-2" in problem]
    assert [problem for problem in problems if "robots-3.mcap: the file was cut short" in problem]
    with open_recording(run) as recording:
        assert recording.problems == problems


def test_a_run_is_read_before_it_is_joined(run):
    with open_recording(run) as recording:
        before = list(recording.messages())
    join_run(run)
    with open_recording(run) as recording:
        assert list(recording.messages()) == before


def test_a_part_of_another_run_is_left_out_and_kept(run):
    stranger = write_part(run / "record" / "robots-9.mcap", "robots-9", run="6", robot=9)
    joined = join_run(run)
    assert joined.messages == 700
    assert f"{stranger}: of another run; it is left out" in joined.problems
    assert stranger.exists()


def test_the_file_of_a_process_that_is_still_writing_stays_and_is_joined_later(run):
    late = RecordWriter(run / "record" / "robots-3.1.mcap", about("robots-3", "5"))
    late.write("/trace", 5, trace(0.0, 3))
    late.flush()
    first = join_run(run)
    assert any("a process is still writing it" in problem for problem in first.problems)
    assert late.path.exists()
    with pytest.raises(RecordingError, match="end the run first"):
        join_run(run)
    late.close()
    assert join_run(run).messages == first.messages + 1
    assert not late.path.exists()


def test_a_part_that_could_not_be_removed_is_not_joined_twice(run):
    part = run / "record" / "robots-1-2.mcap"
    octets = part.read_bytes()
    join_run(run)
    part.parent.mkdir()
    part.write_bytes(octets)
    with pytest.raises(NothingToDoError):
        join_run(run)
    assert not part.exists()


def test_nothing_is_removed_where_the_joined_file_cannot_be_written(run):
    with pytest.raises(RecordingError, match="cannot write"):
        join_run(run, run / "no such folder" / "run.mcap")
    assert len(list((run / "record").iterdir())) == 4
    assert not (run / "run.mcap").exists()


def test_a_folder_without_a_recording_is_told(tmp_path):
    with pytest.raises(RecordingError, match="--no-record"):
        join_run(tmp_path)


def test_a_file_cut_short_gets_its_index_back(tmp_path):
    path = write_part(tmp_path / "run.mcap", "sim", messages=250, finish=False)
    with path.open("ab") as file:
        file.write(b"\x06 the beginning of a chunk")
    found = recover(path)
    assert found.messages == 200
    assert "26 octets at its end are no whole record" in found.problems[0]
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 200
    with pytest.raises(NothingToDoError):
        recover(path)


def test_recovering_a_run_joins_what_is_left(run):
    assert recover(run).messages == 700


def test_a_growing_recording_gives_each_message_once(tmp_path):
    with pytest.raises(RecordingError):
        GrowingRecording(tmp_path)
    (tmp_path / "record").mkdir()
    world = RecordWriter(tmp_path / "record" / "world.mcap", about("world", "5"))
    growing = GrowingRecording(tmp_path)
    assert growing.news() == []
    world.write("/trace", 1, trace(0.0))
    assert growing.news() == []
    world.flush()
    assert [message.at for message in growing.news()] == [1]
    robot = RecordWriter(tmp_path / "record" / "robots-1.mcap", about("robots-1", "5"))
    robot.write("/status", 7, {"robot": 1})
    robot.flush()
    world.write("/trace", 9, trace(0.0))
    world.close()
    assert [(message.topic, message.at) for message in growing.news()] == [("/status", 7), ("/trace", 9)]
    assert growing.news() == []
    join_run(tmp_path)
    assert [message.at for message in growing.messages()] == [1, 7, 9]
    end_without_closing(robot)


def test_a_robot_that_was_started_again_is_joined_although_it_spoke_before_it_knew_lab_time(tmp_path):
    write_part(tmp_path / "world.mcap", "world", run="5", robot=0)
    for name, begin_s in (("robots-1", 0.5), ("robots-1.1", 2.0)):
        writer = RecordWriter(tmp_path / f"{name}.mcap", about("robots-1", run="5"))
        for at_s in (0.0, begin_s, begin_s + 1.0):
            writer.write("/trace", seconds(at_s), trace(at_s))
        writer.close()
    joined = join_files(sorted(tmp_path.glob("*.mcap")), tmp_path / "joined")
    assert joined.messages == 300 + 6
    (tmp_path / "copy.mcap").write_bytes((tmp_path / "robots-1.1.mcap").read_bytes())
    with pytest.raises(RecordingError, match=r"are both of robot 1, at the same time: leave one out"):
        join_files(sorted(tmp_path.glob("*.mcap")), tmp_path / "again")
