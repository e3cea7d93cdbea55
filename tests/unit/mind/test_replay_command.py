"""`rmr replay`: what it prints, its exit codes, and what it says of recordings that it cannot replay."""

import io
import json
import sys

import pytest
from command_runner import invoke
from mind_runs import LABS, MindRun, with_changed_octet

from rmr.commands.replay_command import Progress, command
from rmr.mind import mind_format as form
from rmr.mind import mind_versions
from rmr.node.trace import TraceLevel
from rmr.record.record_writer import RecordWriter
from rmr.record.run_about import about_run

pytestmark = pytest.mark.medium


@pytest.fixture(scope="module")
def run():
    return MindRun(LABS / "testbed", 4, chaos=True)


def written(path, run, logs=None, program=True, extra=()):
    """Write a recording of the logs of a run."""
    writer = RecordWriter(path, about_run("testbed", "simulated", 4, run.simulation.lab.roster, "sim"))
    if program:
        writer.attach("program.rbc", run.octets)
    batches = [
        (form.HEAD.unpack_from(data)[4], robot, epoch, data)
        for (robot, epoch), log in (logs or run.logs).items()
        for data in log
    ]
    for at, robot, epoch, data in sorted(batches, key=lambda each: each[0]):
        writer.mind(at, robot, epoch, data)
    for topic, message in extra:
        writer.write(topic, 0, message)
    writer.close()
    assert writer.failure is None
    return path


@pytest.fixture(scope="module")
def recording(run, tmp_path_factory):
    return written(tmp_path_factory.mktemp("equal") / "run.mcap", run)


def replay(path, *words):
    return invoke(command, [str(path), *words], name="rmr replay")


def test_an_equal_replay_of_faulty_robots_ends_with_0_and_a_line_for_each_mind(recording, run):
    answer = replay(recording)
    assert (answer.exit_code, answer.stderr) == (0, "")
    *minds, summary = answer.stdout.splitlines()
    assert len(minds) == len(run.logs) > 6
    assert all(": equal (" in line and " inputs, " in line for line in minds)
    assert minds[1].startswith("robot 1 (restart 1): equal (")
    assert summary.startswith(f"{len(minds)} of {len(minds)} minds equal: ")


def test_json_of_a_replay_tells_each_mind(recording, run):
    answer = replay(recording, "--json", "--robot", "1,3")
    found = json.loads(answer.stdout)
    assert found["equal"] is True
    assert [(each["robot"], each["epoch"]) for each in found["minds"]] == [(1, 0), (1, 1), (3, 0), (3, 1)]
    assert {"recording", "lab", "mode", "seed", "minds", "problems", "versions", "compiled"} <= set(found)
    one = found["minds"][0]
    assert (one["equal"], one["difference"], one["ended"]) == (True, None, True)
    assert one["inputs"] > 1000
    assert one["not_delivered"] == {"samples": 0, "frames": 0, "refused": 0}


def test_a_difference_ends_with_1_and_names_instant_and_values(run, tmp_path):
    log, call = with_changed_octet(run.logs[2, 0], form.ACT, 1 + 6, 5)
    path = written(tmp_path / "run.mcap", run, {**run.logs, (2, 0): log})
    answer = replay(path, "--robot", "2")
    assert answer.exit_code == 1
    lines = answer.stdout.splitlines()
    assert lines[0] == f"robot 2: differs at {call.at / 1e9:.6f} s: wheel command"
    assert [line.split(":")[0] for line in lines[1:3]] == ["  recorded", "  replayed"]
    assert lines[-1].startswith("1 of 2 minds equal")
    assert replay(path, "--robot", "2", "--to", f"{call.at / 1e9 - 0.1}").exit_code == 0
    assert replay(path, "--robot", "2", "--from", f"{call.at / 1e9 + 0.1}").exit_code == 0
    assert json.loads(replay(path, "--json").stdout)["equal"] is False


def test_the_trace_of_a_replay_with_facts_is_that_of_the_simulator(recording, tmp_path):
    from rmr_sim.run_setup import Options, load

    simulation = load(LABS / "testbed", Options(chaos=True)).simulation(4, TraceLevel.FACTS)
    simulation.run()
    expected = [entry for entry in simulation.trace() if entry["what"] != "fault"]
    assert replay(recording, "--trace", str(tmp_path / "trace")).exit_code == 0
    assert [json.loads(line) for line in (tmp_path / "trace").read_text().splitlines()] == expected
    replay(recording, "--trace", str(tmp_path / "part"), "--from", "2s", "--to", "5s")
    part = [json.loads(line) for line in (tmp_path / "part").read_text().splitlines()]
    assert part == [entry for entry in expected if 2.0 <= entry["t"] <= 5.0]


def test_engines_replay_equally(recording):
    for engine in ("interpreter", "generated"):
        assert replay(recording, "--engine", engine, "--robot", "4").exit_code == 0


