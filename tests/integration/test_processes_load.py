"""`rmr load` upon a real world and real robots."""

import json
import re

import pytest
from command_runner import invoke
from process_tools import Stage, wait_until

from rmr.bytecode import codec
from rmr.lang.compiler import compile_source
from rmr_deploy.load import command

NEW = """
type !due(robot, float).
type note(robot, int).
note(R, {number}).
"""

KEEP = """
type !due(robot, float).
type action wait(R: robot, T: float) -o rested(R).
type !link(robot, robot).
type !got(robot, int, int).
type !gave(robot, int, int).
type step(robot, int).
type resting(robot, int).
type rested(robot).
type free(robot, int).
!link(@1, @2).
step(@1, 0).
rested(A), resting(A, N) -o step(A, N + 1).
"""
KEEP += "".join(f"free(@2, {number}).\n" for number in range(60))
PAIRS = KEEP + "step(A, N), free(B, Y), link(A, B) -o got(A, N, Y), gave(B, N, Y), resting(A, N), wait(A, 0.05).\n"


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    for name, text in (("pairs", PAIRS), ("keep", KEEP), ("again", PAIRS + "type !other(robot).\n")):
        program = compile_source(text).program
        (tmp_path / f"{name}.rbc").write_bytes(codec.encode(program, debug=False))
    for number in (1, 2, 3):
        program = compile_source(NEW.format(number=number)).program
        (tmp_path / f"new{number}.rbc").write_bytes(codec.encode(program, debug=False))
    unfit = compile_source("type note(robot, int).\nnote(R, 1).\n").program  # it has no `due`, which the lab states
    (tmp_path / "unfit.rbc").write_bytes(codec.encode(unfit, debug=False))
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


def load(stage, *words):
    """Run `rmr load` and return its exit code, standard output and standard error."""
    answer = invoke(command(), [*map(str, words), "--connect", stage.endpoint], name="rmr load")
    return answer.exit_code, answer.stdout, answer.stderr


def facts_are(stage, **wanted):
    """Wait until the robots report these facts."""
    numbers = {int(name.removeprefix("robot")): facts for name, facts in wanted.items()}

    def hold(newest):
        return all(
            robot in newest and list(newest[robot].report.get("facts", ())) == facts for robot, facts in numbers.items()
        )

    stage.statuses(hold)


@pytest.mark.slow
def test_running_robots_switch_together_and_one_that_was_away_gets_the_program_from_the_other(stage):
    stage.world()
    stage.agent(1)
    second = stage.agent(2)
    stage.statuses(lambda newest: {1, 2} <= newest.keys() and "facts" in newest[2].report)

    code, said, _ = load(stage, stage.folder / "new1.rbc", "--dry-run", "--json")
    told = json.loads(said)
    assert (code, told["switched"], told["dry_run"]) == (0, False, True)
    assert told["robots"]["1"] == {"ready": True, "problem": None, "carried": 1, "dropped": 0, "drops": ""}

    code, said, _ = load(stage, stage.folder / "new1.rbc", "--json")
    assert (code, json.loads(said)["switched"]) == (0, True)
    facts_are(stage, robot1=["!due(@1, 25.0)", "note(@1, 1)"], robot2=["note(@2, 1)"])

    second.end()
    code, said, _ = load(stage, stage.folder / "new2.rbc")
    assert code == 1
    assert said.startswith("no robot has switched: the old program goes on (1 of 2 could not)")
    assert "@2  it has not been heard: it is off, or out of reach" in said

    again = stage.agent(2)
    again.wait_for("runs program")
    assert "as it was away" in again.said()
    facts_are(stage, robot1=["!due(@1, 25.0)", "note(@1, 1)"], robot2=["note(@2, 1)"])


@pytest.mark.slow
def test_robots_distribute_a_program_over_their_own_radio(stage):
    stage.world()
    robots = [stage.agent(1), stage.agent(2)]
    stage.statuses(lambda newest: {1, 2} <= newest.keys() and "facts" in newest[2].report)
    code, said, _ = load(stage, stage.folder / "new3.rbc", "--via", "radio", "--json")
    assert (code, json.loads(said)["switched"]) == (0, True), said
    wait_until(lambda: all("runs program" in robot.said() for robot in robots))
    facts_are(stage, robot1=["!due(@1, 25.0)", "note(@1, 3)"], robot2=["note(@2, 3)"])


@pytest.mark.slow
def test_a_robot_without_a_program_waits_for_one_and_begins_with_the_facts_of_the_lab(stage):
    stage.world()
    first = stage.agent(1, program=None)
    stage.agent(2)
    first.wait_for("robot 1 waits for a program")
    stage.statuses(lambda newest: 2 in newest and "facts" in newest[2].report)
    assert load(stage, stage.folder / "unfit.rbc", "1")[0] == 1
    code, said, _ = load(stage, stage.folder / "new1.rbc")
    assert code == 0, said
    facts_are(stage, robot1=["!due(@1, 25.0)", "note(@1, 1)"], robot2=["note(@2, 1)"])


@pytest.mark.slow
def test_programs_with_rules_over_several_robots_follow_each_other_and_no_fact_is_used_twice_or_lost(stage):
    stage.world()
    robots = [stage.agent(1, program="pairs.rbc"), stage.agent(2, program="pairs.rbc")]

    def pairs(newest, robot, name):
        facts = " ".join(newest[robot].report.get("facts", ()))
        return sorted((int(n), int(y)) for n, y in re.findall(rf"{name}\(@{robot}, (\d+), (\d+)\)", facts))

    for name, least in (("again", 5), ("keep", 12), ("pairs", 12)):
        stage.statuses(lambda newest, least=least: {1, 2} <= newest.keys() and len(pairs(newest, 1, "got")) >= least)
        code, said, wrong = load(stage, stage.folder / f"{name}.rbc", "--json")
        assert (code, json.loads(said)["switched"]) == (0, True), said + wrong
    for robot in robots:
        robot.wait_for("runs program", times=3)
    newest = stage.statuses(lambda newest: {1, 2} <= newest.keys() and len(pairs(newest, 2, "gave")) == 60)
    newest = stage.statuses(lambda newest: {1, 2} <= newest.keys() and len(pairs(newest, 1, "got")) == 60)
    got = pairs(newest, 1, "got")
    assert got == pairs(newest, 2, "gave")
    assert [n for n, _ in got] == list(range(60))
    assert sorted(y for _, y in got) == list(range(60))


def test_wrong_usage_is_told_before_a_robot_hears_of_it(stage):
    code, _, said = load(stage, stage.folder / "none.rbc")
    assert (code, said) == (2, f"rmr load: there is no file {stage.folder / 'none.rbc'}\n")
    (stage.folder / "wrong.rbc").write_bytes(b"no byte-code")
    assert load(stage, stage.folder / "wrong.rbc")[0] == 3
    code, _, said = load(stage, stage.folder / "new1.rbc", "1", "--robots", "2")
    assert (code, "say ID or --robots, not both" in said) == (2, True)
    stage.world().wait_for("lab time runs")
    code, _, said = load(stage, stage.folder / "new1.rbc", "7")
    assert (code, said) == (2, "rmr load: lab bench has no robot 7; its robots are 1-2\n")
