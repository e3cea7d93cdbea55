"""`rmr up` with robots whose processes are killed for good: who finishes, who is told why not, and what is reported."""

import json
import os
import shutil
import signal

import pytest
from launched import CORRIDOR, eventually

pytestmark = pytest.mark.slow

WITHIN_S = 180.0
"""Wall time that a loaded machine may take for what takes some 40 s of lab time."""


@pytest.fixture
def lab(tmp_path):
    """Return the corridor, finished by those that live."""
    folder = tmp_path / "lab"
    shutil.copytree(CORRIDOR, folder)
    text = (folder / "lab.yaml").read_text().replace("finish: at(R, exit)", "finish: at(R, exit)\nquorum: living")
    (folder / "lab.yaml").write_text(text)
    return folder


def notes(run, robot):
    """Return the trace of a robot in its log, whole lines only."""
    path = run.folder / "logs" / f"robot-{robot}.jsonl"
    lines = path.read_text().rpartition("\n")[0].splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def noted(run, robot, what):
    return [note for note in notes(run, robot) if note.get("what") == what]


def timed(run, robot):
    return [note for note in notes(run, robot) if "t" in note]


def kill(run, robot):
    os.kill(run.pids[f"robot-{robot}"], signal.SIGKILL)


def test_living_finish_without_a_robot_that_was_killed_at_the_start(up, lab):
    run = up(lab).running()
    kill(run, 5)
    assert run.wait(WITHIN_S) == 0, run.out + run.err
    report = run.report()
    assert report["finished"]
    assert report["dead"] == [5]
    assert report["died"] == {"robot-5": -signal.SIGKILL}
    assert "robot 5 died" in run.out
    assert run.left() == []


def test_robots_behind_a_body_in_the_bottleneck_are_told_and_fail(up, lab):
    run = up(lab).running()
    robots = range(1, 7)
    first = eventually(lambda: next((one for one in robots if noted(run, one, "entered")), None), WITHIN_S)
    entered = noted(run, first, "entered")[0]["t"]
    eventually(lambda: any(note["t"] > entered + 1.5 for one in robots for note in timed(run, one)), WITHIN_S)
    kill(run, first)
    others = [one for one in robots if one != first]

    def failures():
        ended = [note["failure"] or "" for one in others for note in noted(run, one, "action_ended")]
        return [why for why in ended if f"blocked by robot {first}, which has been silent since" in why]

    assert eventually(failures, WITHIN_S)
    run.interrupt()
    run.wait(WITHIN_S)
    assert run.report()["dead"] == [first]
    assert not run.report()["finished"]
    assert run.left() == []
