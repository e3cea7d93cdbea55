"""`rmr fault` upon a real world and real robots."""

import json

import pytest
from command_runner import invoke
from process_tools import Stage

from rmr_deploy.fault import command


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


def fault(stage, *words):
    """Run `rmr fault` and return its exit code, standard output and standard error."""
    answer = invoke(command(), [*words, "--connect", stage.endpoint], name="rmr fault")
    return answer.exit_code, answer.stdout, answer.stderr


def frames(newest):
    """Return (sent, received) of robots 1 and 2; nothing before both run."""
    parts = [newest[robot].report.get("frames") for robot in (1, 2) if robot in newest]
    return [(part["sent"], part["received"]) for part in parts if part]


def test_partition_cuts_off_present_and_later_robots_and_clear_heals_it(stage):
    stage.world()
    stage.agent(1)
    stage.statuses(lambda newest: 1 in newest and newest[1].state == "finished")
    code, said, _ = fault(stage, "partition", "1/2", "--json")
    assert code == 0
    told = json.loads(said)
    assert (told["lab"], [each["by"] for each in told["disturbances"]]) == ("bench", ["rmr fault"])
    stage.agent(2)
    silent = stage.statuses(lambda newest: len(frames(newest)) == 2 and all(sent > 1 for sent, _ in frames(newest)))
    assert [received for _, received in frames(silent)] == [0, 0]
    assert fault(stage, "clear")[0] == 0
    stage.statuses(lambda newest: len(frames(newest)) == 2 and all(received for _, received in frames(newest)))
    assert fault(stage, "list")[1].endswith(": nothing disturbs the radio\n")


def test_fault_for_unknown_robots_is_refused_and_not_published(stage):
    world = stage.world()
    world.wait_for("lab time runs")
    assert fault(stage, "link", "1,7", "--cut") == (
        2,
        "",
        "rmr fault: lab bench has no robot 7; its robots are 1, 2\n",
    )
    code, _, said = fault(stage, "list", "--lab", "other")
    assert (code, said) == (
        1,
        f"rmr fault: no world of lab other answers at {stage.endpoint}, though a zenoh router does\n",
    )
    world.end()
    assert fault(stage, "list") == (1, "", f"rmr fault: nobody listens at {stage.endpoint}\n")


def test_fault_with_several_labs_at_one_router_requires_a_choice(stage):
    stage.world().wait_for("lab time runs")
    other = stage.folder / "other.yaml"
    other.write_text((stage.folder / "lab.yaml").read_text().replace("lab: bench", "lab: other"))
    stage.start("rmr_world.main", "--config", other, "--connect", stage.endpoint).wait_for("lab time runs")
    code, _, said = fault(stage, "radio", "--loss", "1")
    assert (code, said) == (2, f"rmr fault: several labs run at {stage.endpoint}: bench, other; choose with --lab\n")
    assert fault(stage, "radio", "--loss", "1", "--lab", "other")[0] == 0
    held = [json.loads(fault(stage, "list", "--lab", lab, "--json")[1]) for lab in ("bench", "other")]
    assert [len(one["disturbances"]) for one in held] == [0, 1]
