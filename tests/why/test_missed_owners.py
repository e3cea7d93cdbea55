"""`rmr why RUN --missed` names the owner that acts: the delivery, the drive or the rule, not `outside`."""

import json
from contextlib import suppress

import pytest
from command_runner import invoke
from delay_runs import LABS

from rmr.base.time import seconds
from rmr.record.recording import open_recording
from rmr.why.critical_path import explained
from rmr.why.delay import TimeOwner
from rmr.why.replayed_histories import run_history
from rmr_deploy.why_program import why_command
from rmr_sim.main import main as simulate

pytestmark = pytest.mark.medium

LAB = """lab: two
program: two.rmr
duration: 50s
arena: {size: [1.5, 1.0]}
robots: [{id: 1, pose: [0.2, 0.2, 0deg]}, {id: 2, pose: [0.8, 0.2, 0deg]}]
"""


def owners(folder, program, lab=""):
    """Return the owners of the time of the missed deadline called job, the largest first: (owner, words)."""
    (folder / "two.rmr").write_text("type action broadcast(robot).\n" + program)
    (folder / "two.yaml").write_text(LAB + lab)
    with suppress(SystemExit):  # of a run that fails, as something could not be sent
        simulate([str(folder / "two.yaml"), "--seed", "3", "--run", str(folder / "run")])
    answer = invoke(why_command(), [str(folder / "run"), "--missed", "--json"], name="rmr why")
    delay = next(each for each in json.loads(answer.stdout)["delays"] if each["name"] == "job")
    return [(each["owner"], each["words"].replace(f"{folder}/", "")) for each in delay["owners"]]


def test_the_news_that_a_delivery_was_given_up_is_the_time_of_its_repeats(tmp_path):
    program = """type start(robot). type msg(robot). type undelivered(robot, robot, symbol). type !got(robot).
start(@1). job: watch(start(R), done(R), 5, broadcast(R)).
start(@1) -o msg(@2). msg(R) -o !got(R). undelivered(@1, @2, msg) -o done(@1)."""
    found = owners(tmp_path, program, "faults: [{at: 0.001, kill: 2}]\n")
    assert found[0] == ("repeats", "to robot 2 (msg(@2))")


def test_the_news_that_a_decision_was_acknowledged_is_the_time_of_its_delivery(tmp_path):
    program = """type start(robot). type wants(robot, robot). type free(robot). type got(robot).
start(@2). free(@2). wants(@1, @2). job: watch(start(R), got(R), 0.05, broadcast(R)).
wants(R, S), free(S) -o got(S)."""
    found = owners(tmp_path, program, "radio: {loss: 0.5}\n")
    assert "outside" not in dict(found)
    assert ("repeats", "to robot 1 (@1 is told that the rule has fired, rule two.rmr:4)") in found


def test_a_finish_fact_that_names_no_value_is_found(tmp_path):
    program = """type ask(robot). type start(robot).
start(@1). job: watch(start(R), done(R, _), 0.5, broadcast(R)).
type action wait(R: robot, S: float) -o waited(R).
start(R), peer(R, B) -o ask(B). ask(B) -o wait(B, 2.0). waited(B), peer(B, R) -o done(R, 7)."""
    assert owners(tmp_path, program)[0] == ("action", "robot 2: wait(@2, 2.0)")


def test_an_aggregate_that_finds_nothing_is_named_and_not_the_violation_action(tmp_path):
    program = """type bid(robot, robot, float). type award(robot, robot). type start(robot).
type action wait(R: robot, S: float) -o waited(R).
start(@1). job: watch(start(R), won(R, _), 3, broadcast(R)). start(R) -o wait(R, 1.0).
waited(R) -o [min C => Best | bid(R, B, C) | award(R, B)]. award(R, B) -o won(R, B)."""
    found = owners(tmp_path, program)
    assert found[0] == ("rule", "no rule fired after the one at two.rmr:5, which found nothing")
    assert found[1] == ("action", "wait(@1, 1.0)")


def test_the_time_for_a_turn_at_a_passage_is_that_of_the_robots_before(tmp_path):
    """A drive asks in the groups of the passages on its way, one after the other, not in that of its job's event."""
    simulate([str(LABS / "warehouse"), "--run", str(tmp_path)])
    known = run_history(open_recording(tmp_path / "run.mcap"))
    jobs = [(robot, job) for robot, history in known.robots.items() for job, _ in history.jobs]
    delays = [explained(known.robots, known.program, known.attempts, robot, job) for robot, job in jobs]
    turns = [each for delay in delays for each in delay.intervals if each.owner is TimeOwner.TURN]
    behind = sum(each.duration for each in turns if each.whom)
    assert behind > 0.8 * sum(each.duration for each in turns) > seconds(100)


