"""Durable robots as real processes: killed with kill -9 again and again, they lose and double nothing."""

import os
import random
import resource
import shutil
import signal
import subprocess
import sys

import pytest
from launched import LABS, eventually
from process_tools import Stage, wait_until

from rmr.bytecode import codec
from rmr.lang.compiler import compile_source
from rmr.mind.mind_versions import is_compiled
from rmr_agent.state_files import JOURNAL

pytestmark = pytest.mark.slow

KILLS = 3
RING = """
type action wait(R: robot, T: float) -o rested(R).
type token(robot, int).
type holds(robot, int).
type rested(robot).
type !next(robot, robot).
type passed(robot, int).
type done(robot).
!next(@1, @2). !next(@2, @1).
token(R, N) -o holds(R, N), wait(R, 0.1).
rested(R), holds(R, N), !next(R, S), N < 16 -o token(S, N + 1), passed(R, N).
"""
LAB = """\
lab: bench
program: ring.rbc
arena: {size: [1.0, 1.0]}
robots: [{id: 1, pose: [0.2, 0.2, 0deg]}, {id: 2, pose: [0.8, 0.8, 0deg]}]
facts: ["token(@1, 0)"]
radio: {loss: 0.2}
duration: 10min
finish: done(R)
"""


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    (tmp_path / "lab.yaml").write_text(LAB)
    program = compile_source(RING).program
    (tmp_path / "ring.rbc").write_bytes(codec.encode(program, debug=True))
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


def facts(newest, name):
    return [fact for robot in (1, 2) for fact in newest[robot].report.get("facts", ()) if fact.startswith(f"{name}(")]


def at_the_end(newest):
    """Whether the token has gone its way, in the reports of both: each is told once a second."""
    if not {1, 2} <= newest.keys():
        return False
    return "holds(@1, 16)" in facts(newest, "holds") and len(facts(newest, "passed")) > 15


def test_a_token_survives_kill_minus_nine_of_its_holders(stage):
    chance = random.Random(5)
    stage.world()
    state = {robot: stage.folder / f"state{robot}" for robot in (1, 2)}

    def start(robot):
        return stage.agent(robot, "--state", state[robot], program="ring.rbc")

    running = {robot: start(robot) for robot in (1, 2)}
    for _ in range(KILLS):
        robot = chance.choice((1, 2))
        journal = state[robot] / JOURNAL
        wait_until(journal.exists)
        size = journal.stat().st_size
        more = chance.randrange(200, 4000)
        wait_until(lambda journal=journal, until=size + more: journal.stat().st_size > until)
        running[robot].send(signal.SIGKILL)
        running[robot].process.wait(60)
        running[robot] = start(robot)
        running[robot].wait_for("and goes on as it was at")
    newest = stage.statuses(at_the_end)
    assert len(facts(newest, "holds")) == 1
    assert facts(newest, "token") == []
    passed = sorted(int(fact.split(", ")[1][:-1]) for fact in facts(newest, "passed"))
    assert passed == list(range(16))
    assert sum(newest[robot].report["restarts"] for robot in (1, 2)) == KILLS


@pytest.mark.skipif(is_compiled(), reason="where rmr is compiled there are no snapshots")
def test_a_robot_goes_on_from_a_snapshot_and_a_damaged_one_is_passed_over(stage):
    stage.world()
    state = {robot: stage.folder / f"state{robot}" for robot in (1, 2)}

    def start(robot):
        return stage.agent(robot, "--state", state[robot], "--snapshots", "2", program="ring.rbc")

    def snapshots(robot):
        return sorted(state[robot].glob("snapshot-*[0-9]"), key=lambda path: int(path.name.split("-")[1]))

    running = {robot: start(robot) for robot in (1, 2)}
    for robot, damaged in ((1, False), (2, False), (1, True)):
        eventually(lambda robot=robot: len(snapshots(robot)) == 2 and not (state[robot] / JOURNAL).exists(), 300)
        # What takes a snapshot may outlive a killed robot for a moment, and write a newer one; one that ends does not.
        running[robot].send(signal.SIGTERM if damaged else signal.SIGKILL)
        running[robot].process.wait(60)
        newest = snapshots(robot)[-1]
        if damaged:
            newest.write_bytes(newest.read_bytes()[:-1] + b"?")
        running[robot] = start(robot)
        running[robot].wait_for("and goes on as it was at")
        said = f"{newest}: it is damaged; it is passed over, and the robot goes on from the one before"
        assert (said in running[robot].said()) == damaged
    newest = stage.statuses(at_the_end)
    assert facts(newest, "token") == []
    assert sorted(int(fact.split(", ")[1][:-1]) for fact in facts(newest, "passed")) == list(range(16))


def test_a_second_process_on_one_folder_and_a_state_of_another_robot_are_refused(stage):
    stage.world()
    first = stage.agent(1, "--state", stage.folder / "state", program="ring.rbc")
    first.wait_for("robot 1 is in lab bench")
    second = stage.agent(1, "--state", stage.folder / "state", program="ring.rbc")
    assert second.exit_code() == 3
    assert f"uses the folder (process {first.process.pid})" in second.said()
    first.send(signal.SIGTERM)
    assert first.exit_code() == 0
    other = stage.agent(2, "--state", stage.folder / "state", program="ring.rbc")
    assert other.exit_code() == 3
    assert "it holds the state of robot 1, not 2" in other.said()


def test_a_robot_of_a_durable_run_that_is_started_by_hand_goes_on_with_its_drive(up, tmp_path):
    lab = tmp_path / "lab"
    shutil.copytree(LABS / "dash", lab)
    file = lab / "lab.yaml"
    file.write_text(file.read_text().replace("robots:\n", "robot: {speed: 0.04}\nrobots:\n", 1))
    run = up(lab, "--durable", "--keep-going", "--no-view").running()
    states = run.folder / "state"
    assert sorted(path.name for path in states.iterdir()) == ["1", "2", "3", "world"]
    eventually(lambda: (states / "2" / JOURNAL).stat().st_size > 10_000, 60)
    os.kill(run.pids["robot-2"], signal.SIGKILL)
    eventually(lambda: "robot 2  died" in run.out, 60)
    words = ["--id", "2", "--connect", run.endpoint, "--secret", run.folder / "secret", "--state", states / "2"]
    words = [sys.executable, "-P", "-m", "rmr_agent.main", *map(str, words), str(run.folder / "dash.rbc")]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        assert run.wait(80) == 1, "a process died"
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    assert "and goes on as it was at" in said
    report = run.report()
    assert report["finished"], run.out
    robot = report["robots"]["2"]
    assert (robot["restarts"], robot["resumed"]) == (1, True)
    assert len(robot["actions"]) == len(report["robots"]["1"]["actions"]), "its drive has not begun a second time"
    assert report["collisions"] == 0
    assert run.left() == []


def test_a_robot_whose_disk_is_full_stops_and_says_so(stage):
    stage.world()
    robot = stage.agent(1, "--state", stage.folder / "state", program="ring.rbc")
    robot.wait_for("robot 1 is in lab bench")
    limit = (stage.folder / "state" / JOURNAL).stat().st_size + 3000
    # Beyond this size a write fails with EFBIG, as one on a full disk fails with ENOSPC.
    resource.prlimit(robot.process.pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    assert robot.exit_code() == 1
    assert "the robot's state cannot be written to" in robot.said()
    assert "the robot has stopped before anything left it that is not on disk" in robot.said()
