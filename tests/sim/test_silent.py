"""The provided fact `silent(R, N)`: which robots are heard no more, in a lab and in an evaluation."""

import pytest
from lab_maker import small_lab, traced

from rmr.base.time import in_seconds
from rmr.eval.api import evaluate
from rmr.node.motion.hearing import DEAD

NOTES = """
    type silent_since(robot, robot).
    type back(robot, robot).
    silent(R, N) -o silent_since(R, N).
    silent_since(R, N), not silent(R, N) -o back(R, N).
"""
DEAD_S = in_seconds(DEAD)
HELLOS_S = 1.0
"""A robot that stands says hello, and so is called, at least as often."""


def facts(simulation) -> list[list[str]]:
    return [[f for f in each.node.machine.facts() if "silent" in f or "back" in f] for each in simulation.robots]


def test_a_killed_robot_is_silent_15_s_after_its_last_word_and_until_it_is_heard_again(tmp_path):
    killed = "[{at: 5s, kill: 2}]"
    run = small_lab(tmp_path, NOTES, robots=3, faults=killed, duration="19s")
    run.run()
    assert facts(run) == [[], [], []], "not yet"
    run = small_lab(tmp_path, NOTES, robots=3, faults=killed, duration=f"{5 + DEAD_S + HELLOS_S}s")
    run.run()
    assert [facts(run)[robot] for robot in (0, 2)] == [
        ["silent_since(@1, @2)"],
        ["silent_since(@3, @2)"],
    ]
    again = "[{at: 5s, kill: 2}, {at: 30s, restart: 2}]"
    run = small_lab(tmp_path, NOTES, robots=3, faults=again, duration="33s")
    run.run()
    assert facts(run) == [["back(@1, @2)"], [], ["back(@3, @2)"]]


def test_a_robot_that_was_never_heard_is_silent_15_s_after_the_own_beginning(tmp_path):
    run = small_lab(tmp_path, NOTES, robots=2, faults="[{at: 0s, kill: 2}]", duration=f"{DEAD_S - 0.1}s")
    run.run()
    assert facts(run)[0] == []
    run = small_lab(tmp_path, NOTES, robots=2, faults="[{at: 0s, kill: 2}]", duration=f"{DEAD_S + HELLOS_S}s")
    run.run()
    assert facts(run)[0] == ["silent_since(@1, @2)"]


def test_a_robot_that_a_third_one_hears_is_not_silent(tmp_path):
    cut = "[{from: 1s, to: 40s, link: [1, 2], cut: true}]"
    run = small_lab(tmp_path, NOTES, robots=3, faults=cut, duration="40s")
    run.run()
    assert facts(run) == [[], [], []], "robot 3 lists robots 1 and 2 to each other"


def test_a_lab_whose_program_asks_for_silence_alone_has_bodies_that_say_hello(tmp_path):
    run = small_lab(tmp_path, "type seen(robot, robot).\nsilent(R, N) -o seen(R, N).\n", robots=2, duration="20s")
    run.run()
    assert traced(run, "fired") == []


@pytest.mark.parametrize("restart", ["17s", "30s"])
def test_in_an_evaluation_the_run_goes_on_until_a_killed_robot_is_silent(restart):
    program = "\n".join(line.strip() for line in NOTES.splitlines())
    report = evaluate(program, robots=3, kill=["5s: @2"]).report
    assert report["time_s"] == 5 + DEAD_S
    assert [report["robots"][robot]["facts"] for robot in ("1", "3")] == [
        ["silent_since(@1, @2)"],
        ["silent_since(@3, @2)"],
    ]
    report = evaluate(program, robots=3, kill=["5s: @2"], restart=[f"{restart}: @2"]).report
    back = ["back(@1, @2)"] if restart == "30s" else []
    assert report["robots"]["1"]["facts"] == back, "a robot that is back within 15 s was never silent"


def test_a_robot_out_of_range_from_the_beginning_is_not_silent():
    program = "\n".join(line.strip() for line in NOTES.splitlines())
    report = evaluate(program, robots=3, topology="line", kill=["5s: @3"]).report
    assert report["robots"]["1"]["facts"] == []
    assert report["robots"]["2"]["facts"] == ["silent_since(@2, @3)"]


@pytest.mark.parametrize("program", [NOTES, "type go(robot).\ngo(R).\n"], ids=["asks", "does not"])
def test_asking_for_silence_keeps_no_news_of_a_death_from_the_drive(tmp_path, program):
    """That a robot has died is told by no hello: the node looks once whether that has changed, for its navigator."""
    run = small_lab(tmp_path, program, robots=2, faults="[{at: 1s, kill: 2}]", duration="18s")
    run.run()
    assert run.robots[0].node.peers.changes(run.now)