WAIT = """type start(robot). type action wait(R: robot, S: float) -o waited(R, S).
start(@1). job: watch(start(R), done(R), 0.5, broadcast(R)). $start(R), not begun(R) -o !begun(R), wait(R, 2.0).
type !begun(robot). type never(robot). type early(robot). waited(R, 2.0) -o early(R).
"""
CORRIDOR = """bottleneck: entry
obstacles: [{box: [0.95, 0.0, 1.2, 0.35]}, {box: [0.95, 0.65, 1.2, 1.0]}]
areas: {entry: {at: [0.85, 0.5]}, exit: {at: [1.35, 0.5]}}
"""


def test_a_refused_message_takes_no_time_and_is_not_the_one_that_was_acknowledged_last(tmp_path):
    program = """type text(robot, string). type big(robot, list string). type !small(robot).
type undelivered(robot, robot, symbol). type go(robot). go(@1). go(R) -o small(@2).
early(R), text(R, S) -o big(@2, [S, S, S]).
undelivered(R, @2, big) -o done(R).
big(R, S) -o small(R). text(@1, "%s")."""
    found = owners(tmp_path, WAIT + program % ("x" * 3000))
    assert found == [("action", "wait(@1, 2.0)")]


def test_a_deadline_on_the_path_owns_the_time_since_its_own_job_began(tmp_path):
    program = "other: watch(early(R), never(R), 1, wait(R, 0.25)). waited(R, 0.25) -o done(R)."
    assert owners(tmp_path, WAIT + program) == [
        ("action", "wait(@1, 2.0)"),
        ("rule", "until a deadline had passed, for wait(@1, 0.25)"),
        ("action", "wait(@1, 0.25)"),
    ]


def test_a_failure_that_another_robot_has_broadcast_leads_to_what_that_robot_waited_for(tmp_path):
    program = """start(@2). other: watch(early(@2), never(@2), 1, broadcast(@2)). failed(R, @2, other) -o done(R)."""
    found = owners(tmp_path, WAIT + program)
    assert found[:2] == [
        ("action", "robot 2: wait(@2, 2.0)"),
        ("rule", "robot 2: until a deadline had passed, for broadcast(@2)"),
    ]
    assert "outside" not in dict(found)


def test_the_time_for_a_fact_turn_begins_with_the_job_that_asks_for_it(tmp_path):
    program = """type action moveto(R: robot, A: area) -o at(R, A). type sensor at(robot, area).
early(R) -o crossing(R). type crossing(robot). crossing(R) -o moveto(R, exit).
crossing: assert(crossing(R), at(R, exit), 20, broadcast(R)).
turn(R, crossing, _), not never(R) -o never(R), done(R)."""
    found = owners(tmp_path, WAIT + program, CORRIDOR)
    assert found[0] == ("action", "wait(@1, 2.0)")
    assert found[1][0] == "turn"


def test_a_robot_that_has_changed_its_program_is_not_dead_from_then_on(tmp_path):
    program = "type done(robot). waited(R, 30.0) -o done(R). start(R) -o wait(R, 30.0)."
    (tmp_path / "new.rmr").write_text(WAIT)
    job = WAIT.replace("0.5, broadcast", "20, broadcast")
    found = owners(tmp_path, job + program, "loads: [{at: 2s, program: new.rmr, robots: 1}]\n")
    assert "dead" not in dict(found)
    answer = invoke(why_command(), [str(tmp_path / "run"), "--missed", "--json"], name="rmr why")
    assert "robot 1 changed its program at 6" in json.loads(answer.stdout)["problems"][0]


def test_what_a_neighbour_has_told_leads_to_what_it_did(tmp_path):
    program = """type shared level(robot, int). type action wait(R: robot, S: float) -o rested(R).
start(@2). go(@1). job: watch(start(R), done(R), 1, broadcast(R)).
go(R) -o wait(R, 2.0). rested(R) -o level(R, 5). start(R), neighbor(R, B), level(B, 5) -o done(R)."""
    found = owners(tmp_path, program)
    assert found[0] == ("action", "robot 1: wait(@1, 2.0)"), found
    assert {owner for owner, _ in found} == {"action", "outside"}
