"""The recording of `rmr sim`: the same for the same seed, valid, and in agreement with the report."""

import json
import resource
import subprocess
import sys
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

from rmr.record.channels import CHANNELS, schema_of
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import open_recording
from rmr_sim.main import main

LABS = Path(__file__).parents[2] / "deploy" / "labs"
CORRIDOR = str(LABS / "corridor")


@pytest.fixture(scope="module")
def disturbed(tmp_path_factory):
    """The folder of a run with faults of all kinds drawn from its seed."""
    folder = tmp_path_factory.mktemp("sim") / "run"
    code = main([CORRIDOR, "--seed", "1", "--robots", "3", "--chaos", "--run", str(folder)])
    assert code in (0, 1)
    return folder


def test_two_recordings_of_a_seed_are_equal_to_the_octet(disturbed, tmp_path):
    main([CORRIDOR, "--seed", "1", "--robots", "3", "--chaos", "--run", str(tmp_path / "run")])
    assert (tmp_path / "run" / "run.mcap").read_bytes() == (disturbed / "run.mcap").read_bytes()


def test_every_message_is_valid_under_the_schema_of_its_channel(disturbed):
    judges = {
        channel.topic: Draft7Validator(json.loads(schema_of(channel.topic)[1]))
        for channel in CHANNELS
        if channel.encoding == "json"
    }
    topics = set()
    with open_recording(disturbed) as recording:
        for message in recording.messages():
            topics.add(message.topic)
            if message.topic in judges:
                judges[message.topic].validate(message.data)
        assert recording.problems == ()
    assert topics >= {"/tf", "/tf_estimates", "/scene", "/floor", "/trace", "/routes", "/frames", "/faults", "/status"}


def test_frames_agree_with_the_counters_of_the_report(disturbed):
    report = json.loads((disturbed / "report.json").read_text())
    sent = Counter()
    outcomes = Counter()
    with open_recording(disturbed) as recording:
        for message in recording.messages({"/frames"}):
            frame = message.data
            if frame["start_s"] is not None:
                assert frame["start_s"] < frame["end_s"]
                sent[frame["source"], frame["kind"] == "ack"] += 1
                if frame["kind"] != "ack":
                    assert frame["asked_s"] <= frame["start_s"]
            if frame["outcome"]:
                outcomes[frame["source"], frame["outcome"]] += 1
    for robot, part in report["robots"].items():
        counted = part["frames"]
        number = int(robot)
        assert sent[number, False] == counted["sent"]
        assert outcomes[number, "no_ack"] == counted["no_ack"]
        assert outcomes[number, "access_failure"] == counted["access_failed"]


def test_poses_come_ten_times_a_second_and_end_where_the_run_ends(disturbed):
    with open_recording(disturbed) as recording:
        instants = [message.at for message in recording.messages({"/tf"})]
        last = recording.span[1]
    steps = Counter(round((b - a) / 1e8) for a, b in pairwise(instants))
    assert steps.most_common(1)[0][0] == 1
    assert max(steps) <= 11
    assert last - instants[-1] < 1.1e9


def test_the_recording_carries_what_it_was_made_of(disturbed):
    with open_recording(disturbed) as recording:
        assert recording.about.lab == "corridor"
        assert recording.about.seed == 1
        assert recording.about.roster == (1, 2, 3)
        assert recording.attachment("report.json") == (disturbed / "report.json").read_bytes()
        assert recording.attachment("lab.yaml") == (LABS / "corridor" / "lab.yaml").read_bytes()
        assert recording.attachment("program.rmr") == (LABS / "corridor" / "corridor.rmr").read_bytes()
        assert recording.attachment("program.rbc")


def test_a_recording_changes_neither_report_nor_trace(disturbed, tmp_path):
    options = ["--seed", "1", "--robots", "3", "--chaos", "--no-record"]
    main([CORRIDOR, *options, "--run", str(tmp_path / "run"), "--trace", str(tmp_path / "trace")])
    assert (tmp_path / "run" / "report.json").read_bytes() == (disturbed / "report.json").read_bytes()
    assert not (tmp_path / "run" / "run.mcap").exists()


def test_a_recording_may_be_elsewhere(tmp_path):
    assert main([CORRIDOR, "--robots", "1", "--run", str(tmp_path / "run"), "--record", str(tmp_path / "a.mcap")]) == 0
    assert not (tmp_path / "run" / "run.mcap").exists()
    with open_recording(tmp_path / "a.mcap") as recording:
        assert recording.complete


def test_a_place_that_cannot_be_written_is_told_before_the_run(tmp_path, capsys):
    file = tmp_path / "no such folder" / "a.mcap"
    assert main([CORRIDOR, "--robots", "1", "--run", str(tmp_path / "run"), "--record", str(file)]) == 2
    assert f"cannot write {file}: No such file or directory" in capsys.readouterr().err
    assert not (tmp_path / "run" / "report.json").exists()


@pytest.mark.parametrize("options", [["--seeds", "1-2", "--record", "a"], ["--record", "a", "--no-record"]])
def test_options_that_contradict_each_other_are_wrong_usage(options, capsys):
    assert main([CORRIDOR, *options]) == 2
    assert "--record" in capsys.readouterr().err


def test_a_disk_that_is_full_ends_the_recording_and_not_the_run(tmp_path):
    folder = tmp_path / "run"
    words = [sys.executable, "-m", "rmr_sim.main", CORRIDOR, "--robots", "3", "--run", str(folder)]
    limit = 60_000

    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    answer = subprocess.run(words, preexec_fn=small_files, capture_output=True, text=True, check=False)
    assert answer.returncode == 0
    assert answer.stderr.count("ends early: File too large") == 1
    assert json.loads((folder / "report.json").read_text())["finished"]
    with open_recording(folder) as recording:
        assert len(list(recording.messages())) > 100
        assert "was cut short" in recording.problems[0]


def test_a_sweep_records_nothing(tmp_path):
    assert main([CORRIDOR, "--robots", "1", "--seeds", "1-2", "--jobs", "1", "--run", str(tmp_path / "run")]) == 0
    assert not list((tmp_path / "run").rglob("*.mcap"))
    with pytest.raises(RecordingError, match="--no-record"):
        open_recording(tmp_path / "run")
