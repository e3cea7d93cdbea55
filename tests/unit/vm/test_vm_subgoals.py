"""Sub-goals and actions that serve goals: what ends with a goal, and what does not."""

import pytest
from vm_hand import machine_of

from rmr.base.values import Value
from rmr.lang.compiler import compile_source
from rmr.vm import underway
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionCancelled, ActionDerived, GoalWithdrawn

pytestmark = pytest.mark.usefixtures("each_engine")

TYPES = """
order textual.
type a(robot, int). type b(robot, int). type c(robot, int). type sensor s(robot, int). type off(robot, int).
type x(robot, int). type noted(robot, int).
type action do(R: robot, N: int) -o x(R, N) else noted(R, N).
type action go(R: robot, N: int) -o s(R, N) else noted(R, N).
off(R, N) -o not ?a(R, N).
"""


def machine(rules: str) -> Machine:
    program = compile_source(TYPES + rules).program
    assert program is not None
    made = machine_of(program)
    made.start(0)
    return made


def put(made: Machine, call: str, name: str, *args: Value) -> list[object]:
    """Insert a fact or open a goal, and return the sub-goals that ended and the actions begun and cancelled."""
    index = made.program.index(name)
    assert index is not None
    getattr(made, call)(0, index, args)
    made.run(0)
    return told(made)


def told(made: Machine) -> list[object]:
    found: list[object] = []
    for event in made.drain():
        if isinstance(event, GoalWithdrawn) and event.served is not None:
            found.append((made.program.predicates[event.predicate].name, *event.args))
        elif isinstance(event, ActionDerived):
            found.append(event.serial)
        elif isinstance(event, ActionCancelled):
            found.append(-event.serial)
    return found


@pytest.mark.parametrize("end", [("insert", "a", 1), ("insert", "off", 1)], ids=["achieved", "withdrawn"])
def test_an_ended_goal_ends_its_subgoals_to_any_depth_and_cancels_their_actions(end: tuple[str, str, int]) -> None:
    made = machine("?a(R, N) -o ?b(R, N), do(R, N). ?b(R, N) -o ?c(R, N). ?c(R, N) -o do(R, N + 1).")
    assert put(made, "want", "a", 1) == [1, 2]
    assert put(made, *end) == [("b", 1), ("c", 1), -1, -2]
    assert made.goals()["open"] == []
    assert made.quiescent


def test_a_subgoal_of_two_goals_ends_with_the_last_of_them() -> None:
    made = machine("?a(R, N) -o ?b(R, 0). ?b(R, N) -o do(R, N).")
    put(made, "want", "a", 1)
    assert put(made, "want", "a", 2) == []
    assert put(made, "insert", "a", 1) == []
    assert put(made, "insert", "a", 2) == [("b", 0), -1]


@pytest.mark.parametrize("before", [True, False])
def test_a_goal_that_something_else_has_opened_too_stays_open(before: bool) -> None:
    made = machine("?a(R, N) -o ?b(R, N). ?b(R, N) -o do(R, N).")
    for name in ("b", "a") if before else ("a", "b"):
        put(made, "want", name, 1)
    assert put(made, "insert", "a", 1) == []
    assert made.goals()["open"] == ["b(@1, 1)"]


def test_goals_that_serve_each_other_do_not_keep_each_other_open() -> None:
    made = machine("?a(R, N) -o ?b(R, N). ?b(R, N) -o ?c(R, N). ?c(R, N) -o ?b(R, N).")
    put(made, "want", "a", 1)
    assert put(made, "insert", "a", 1) == [("b", 1), ("c", 1)]


def test_an_action_of_a_rule_that_reads_no_goal_goes_on() -> None:
    made = machine("x(R, N) -o do(R, N). ?a(R, N) -o ?b(R, N).")
    put(made, "want", "a", 1)
    assert put(made, "insert", "x", 1) == [1]
    assert put(made, "insert", "a", 1) == [("b", 1)]


def test_the_action_whose_sensed_effect_is_the_goal_is_completed() -> None:
    made = machine("?s(R, N) -o go(R, N), do(R, N).")
    assert put(made, "want", "s", 1) == [1, 2]
    assert put(made, "insert", "s", 1) == [-2]


def test_a_cancelled_action_derives_no_further_step_and_its_failure_has_its_else_effect() -> None:
    made = machine("?a(R, N) -o do(R, N) then do(R, N + 1).")
    put(made, "want", "a", 1)
    assert put(made, "insert", "a", 1) == [-1]
    assert made.complete(0, 1, False)
    made.run(0)
    assert told(made) == []
    assert "noted(@1, 1)" in made.facts()


def test_the_steps_after_an_action_serve_the_same_goal() -> None:
    made = machine("?a(R, N) -o do(R, N) then do(R, N + 1).")
    put(made, "want", "a", 1)
    made.complete(0, 1, True)
    assert told(made) == [2]
    assert put(made, "insert", "a", 1) == [-2]


def test_a_goal_opened_in_the_firing_that_achieves_its_goal_is_one_of_its_own() -> None:
    made = machine("$x(R, N), ?a(R, N) -o a(R, N), ?b(R, N).")
    put(made, "want", "a", 1)
    assert put(made, "insert", "x", 1) == []
    assert made.goals()["open"] == ["b(@1, 1)"]


def test_an_action_that_is_no_longer_awaited_is_not_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (underway, __import__("rmr.vm.subgoals", fromlist=["subgoals"])):
        monkeypatch.setattr(module, "ACTIONS_MAX", 2)
    made = machine("?a(R, N) -o do(R, N), do(R, N + 1), do(R, N + 2).")
    assert put(made, "want", "a", 1) == [1, 2, 3]
    assert put(made, "insert", "a", 1) == [-2, -3]
