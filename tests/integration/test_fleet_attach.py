"""`rmr attach` upon a world and robots that were started by hand: table, report, and who is not there."""

import json
import signal

import pytest
from command_runner import invoke
from launched import LABS
from process_tools import Stage, free_endpoint

from rmr.bytecode import codec
from rmr.lang.compiler import compile_source
from rmr_deploy.fleet import command

pytestmark = pytest.mark.slow

DASH = LABS / "dash"


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    yield stage
    stage.end()


def attach(*words):
    return invoke(command(), ["attach", *map(str, words)], name="rmr")


def test_report_of_a_lab_that_was_started_by_hand_is_that_of_rmr_up(stage):
    program = compile_source((DASH / "dash.rmr").read_text()).program
    assert program is not None
    (stage.folder / "dash.rbc").write_bytes(codec.encode(program, debug=True))
    endpoint = stage.endpoint
    stage.start("rmr_world.main", "--config", DASH / "lab.yaml", "--listen", endpoint, "--when-ready")
    for robots in ("1-2", "3"):
        words = ("--id", robots, stage.folder / "dash.rbc", "--connect", endpoint, "--lab", "dash")
        stage.start("rmr_agent.main", *words)
    answer = attach(DASH, "--connect", endpoint, "--json", "--timeout", "60")
    assert answer.exit_code == 0, answer.stderr
    report = json.loads(answer.stdout)
    assert (report["lab"], report["mode"], report["finished"], report["dead"]) == ("dash", "processes", True, [])
    assert all(part["finish_s"] > 0.0 for part in report["robots"].values())
    assert report["reason"] == "every robot holds the finish fact"
    assert "robot 1  running" in answer.stderr
    assert all(started.process.poll() is None for started in stage.started), "it ends no process"


def test_a_robot_that_never_came_has_not_died(stage):
    world = stage.world("--when-ready")
    stage.agent(1, "--lab", "bench")
    watching = stage.start("rmr_deploy.fleet", "attach", stage.folder, "--connect", stage.endpoint, "--json")
    watching.wait_for("robot 1  ready")
    world.send(signal.SIGTERM)
    assert watching.exit_code() == 1
    assert "robot 2  starting" in watching.said()
    assert " mm; robot 2 never came\nthe world has ended\n" in watching.said(), "robot 1 lives"
    assert "@2         -  never came         -    -" in watching.said()
    report = json.loads(watching.said().partition("the world has ended\n")[2])
    assert (report["dead"], report["never_came"], report["stopped"]) == ([2], [2], [])


def test_a_world_that_is_gone_without_a_word_leaves_no_robot_dead(stage):
    world = stage.world("--when-ready")
    stage.agent(1, "--lab", "bench")
    watching = stage.start("rmr_deploy.fleet", "attach", stage.folder, "--connect", stage.endpoint)
    watching.wait_for("robot 1  ready")
    world.send(signal.SIGKILL)
    watching.wait_for("waiting for it to return")
    watching.send(signal.SIGINT)
    assert watching.exit_code() == 1
    assert " mm; robot 2 never came\ninterrupted; no word of the world of lab bench" in watching.said()
    assert "died" not in watching.said()


def test_world_that_is_not_there_is_told():
    endpoint = free_endpoint()
    answer = attach(DASH, "--connect", endpoint, "--timeout", "0.2")
    assert (answer.exit_code, answer.stdout) == (1, "")
    assert answer.stderr == f"rmr attach: no world of lab dash answers at {endpoint} within 0.2 s\n"


@pytest.mark.parametrize(
    ("words", "code", "why"),
    [
        ((DASH, "--connect", "here"), 2, "'here' is no endpoint"),
        ((DASH / "nothing",), 2, "there is no"),
        ((DASH / "dash.rmr",), 3, "is a program: name the lab file"),
        ((DASH, "--secret", "nowhere"), 2, "nowhere"),
        ((), 2, "missing: LAB"),
    ],
)
def test_wrong_words_are_told(words, code, why):
    answer = attach(*words)
    assert (answer.exit_code, answer.stdout) == (code, "")
    assert why in answer.stderr


def report_of(started):
    """Return the report that a started `rmr attach --json` has written after all else."""
    said = started.said()
    return json.loads(said[said.index("\n{") :])


def attached_to_a_running_lab(stage, *options):
    """Return the world of the lab `bench`, its two robots, and a `rmr attach` that shows both at work."""
    world = stage.world("--when-ready")
    agents = [stage.agent(robot) for robot in (1, 2)]
    words = ("attach", stage.folder / "lab.yaml", "--connect", stage.endpoint, "--json", *options)
    watcher = stage.start("rmr_deploy.fleet", *words)
    watcher.wait_for("robot 1  finished")
    watcher.wait_for("robot 2  running")
    return world, agents, watcher


def test_attach_to_a_world_that_dies_ends_within_its_bound_and_calls_no_robot_dead(stage):
    world, agents, watcher = attached_to_a_running_lab(stage, "--timeout", "4")
    world.end()
    assert watcher.exit_code() == 1
    report = report_of(watcher)
    known = f"no word of the world of lab bench at {stage.endpoint} for 4 s (the connection is lost); at "
    assert report["reason"].startswith(known)
    assert report["reason"].endswith(" s of lab time robots 1-2 were there")
    assert (report["finished"], report["dead"]) == (False, [])
    assert "waiting for it to return" in watcher.said()
    assert "  died" not in watcher.said()
    assert all(agent.process.poll() is None for agent in agents)


def test_attach_goes_on_with_a_world_that_returns(stage):
    world, _, watcher = attached_to_a_running_lab(stage, "--timeout", "60")
    world.send(signal.SIGSTOP)
    watcher.wait_for("waiting for it to return")
    world.send(signal.SIGCONT)
    watcher.wait_for("the world of lab bench is back")
    watcher.send(signal.SIGINT)
    assert watcher.exit_code() == 1
    assert report_of(watcher)["reason"] == "interrupted; the lab goes on"
    assert report_of(watcher)["dead"] == []
