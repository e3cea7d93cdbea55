"""Recordings as runs write them, damaged or cut: of the simulator, of durable robots, of a run's processes, joined."""

from collections import Counter, defaultdict
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest
from drawn_recordings import DrawnRecording
from record_maker import end_without_closing
from recovery_check import check, rows_in

from rmr.record.channels import BY_TOPIC
from rmr.record.joining import NothingToDoError, join_run, recover
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import PARTS_FOLDER, open_recording
from rmr.record.run_about import RunAbout
from rmr_sim.main import main as simulate

LAB = Path(__file__).parents[2] / "integration" / "labs" / "dash"
FORMS = {"plain": (), "durable": ("--durable",), "loss": ("--loss", "0.3")}
EVERY = [
    pytest.param(997, marks=pytest.mark.medium, id="each 997th octet"),
    pytest.param(211, marks=[pytest.mark.slow, pytest.mark.timeout(900)], id="each 211th octet"),
]


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A lab that ends after three seconds, with a robot that dies and comes back: its recording has several chunks."""
    folder = tmp_path_factory.mktemp("short") / "dash"
    folder.mkdir()
    (folder / "dash.rmr").write_text((LAB / "dash.rmr").read_text())
    text = (LAB / "lab.yaml").read_text().replace("duration: 40s", "duration: 3s")
    faults = "faults:\n  - {kill: 2, at: 0.1s}\n  - {restart: 2, at: 0.3s}\n"
    (folder / "lab.yaml").write_text(text + faults)
    return folder


@pytest.fixture(scope="module")
def written(short, tmp_path_factory):
    """Return the octets of a form of recording; each is made once."""
    made = {}

    def recording(form: str) -> bytes:
        if form not in made:
            folder = tmp_path_factory.mktemp(form) / "run"
            if form == "joined":
                write_parts(recording("plain"), folder)
                join_run(folder)
            else:
                simulate([str(short), "--run", str(folder), *FORMS[form]])
            made[form] = (folder / "run.mcap").read_bytes()
        return made[form]

    return recording


def held(octets: bytes, path: Path) -> DrawnRecording:
    """Return what a whole recording holds."""
    path.write_bytes(octets)
    rows, attachments = rows_in(path)
    assert len(rows) > 100
    assert attachments
    return DrawnRecording((tuple(rows),), attachments, True, None)


def robot_of(topic: str, data: dict) -> int:
    if topic == "/tf_estimates":
        return int(data["transforms"][0]["child_frame_id"].split("/")[1])
    return int(data["source"] if topic == "/frames" else data["robot"])


def write_parts(octets: bytes, folder: Path) -> None:
    """Write a simulated run as its processes would have: the world, robots 1 and 2, and robot 3, which was killed."""
    whole = folder / "whole.mcap"
    parts = folder / PARTS_FOLDER
    parts.mkdir(parents=True)
    whole.write_bytes(octets)
    told = defaultdict(list)
    with open_recording(whole) as recording:
        for raw, message in zip(recording.raw_messages(), recording.messages(), strict=True):
            of_robot = BY_TOPIC[raw.topic].written_by == "robot"
            process = ("robots-3" if robot_of(raw.topic, message.data) == 3 else "robots-1-2") if of_robot else "world"
            told[process].append((raw.topic, raw.at, raw.octets))
        for process in ("world", "robots-1-2", "robots-3"):
            writer = RecordWriter(parts / f"{process}.mcap", part_about(recording.about, process))
            for name in recording.attachments if process == "world" else ():
                writer.attach(name, recording.attachment(name))
            for number, row in zip(count(1), told[process]):
                writer.write(*row)
                if number % 20 == 0:
                    writer.flush()
            writer.flush()
            if process == "robots-3":
                end_without_closing(writer)
            else:
                writer.close()
    whole.unlink()


def part_about(whole: RunAbout, process: str) -> RunAbout:
    return replace(whole, mode="processes", process=process, run="77")


@pytest.mark.parametrize("step", EVERY)
@pytest.mark.parametrize("form", [*FORMS, "joined"])
def test_a_recording_of_a_run_with_an_octet_flipped_is_recovered_for_every_reader(written, form, step, tmp_path):
    path = tmp_path / "run.mcap"
    whole = written(form)
    recording = held(whole, path)
    recovered = 0
    for at in range(step // 2, len(whole), step):
        octets = bytearray(whole)
        octets[at] ^= (0xFF, 0x01, 0x80)[at % 3]
        recovered += check(recording, bytes(octets), path, f"octet {at}")
    assert recovered > 0.99 * (len(whole) // step)


@pytest.mark.parametrize("step", EVERY)
@pytest.mark.parametrize("form", [*FORMS, "joined"])
def test_a_recording_of_a_run_that_is_cut_is_recovered_for_every_reader_up_to_there(written, form, step, tmp_path):
    path = tmp_path / "run.mcap"
    whole = written(form)
    recording = replace(held(whole, path), finished=False)
    recovered = 0
    for length in range(step // 2, len(whole), step):
        recovered += check(recording, whole[:length], path, f"{length} octets")
    assert recovered > 0.9 * (len(whole) // step)


@pytest.mark.parametrize("step", EVERY)
def test_of_a_run_whose_one_file_is_damaged_the_files_of_the_other_processes_are_joined_whole(written, step, tmp_path):
    write_parts(written("plain"), tmp_path / "first")
    files = {file.name: file.read_bytes() for file in (tmp_path / "first" / PARTS_FOLDER).iterdir()}
    rows = {}
    for name, octets in files.items():
        part = tmp_path / name
        part.write_bytes(octets)
        with open_recording(part) as recording:
            rows[name] = Counter((raw.topic, raw.at, raw.octets) for raw in recording.raw_messages())
    every = sum(rows.values(), Counter())
    folder = tmp_path / "run"
    for name, octets in files.items():
        others = sum((rows[each] for each in rows if each != name), Counter())
        for at in range(step // 2, len(octets), step):
            flipped = bytearray(octets)
            flipped[at] ^= 0x55
            for damaged in (bytes(flipped), octets[:at]):
                where = f"{name}, octet {at}, {len(damaged)} of {len(octets)} octets"
                (folder / PARTS_FOLDER).mkdir(parents=True, exist_ok=True)
                for each, content in (files | {name: damaged}).items():
                    (folder / PARTS_FOLDER / each).write_bytes(content)
                (folder / "run.mcap").unlink(missing_ok=True)
                problems = recover(folder).problems
                got = Counter(rows_in(folder / "run.mcap")[0])
                assert others <= got, where
                named = len(damaged) == len(octets) and name != "robots-3.mcap"
                assert not named or got <= every, where
                assert got == every or any(name in problem for problem in problems), where
                for left in (folder / PARTS_FOLDER).glob("*") if (folder / PARTS_FOLDER).exists() else ():
                    assert left.name == name, f"{where}: {left}"
                    left.unlink()


def test_what_was_recovered_once_is_whole_and_may_be_damaged_and_recovered_again(written, tmp_path):
    path = tmp_path / "run.mcap"
    octets = bytearray(written("joined"))
    octets[len(octets) // 2] ^= 0xFF
    path.write_bytes(octets)
    first = recover(path)
    with pytest.raises(NothingToDoError):
        recover(path)
    again = path.read_bytes()
    recording = held(again, path)
    for at in range(100, len(again), 4999):
        octets = bytearray(again)
        octets[at] ^= 0xFF
        check(recording, bytes(octets), path, f"octet {at}")
    path.write_bytes(again[:-30])
    assert set(first.problems) <= set(recover(path).problems), "what was lost before is still told"
