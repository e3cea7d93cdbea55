"""A durable world: killed and started again it goes on as the same run, and so do its robots."""

import json
import os
import shutil
import signal
import subprocess
import sys

import pytest
from launched import CORRIDOR, LABS, eventually
from process_tools import Stage, wait_until

from rmr.bytecode import codec
from rmr.lang.compiler import compile_source

pytestmark = pytest.mark.slow

DASH = LABS / "dash"


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    program = compile_source((DASH / "dash.rmr").read_text()).program
    assert program is not None
    (tmp_path / "dash.rbc").write_bytes(codec.encode(program, debug=True))
    yield stage
    stage.end()


def world(stage, *options):
    words = ("--config", DASH, "--listen", stage.endpoint, "--when-ready", "--state", stage.folder / "world")
    return stage.start("rmr_world.main", *words, *options)


def state(stage):
    """Return what the world has written last."""
    return json.loads((stage.folder / "world" / "world.json").read_text())


@pytest.mark.parametrize("durable", [False, True])
def test_robots_go_on_where_a_killed_world_was(stage, durable):
    first = world(stage)
    agents = []
    for robot in (1, 2, 3):
        options = ("--state", stage.folder / f"state-{robot}") if durable else ()
        agents.append(stage.agent(robot, *options, program="dash.rbc"))
    words = ("attach", DASH, "--connect", stage.endpoint, "--json", "--timeout", "60")
    watcher = stage.start("rmr_deploy.fleet", *words)
    first.wait_for("lab time runs")
    wait_until(lambda: state(stage)["tick"] >= 30)
    first.end()
    before = state(stage)
    second = world(stage)
    second.wait_for("the world goes on as it was at")
    for robot, agent in enumerate(agents, start=1):
        agent.wait_for(f"the world is back; robot {robot} goes on")
    assert watcher.exit_code() == 0, watcher.said()
    said = watcher.said()
    report = json.loads(said[said.index("\n{") :])
    assert (report["finished"], report["dead"]) == (True, [])
    assert all(part["restarts"] == 0 for part in report["robots"].values())
    assert all("starts anew" not in agent.said() and agent.process.poll() is None for agent in agents)
    after = state(stage)
    assert (after["run"], after["tick"] > before["tick"]) == (before["run"], True)


def test_time_stands_between_two_lives_of_a_world_and_it_does_not_wait_for_ever_for_its_robots(stage):
    first = world(stage)
    agents = [stage.agent(robot, program="dash.rbc") for robot in (1, 2, 3)]
    first.wait_for("lab time runs")
    wait_until(lambda: state(stage)["tick"] >= 6)
    first.send(signal.SIGTERM)
    assert first.exit_code() == 0
    for agent in agents:
        agent.end()
    before = state(stage)["tick"]
    second = world(stage)
    second.wait_for("lab time runs")
    said = second.said()
    assert f"the world goes on as it was at {(before + 6) / 60:.3f} s of lab time" in said
    wait_until(lambda: state(stage)["tick"] > before + 6)


def test_a_second_world_cannot_use_the_state_of_one_that_runs(stage):
    world(stage).wait_for("lab dash, 3 robots")
    second = world(stage)
    assert second.exit_code() == 3
    assert "another world has this state; end it, or name another folder" in second.said()


# --- under `rmr up --durable`, on one machine: the router dies with the world


def pids(run, name):
    """Return the process ids of the world, or of a robot, oldest first."""
    return [pid for each, pid in run.pids.items() if each.partition(".")[0] == name]


