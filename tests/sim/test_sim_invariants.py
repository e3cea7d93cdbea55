"""Invariants of one's own: functions of the simulation, decorated in the file of events, checked at every tick."""

import re

import pytest
from lab_maker import small_lab

from rmr.base.time import seconds
from rmr_sim.event import EventError
from rmr_sim.main import main
from rmr_sim.run_setup import prepare

PROGRAM = """
type token(robot, int).
type spent(robot, int).
token(R, N), N > 1 -o spent(R, N).
"""

FILE = """
from rmr import invariant
from rmr.base.time import seconds
from rmr_sim.event import Event

class Token(Event):
    def callback(self, simulation):
        simulation.insert(1, "token", 1)

@invariant
def few_tokens(simulation):
    '''No robot holds two tokens.

    Tokens beyond that are lost.'''
    {body}

def events(lab, seed):
    return [Token(seconds(0.2)), Token(seconds(0.4))]
"""

COUNT = "return len(simulation.robots[0].facts('token')) < 2"


def simulated(tmp_path, body=COUNT, text=None):
    """Run the lab with the file of events; return the simulation."""
    simulation = prepared(tmp_path, body, text)
    simulation.run()
    return simulation


def prepared(tmp_path, body=COUNT, text=None):
    (tmp_path / "events.py").write_text(text or FILE.format(body=body))
    small_lab(tmp_path, PROGRAM, duration="1s", seed=5, events=[])
    return prepare(tmp_path, event_file=tmp_path / "events.py")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (COUNT, "No robot holds two tokens"),
        ("assert len(simulation.robots[0].facts('token')) < 2", "No robot holds two tokens"),
        ("assert len(simulation.robots[0].facts('token')) < 2, 'too many'", "too many"),
        ("return 'two' if len(simulation.robots[0].facts('token')) > 1 else None", "two"),
    ],
)
def test_a_broken_invariant_is_one_violation_at_the_tick_at_which_it_breaks(tmp_path, body, words):
    [violation] = simulated(tmp_path, body).violations
    assert violation.check == "few_tokens"
    assert violation.words == words
    assert violation.robots == ()
    assert seconds(0.4) <= violation.at < seconds(0.42)


def test_an_invariant_that_holds_again_and_breaks_again_is_another_violation(tmp_path):
    simulation = simulated(tmp_path, "return not 0.2 <= simulation.now / 1e9 % 0.5 < 0.3")
    assert [round(violation.at / 1e9, 1) for violation in simulation.violations] == [0.2, 0.7]


def test_invariants_without_events_are_a_file_of_events_too(tmp_path):
    text = "from rmr import invariant\n@invariant\ndef never(simulation):\n    assert simulation.now < 0\n"
    [violation] = simulated(tmp_path, text=text).violations
    assert (violation.check, violation.words) == ("never", "it does not hold")


def test_a_robot_that_is_dead_holds_no_fact_and_an_unknown_predicate_is_named(tmp_path):
    simulation = simulated(tmp_path)
    robot = simulation.robots[0]
    assert robot.facts("token") == [(1,), (1,)]
    with pytest.raises(ValueError, match="the program knows no predicate coin"):
        robot.facts("coin")
    robot.kill()
    assert robot.facts("token") == []


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        ("return 1 / 0", "invariant few_tokens at 0.000 s: ZeroDivisionError: division by zero ({file}:15)"),
        ("return 3", "invariant few_tokens at 0.000 s: TypeError: returned 3; None and True mean that it holds"),
        ("raise SystemExit(2)", "invariant few_tokens at 0.000 s: SystemExit: 2 ({file}:15)"),
    ],
)
def test_an_invariant_that_fails_is_reported_with_its_place(tmp_path, body, complaint):
    with pytest.raises(EventError, match=re.escape(complaint.format(file=tmp_path / "events.py"))):
        simulated(tmp_path, body)


@pytest.mark.parametrize(
    ("decorated", "complaint"),
    [
        ("invariant(3)", "TypeError: @invariant decorates a function of the simulation, not 3"),
        (
            "@invariant\nasync def late(simulation): ...",
            "TypeError: the invariant late would not run when it is called",
        ),
    ],
)
def test_what_is_no_invariant_is_refused_where_it_is_decorated(tmp_path, decorated, complaint):
    with pytest.raises(Exception, match=re.escape(complaint)):
        prepared(tmp_path, text=f"from rmr import invariant\n{decorated}\n")


@pytest.mark.medium
def test_the_command_and_a_sweep_fail_with_a_broken_invariant(tmp_path, capsys):
    prepared(tmp_path)
    arguments = [str(tmp_path), "--events", str(tmp_path / "events.py")]
    assert main([*arguments, "--run", str(tmp_path / "run")]) == 1
    assert "violation at 0.4" in (said := capsys.readouterr().err)
    assert "few_tokens: No robot holds two tokens" in said
    assert main([*arguments, "--seeds", "1-2", "--jobs", "1", "--run", str(tmp_path / "sweep")]) == 1
    assert "few_tokens" in capsys.readouterr().out
