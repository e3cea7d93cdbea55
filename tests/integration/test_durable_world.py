"""A durable world: killed and started again it goes on as the same run, and so do its robots."""

import json
import signal

import pytest
from launched import LABS
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