def test_a_recording_of_another_version_is_told_and_not_replayed(recording, monkeypatch):
    monkeypatch.setattr(mind_versions, "versions", lambda: {**RECORDED, "python": "CPython 9.1", "libc": "musl 1"})
    answer = replay(recording, "--robot", "4")
    assert answer.exit_code == 3
    assert "robot 4: not replayed: it was recorded by another version" in answer.stdout
    python, libc, advice = answer.stderr.splitlines()
    assert python == f"another Python: recorded with {RECORDED['python']}, here it is CPython 9.1"
    assert libc.startswith("another C library: recorded with ")
    assert "replay it with the version that recorded it" in advice
    anyway = replay(recording, "--robot", "4", "--anyway")
    assert anyway.exit_code == 0
    assert "another Python" in anyway.stderr


RECORDED = mind_versions.versions()


def test_a_recording_whose_program_is_another_one_is_told(run, tmp_path):
    from rmr.bytecode.codec import encode
    from rmr.lang.compiler import compile_source

    writer = RecordWriter(tmp_path / "run.mcap", about_run("testbed", "simulated", 4, (4,), "sim"))
    writer.attach("program.rbc", encode(compile_source("a(R) -o b(R).\na(@1).").program, debug=False))
    for data in run.logs[4, 0]:
        writer.mind(0, 4, 0, data)
    writer.close()
    answer = replay(tmp_path / "run.mcap")
    assert answer.exit_code == 3
    assert answer.stderr.startswith("another program: recorded with ")


def test_a_lost_and_a_damaged_batch_are_told(run, tmp_path):
    lost = written(tmp_path / "lost.mcap", run, {(4, 0): run.logs[4, 0][:3] + run.logs[4, 0][4:]})
    answer = replay(lost)
    assert answer.exit_code == 3
    assert "robot 4: equal up to " in answer.stdout
    assert "then batch 3 of its log is missing" in answer.stdout
    data = bytearray(run.logs[4, 0][3])
    data[-9] ^= 4
    log = [*run.logs[4, 0][:3], bytes(data), *run.logs[4, 0][4:]]
    answer = replay(written(tmp_path / "damaged.mcap", run, {(4, 0): log}))
    assert (answer.exit_code, "then batch 3 of the log is damaged" in answer.stdout) == (3, True)


def test_a_log_without_an_end_is_equal_as_far_as_it_goes(run, tmp_path):
    answer = replay(written(tmp_path / "run.mcap", run, {(4, 0): run.logs[4, 0][:-1]}))
    assert answer.exit_code == 0
    assert "its log ends at " in answer.stdout


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--robot", "77"], 2, "the run has no robot 77; its robots are 1-6"),
        (["--robot", "x"], 2, "--robot"),
        (["--from", "9s", "--to", "3s"], 2, "--from lies after --to: nothing is in between"),
        (["--from", "soon"], 2, "is no duration"),
        (["--engine", "columnar"], 2, "one of interpreter, generated"),
        (["--trace", "no/such/folder/trace"], 2, "cannot write no/such/folder/trace: No such file or directory"),
    ],
)
def test_wrong_usage_is_told_in_one_sentence(recording, words, code, said):
    answer = replay(recording, *words)
    assert answer.exit_code == code
    assert said in answer.stderr
    assert answer.stdout == ""


def test_files_that_are_no_recordings_of_minds_are_told(run, tmp_path):
    assert replay(tmp_path / "nothing").exit_code == 2
    assert "there is no such file or folder" in replay(tmp_path / "nothing").stderr
    (tmp_path / "text").write_text("text")
    (tmp_path / "empty").write_text("")
    (tmp_path / "folder").mkdir()
    for name in ("text", "empty", "folder"):
        answer = replay(tmp_path / name)
        assert (answer.exit_code, answer.stdout) == (3, "")
        assert len(answer.stderr.splitlines()) == 1
    answer = replay(written(tmp_path / "program.mcap", run, program=False))
    assert (answer.exit_code, "the recording holds no program" in answer.stderr) == (3, True)
    answer = replay(written(tmp_path / "minds.mcap", run, {(9, 9): []}))
    assert (answer.exit_code, answer.stderr.endswith("it holds no mind\n")) == (3, True)
    answer = replay(written(tmp_path / "foreign.mcap", run, {(9, 9): []}, extra=[("/mind", {"robot": "x"})]))
    assert (answer.exit_code, "is none of rmr's" in answer.stderr) == (3, True)


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_replay_shows_on_a_terminal_how_much_it_has_replayed_and_cleans_up(monkeypatch):
    monkeypatch.setattr(sys, "stderr", screen := Terminal())
    with Progress(21_400_000_000) as progress:
        for at_s in (0.5, 1.2, 1.9, 2.0):
            progress.show(int(at_s * 1e9))
    shown = "".join(f"\rreplayed {second} of 21 s " for second in (0, 1, 2))
    assert screen.getvalue() == shown + "\r\033[K"
