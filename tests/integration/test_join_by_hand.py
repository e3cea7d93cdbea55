"""A lab started by hand, each process with a recording: joined into one run, which all verbs take."""

import shutil
import subprocess
import sys

import pytest
from command_runner import invoke
from launched import LABS
from process_tools import Stage

from rmr.bytecode import codec
from rmr.commands.record_command import command as record_command
from rmr.lang.compiler import compile_source
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import open_part, open_recording
from rmr.record.run_about import about_run
from rmr_view.recorded_source import RecordedSource

pytestmark = pytest.mark.slow

RMR = [sys.executable, "-P", "-c", "from rmr.cli import main; main()"]


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    """Return a folder with the recordings of a world and three robots that were started by hand, and have ended."""
    folder = tmp_path_factory.mktemp("hand")
    shutil.copytree(LABS / "dash", folder / "lab")
    program = compile_source((folder / "lab" / "dash.rmr").read_text()).program
    assert program is not None
    (folder / "dash.rbc").write_bytes(codec.encode(program, debug=True))
    stage = Stage(folder)
    try:
        words = ("--config", folder / "lab", "--listen", stage.endpoint, "--when-ready")
        world = stage.start("rmr_world.main", *words, "--record", folder / "world.mcap")
        agents = [
            stage.agent(robot, "--record", folder / f"robots-{robot}.mcap", program="dash.rbc") for robot in (1, 2, 3)
        ]
        for robot, agent in enumerate(agents, start=1):
            agent.wait_for(f"rmr-agent {robot}: finished at ")
        for process in (*agents, world):
            process.process.terminate()
            process.process.wait(60)
    finally:
        stage.end()
    shutil.rmtree(folder / "lab")  # the recordings stand by themselves
    return folder


def join(*words):
    return invoke(record_command, ["join", *map(str, words)], name="rmr record")


def files(folder, *robots):
    return [folder / "world.mcap", *(folder / f"robots-{robot}.mcap" for robot in robots)]


def refused(*words):
    answer = join(*words)
    assert (answer.exit_code, answer.stdout) == (3, "")
    return answer.stderr


def test_files_of_a_lab_by_hand_are_one_run_for_every_verb(hand, tmp_path):
    run = tmp_path / "new" / "run"
    answer = join(*files(hand, 1, 2, 3), "-o", run)
    assert (answer.exit_code, answer.stderr) == (0, "")
    assert all(file.exists() for file in files(hand, 1, 2, 3))
    with open_recording(run) as recording:
        assert recording.problems == ()
        assert sorted(recording.attachments) == ["floor.json", "lab.yaml", "program.rbc", "program.rmr"]
    assert "3 of 3 minds equal" in said("replay", run)
    assert "at(@1, " in said("why", run, "at(@1, X)")
    said("plot", run, "-o", tmp_path / "pictures")
    assert list((tmp_path / "pictures").iterdir())
    about = RecordedSource(run).about()  # of `rmr view`
    assert (about["lab"], about["robots"], about["program"]["name"]) == ("dash", [1, 2, 3], "dash.rmr")
    assert about["floor"]["areas"]


def said(*words):
    answer = subprocess.run([*RMR, *map(str, words)], capture_output=True, text=True, timeout=300, check=False)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    return answer.stdout + answer.stderr


def test_robots_recording_is_replayed_by_itself(hand):
    assert "1 of 1 mind equal" in said("replay", hand / "robots-2.mcap")


def test_what_is_no_run_is_refused_with_the_reason(hand, tmp_path):
    run = tmp_path / "run"
    assert "none of the files is of the world" in refused(*files(hand, 1, 2)[1:], "-o", run)
    shutil.copy(hand / "robots-1.mcap", tmp_path / "copy.mcap")
    shutil.copy(hand / "world.mcap", tmp_path / "world2.mcap")
    assert "copy.mcap are both of robot 1, at the same time" in refused(
        *files(hand, 1, 2), tmp_path / "copy.mcap", "-o", run
    )
    assert "world2.mcap are both of the world, at the same time" in refused(
        *files(hand, 1), tmp_path / "world2.mcap", "-o", run
    )
    part = open_part(hand / "world.mcap")
    about = about_run(part.about.lab, "processes", part.about.seed, part.about.roster, "robots-3", "7")
    part.scan.close()
    other = tmp_path / "robots-3.mcap"
    RecordWriter(other, about).close()
    assert f"{other} is of another run than {hand / 'world.mcap'}: run 7 of lab dash" in refused(
        *files(hand, 1), other, "-o", run
    )
    (tmp_path / "text.mcap").write_text("no recording")
    assert str(tmp_path / "text.mcap") in refused(*files(hand, 1), tmp_path / "text.mcap", "-o", run)
    assert not run.exists()


def test_robot_that_is_missing_is_told_and_the_rest_is_joined(hand, tmp_path):
    answer = join(*files(hand, 1, 2), "-o", tmp_path / "two.mcap")
    assert answer.exit_code == 0
    assert "no file of robot 3" in answer.stderr
    answer = join(*files(hand, 1, 2), "-o", tmp_path / "two.mcap")
    assert (answer.exit_code, "is there already" in answer.stderr) == (1, True)
