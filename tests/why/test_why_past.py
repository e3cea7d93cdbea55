"""Restarts, runs that still go on, robots that are not recorded, and questions about another robot's facts."""

import json
import os
import subprocess
import sys

import pytest
from command_runner import invoke
from observed_runs import written

from rmr.why.question import WhyError, question
from rmr_deploy.why_program import why_command
from rmr_sim.main import main as simulate

PROGRAM = """
type mark(robot, int).
start(R).
start(R) -o mark(R, 1).
mark(R, 1), again(R) -o mark(R, 2).
type again(robot).
"""


def test_facts_of_an_earlier_incarnation_are_lost_at_the_restart_and_numbers_go_on(tmp_path, monkeypatch):
    arguments = "--robots 1 --insert '1s: again(@1)' --kill '2s: @1' --restart '3s: @1'"
    observed = written(PROGRAM, arguments, tmp_path, monkeypatch)
    lost = observed.why("mark(@1, 2)")
    assert [tree.text for tree in lost.trees] == ["mark(@1, 2)"]
    assert lost.notes == ["mark(@1, 2) was lost when robot 1 was restarted, 3.000 s"]
    present = observed.why("mark(@1, 1)")
    assert present.trees[0].at == 3 * 10**9
    assert present.notes == []
    earlier = observed.why("mark(@1, 1)", 2.5)
    assert earlier.trees[0].at == 0
    numbers = [item.number for mind in observed.past.minds(1) for item in mind.items]
    assert numbers == list(range(1, len(numbers) + 1))


def test_question_about_any_of_many_robots_is_answered_for_the_first_ten(tmp_path, monkeypatch):
    observed = written(PROGRAM, "--robots 12", tmp_path, monkeypatch)
    text = observed.why_not("mark(R, 2)")
    assert text.count("does not hold at 0.000 s: it never did") == 10
    assert text.endswith("2 more robots are not shown: name the robot\n")


def test_robot_without_a_recording_is_told_where_its_message_would_be(tmp_path, monkeypatch):
    program = "type news(robot).\nstart(@1).\nstart(R) -o news(@2).\n"
    observed = written(program, "--robots 2", tmp_path, monkeypatch)
    observed.logs[1] = []
    text = observed.text("news(@2)")
    assert "delivered by @1 (message 0), of which there is no recording" in text
    assert "nothing of robot 1 was recorded" in observed.why_not("start(@1)")


def test_fact_of_another_robot_than_the_one_asked_is_refused(tmp_path, monkeypatch):
    observed = written(PROGRAM, "--robots 2", tmp_path, monkeypatch)
    program = observed.past.program
    with pytest.raises(WhyError, match="is a fact of robot 2, not of robot 1: ask robot 2"):
        question("mark(@2, 1)", program, [1, 2], 1)
    assert question("mark(R, 1)", program, [1, 2], 1).owner == 1
    assert question("home(R, R)", observed_homes(tmp_path, monkeypatch), [1, 2], 2).matches(2, (2,)) is False


def observed_homes(tmp_path, monkeypatch):
    return written("type home(robot, robot).\nhome(@1, @2).\n", "--robots 2", tmp_path, monkeypatch).past.program


ACTIONS = """
from rmr import action

@action("look")
async def look(robot):
    await robot.sleep(0.2)
    robot.insert("seen", 3)
"""
SEEN = """
type action look(R: robot).
type sensor seen(robot, int).
start(R).
start(R) -o look(R).
seen(R, N) -o !known(R, N).
"""
LAB = """
lab: seen
program: seen.rmr
actions: actions.py
duration: 1s
arena: {size: [2.0, 1.0]}
robots: [{id: 1, pose: [0.5, 0.5, 0deg]}]
"""


@pytest.mark.medium
def test_fact_inserted_by_a_python_handler_leads_to_its_action(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in (("actions.py", ACTIONS), ("seen.rmr", SEEN), ("lab.yaml", LAB)):
        (tmp_path / name).write_text(text)
    simulate([".", "--run", "run"])
    lines = invoke(why_command(), ["run", "known(@1, _)"], name="rmr why").stdout.splitlines()
    assert lines[1].endswith("seen(@1, 3)  0.200 s  inserted by the Python handler of the action")
    assert "action look(@1)  0.000 s  by rule seen.rmr:5" in lines[2]


@pytest.mark.medium
def test_run_that_goes_on_is_asked_by_the_robots_id_and_says_until_when_it_is_known(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    simulate(["corridor", "--robots", "2", "--seed", "7", "--run", "whole"])
    folder = tmp_path / "runs" / "corridor-1"
    (folder / "record").mkdir(parents=True)
    octets = (tmp_path / "whole" / "run.mcap").read_bytes()
    (folder / "record" / "world.mcap").write_bytes(octets[: len(octets) // 2])
    (folder / "processes.json").write_text(json.dumps({"launcher": os.getpid(), "connect": "x", "processes": {}}))

    def why(*words):
        return invoke(why_command(), words, name="rmr why")

    result = why("1", "crossing(R, _)")
    assert result.exit_code == 0
    assert "crossing(@1, 32.0)  0.000 s  by rule corridor.rmr:15" in result.stdout
    assert "the recording has not been finished: robot 1 is known until " in result.stdout
    assert "robot 2, not of robot 1" in why("1", "crossing(@2, _)").stderr
    assert why("7", "crossing(R, _)").stderr.startswith("rmr why: robot 7 is not in the lab that runs, corridor")
    with subprocess.Popen([sys.executable, "-c", ""]) as launcher:
        pass
    (folder / "processes.json").write_text(json.dumps({"launcher": launcher.pid, "connect": "x", "processes": {}}))
    assert why("1", "crossing(R, _)").exit_code == 2  # the run is over