def rmr(run, *words):
    """Carry out a verb upon `run`."""
    command = [sys.executable, "-P", "-m", "rmr", *words, "--run", str(run.folder)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def drives(run, word):
    """Wait until the trace of a robot has `word`."""
    eventually(lambda: any(f'"{word}' in log.read_text() for log in (run.folder / "logs").glob("robot-*.jsonl")))


@pytest.mark.timeout(300)
def test_a_run_whose_world_is_killed_goes_on_and_ends_as_without_that(up):
    run = up(CORRIDOR, "--durable", "--no-view").running()
    drives(run, "lineup")
    robots = {name: pid for name, pid in run.pids.items() if name != "world"}
    os.kill(run.pids["world"], signal.SIGKILL)
    eventually(lambda: "world.1" in run.pids)
    shown = rmr(run, "ps", "-a").stdout
    assert run.wait(240) == 0, run.out + run.err
    report = run.report()
    assert (report["finished"], report["dead"], report["collisions"]) == (True, [], 0)
    jobs = [job for part in report["robots"].values() for job in part["assertions"]]
    assert [job["finish_s"] is None for job in jobs] == [False] * 6
    assert (report["world"], report["died"]) == ({"restarts": 1}, {"world": -9})
    assert {part["restarts"] for part in report["robots"].values()} == {0}
    assert {name: pid for name, pid in run.pids.items() if name.startswith("robot")} == robots
    assert report["reason"] == "every robot holds the finish fact; world died on the way and came back"
    rows = [line.split()[:3] for line in shown.splitlines()]
    assert ["world", "killed", "(9)"] in rows
    assert ["world.1", "running", str(run.pids["world.1"])] in rows
    told = [json.loads(line) for line in (run.folder / "events.jsonl").read_text().splitlines()]
    assert [each["process"] for each in told if each["event"] in ("process_ended", "world_started")] == [
        "world",
        "world.1",
    ]
    info = subprocess.run(
        [sys.executable, "-P", "-m", "rmr", "plot", str(run.folder), "-o", str(run.folder / "plot.svg")],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert info.returncode == 0, info.stderr


@pytest.mark.timeout(300)
def test_a_world_that_is_killed_on_request_is_waited_for_until_it_is_started(up, tmp_path):
    lab = tmp_path / "lab"
    shutil.copytree(DASH, lab)
    file = lab / "lab.yaml"
    file.write_text(file.read_text().replace("robots:\n", "robot: {speed: 0.04}\nrobots:\n", 1))
    run = up(lab, "--durable", "--no-view").running()
    drives(run, "moveto")
    assert rmr(run, "restart", "world").stderr == (
        "rmr restart: the world lives: kill it before it is restarted; rmr restart --force stops it first\n"
    )
    assert rmr(run, "pause", "world").stderr == (
        "rmr pause: the world can be killed, stopped, started and restarted only\n"
    )
    assert rmr(run, "kill", "world").stdout == "the world is killed\n"
    assert rmr(run, "kill", "world").stderr == "rmr kill: the world is dead already\n"
    assert rmr(run, "restart", "world").stdout == "the world is started again\n"
    eventually(lambda: "lab time runs" in (run.folder / "logs" / "world.1.out").read_text())
    whose = {line.split(" s ")[1].split()[0] for line in rmr(run, "logs", "world").stdout.splitlines()}
    assert whose == {"world", "world.1", "rmr"}
    assert rmr(run, "fault", "kill", "world").stdout == "the world is killed\n"
    log = run.folder / "logs" / "world.2.jsonl"
    eventually(lambda: log.exists() and "lab time runs" in log.read_text())
    assert rmr(run, "restart", "--force", "world").stdout == "the world is started again\n"
    assert run.wait(120) == 0, run.out + run.err
    report = run.report()
    assert (report["finished"], report["world"]) == (True, {"restarts": 3})
    assert report["died"] == {"world": -9, "world.1": -9}
    faults = [{key: entry[key] for key in entry if key != "at"} for entry in report["faults"]]
    assert faults == [{"kill": "world"}, {"restart": "world"}, {"kill": "world"}, {"restart": "world"}]


@pytest.mark.timeout(300)
def test_a_world_that_dies_again_and_again_ends_the_lab(up):
    run = up(DASH, "--durable", "--keep-going", "--no-view").running()
    for number in range(6):
        eventually(lambda many=number: len(pids(run, "world")) > many)
        os.kill(pids(run, "world")[-1], signal.SIGKILL)
    assert run.wait() == 1
    report = run.report()
    assert (report["finished"], report["world"]) == (False, {"restarts": 5})
    assert report["reason"] == "the world died 6 times, and is not started again"
    assert run.left() == []


def test_a_world_that_keeps_no_state_is_not_killed_by_a_verb(up):
    run = up(DASH, "--no-view").running()
    for words in (("kill", "world"), ("fault", "kill", "world")):
        assert rmr(run, *words).stderr == (
            f"rmr {' '.join(words[:-1])}: the world keeps no state, and the run would end with it: "
            "start the lab with rmr up --durable\n"
        )
    assert rmr(run, "kill", "router").stderr == (
        "rmr kill: there is no router in this run but its world, to which all connect\n"
    )
    assert run.wait() == 0
    assert "world" not in run.report()
