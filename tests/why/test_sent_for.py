"""A delivery names what it is sent for: an item of the program, a finish fact, the start of a job, an action's end."""

import pytest
from observed_runs import written

from rmr.base.streams import Choices
from rmr.lang.compiler import compile_source
from rmr.vm.engines import new_machine
from rmr.vm.provenance import OUTSIDE, SENSED, GivenCause, ProvenanceLog
from rmr.why.past_items import PastAction, PastFact, PastSend

pytestmark = pytest.mark.medium


def news_of(run, robot):
    """Return for each message of a robot, in the order sent, the name of that of which it is news, and its values."""
    [mind] = run.minds(robot)
    found = []
    for sent in mind.deliveries.values():
        item = sent if isinstance(sent, PastSend) else sent.news
        found.append((type(item), mind.program.predicates[item.predicate].name, item.args))
    return found


def test_equal_facts_of_one_firing_are_two_messages(tmp_path, monkeypatch):
    program = "type go(robot). type told(robot, int).\ngo(@1).\ngo(R) -o told(@2, 7), told(@2, 7)."
    run = written(program, "--robots 2", tmp_path, monkeypatch)
    [mind] = run.minds(1)
    assert [(each.number, each.cause.chain, each.key.sequence) for each in mind.sends] == [(2, 0, 0), (3, 1, 1)]
    assert list(mind.deliveries.values()) == mind.sends


def test_the_question_about_a_finish_is_news_of_the_start_and_its_answer_of_the_finish(tmp_path, monkeypatch):
    program = """type action wait(R: robot, S: float) -o waited(R). type action broadcast(robot).
type start(robot). type done(robot). type ask(robot). job: watch(start(R), done(@2), 9, broadcast(R)).
type go(robot). go(@1). go(R) -o wait(R, 0.5). waited(R) -o start(R), ask(@2).
ask(R) -o wait(R, 1.0). waited(@2) -o done(@2)."""
    run = written(program, "--robots 2", tmp_path, monkeypatch)
    assert news_of(run, 1) == [(PastFact, "start", ()), (PastSend, "ask", ())]
    assert news_of(run, 2) == [(PastFact, "done", ())]
    texts = [[sent.text for sent in run.minds(robot)[0].deliveries.values()] for robot in (1, 2)]
    assert texts == [["job since start(@1)", "ask(@2)"], ["job by done(@2)"]]


def test_the_end_of_an_action_for_another_robot_is_news_of_that_action(tmp_path, monkeypatch):
    program = """type action wait(R: robot, S: float) -o waited(R). type go(robot). type over(robot).
go(@1). go(R) -o wait(@2, 0.5) then over(R)."""
    run = written(program, "--robots 2", tmp_path, monkeypatch)
    assert news_of(run, 1) == [(PastSend, "wait", (0.5,))]
    assert news_of(run, 2) == [(PastAction, "wait", (0.5,))]


def test_an_item_that_cannot_be_sent_is_given_up_with_its_reason(tmp_path, monkeypatch):
    program = "type go(robot). type told(robot, int).\ngo(@1).\ngo(R) -o told(@9, 7), told(@2, 8)."
    run = written(program, "--robots 2", tmp_path, monkeypatch)
    [mind] = run.minds(1)
    assert [(each.key is None, each.why) for each in mind.sends] == [(True, "no such robot"), (False, "")]


def test_an_input_has_the_cause_that_comes_with_it_and_leaves_none_to_the_next():
    log = ProvenanceLog()
    program = compile_source("type !seen(robot, int).").program
    machine = new_machine(program, 1, Choices("any"), log=log)
    machine.insert(0, 0, (1,), SENSED)
    with pytest.raises(ValueError, match="int"):
        machine.insert(0, 0, ("no number",), GivenCause("lab"))
    machine.insert(0, 0, (2,))
    assert [each.cause for each in log.records] == [SENSED, OUTSIDE]
