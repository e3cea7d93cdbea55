"""The recording of `rmr up`: whole, in agreement with the report, and what is left of it when processes are killed."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from jsonschema import Draft7Validator
from launched import LABS, eventually
from mcap.reader import make_reader

from rmr.record.channels import CHANNELS, schema_of
from rmr.record.joining import join_run
from rmr.record.recording import GrowingRecording, open_recording

DASH = LABS / "dash"


@pytest.fixture
def slow_lab(tmp_path):
    """A lab whose robots need some twelve seconds."""
    folder = tmp_path / "lab"
    shutil.copytree(DASH, folder)
    path = folder / "lab.yaml"
    path.write_text(path.read_text().replace("robots:\n", "robot: {speed: 0.04}\nrobots:\n"))
    return folder


def recorded(part: Path) -> int:
    """Return how many messages a part has so far."""
    if not part.exists():
        return 0
    with open_recording(part) as recording:
        return len(list(recording.messages({"/frames"})))


@pytest.mark.slow
def test_a_finished_run_leaves_one_recording_with_every_channel(up):
    run = up(DASH)
    assert run.wait() == 0, run.out + run.err
    assert "recording" not in run.err
    assert not (run.folder / "record").exists()
    judges = {
        channel.topic: Draft7Validator(json.loads(schema_of(channel.topic)[1]))
        for channel in CHANNELS
        if channel.encoding == "json"
    }
    topics = Counter()
    minds = set()
    sent = Counter()
    with open_recording(run.folder) as recording:
        assert recording.problems == ()
        for message in recording.messages():
            topics[message.topic] += 1
            if message.topic in judges:
                judges[message.topic].validate(message.data)
            if message.topic == "/mind":
                minds.add((message.data["robot"], message.data["epoch"]))
            if message.topic == "/frames" and message.data["kind"] != "ack" and message.data["end_s"]:
                sent[message.data["source"]] += 1
        assert {"report.json", "lab.yaml", "program.rmr", "program.rbc", "floor.json"} <= set(recording.attachments)
    assert set(topics) == {channel.topic for channel in CHANNELS} - {"/faults"}
    assert minds == {(1, 0), (2, 0), (3, 0)}
    report = run.report()["robots"]
    for robot in (1, 2, 3):  # the report is a little older than the end
        assert 0 <= sent[robot] - report[str(robot)]["frames"]["sent"] <= 5
    with (run.folder / "run.mcap").open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    assert len(times) == sum(topics.values())


@pytest.mark.slow
def test_robots_that_share_a_process_share_a_file(up):
    run = up(DASH, "--processes", "2").running()
    eventually(lambda: recorded(run.folder / "record" / "robots-2-3.mcap"))
    assert run.wait() == 0, run.out + run.err
    with open_recording(run.folder) as recording:
        assert recording.problems == ()
        assert {message.data["source"] for message in recording.messages({"/frames"})} == {1, 2, 3}


@pytest.mark.slow
def test_a_recording_is_left_out_on_demand(up):
    run = up(DASH, "--no-record", "--robots", "1")
    assert run.wait() == 0, run.out + run.err
    assert not list(run.folder.rglob("*.mcap"))
    assert not (run.folder / "record").exists()


@pytest.mark.slow
def test_a_recording_may_be_elsewhere(up, tmp_path):
    run = up(DASH, "--record", str(tmp_path / "here.mcap"), "--robots", "1")
    assert run.wait() == 0, run.out + run.err
    assert not list(run.folder.rglob("*.mcap"))
    with open_recording(tmp_path / "here.mcap") as recording:
        assert recording.complete


def test_a_place_that_cannot_be_written_is_told_before_the_run(tmp_path):
    words = [sys.executable, "-P", "-m", "rmr_deploy.up", str(DASH), "--run", str(tmp_path / "run")]
    words += ["--record", str(tmp_path / "no" / "a.mcap")]
    answer = subprocess.run(words, capture_output=True, text=True, check=False)
    assert answer.returncode == 2
    assert "a.mcap: No such file or directory" in answer.stderr


@pytest.mark.slow
def test_what_a_killed_robot_has_recorded_is_kept_and_its_next_life_takes_a_file_of_its_own(up, slow_lab):
    run = up(slow_lab, "--keep-going").running()
    part = run.folder / "record" / "robots-2.mcap"
    before = eventually(lambda: recorded(part))
    os.kill(run.pids["robot-2"], signal.SIGKILL)
    eventually(lambda: "robot 2  died" in run.out)
    words = [sys.executable, "-P", "-m", "rmr_agent.main", "--id", "2", "--connect", run.endpoint]
    words += ["--secret", str(run.folder / "secret"), "--record", str(part), str(run.folder / "dash.rbc")]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        eventually((run.folder / "record" / "robots-2.1.mcap").exists)
        run.wait(80)
        process.wait(10)
    finally:
        process.kill()
        process.wait()
    assert recorded(run.folder / "run.mcap") > before
    if (run.folder / "record").exists():  # it was not a child of the launcher, which need not wait for its last word
        join_run(run.folder)
    with open_recording(run.folder) as recording:
        assert [problem for problem in recording.problems if "robots-2.mcap: the file was cut short" in problem]
        minds = {(message.data["robot"], message.data["epoch"]) for message in recording.messages({"/mind"})}
    assert minds == {(1, 0), (2, 0), (2, 1), (3, 0)}


@pytest.mark.slow
def test_a_run_whose_launcher_was_killed_is_followed_and_joined_by_hand(up, slow_lab):
    run = up(slow_lab).running()
    growing = GrowingRecording(run.folder)
    seen = growing.news()
    eventually(
        lambda: seen.extend(growing.news()) or {m.data["robot"] for m in seen if m.topic == "/mind"} == {1, 2, 3}
    )
    os.kill(run.process.pid, signal.SIGKILL)
    run.process.wait()
    eventually(lambda: not run.left())
    seen += growing.news()
    answer = subprocess.run(
        [sys.executable, "-c", "from rmr.cli import main; main()", "record", "join", str(run.folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr
    assert answer.stderr.count("was cut short") == 4
    with open_recording(run.folder) as recording:
        assert len(list(recording.messages())) == len(seen)
