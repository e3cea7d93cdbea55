"""Which rules lead to which goals, as the compiler finds out; that robots find the same is a property."""

import pytest
from lang_source import compiled

from rmr.lang.lower import goal_paths
from rmr.lang.lower.goal_paths import GoalPaths, TooMuch


def leads(text: str, goal: int = 0) -> dict[int, int | None] | None:
    """Return the ranks of the rules that are written down for a goal."""
    found = compiled(text).goals[goal].leads
    return None if found is None else {lead.rule: lead.rank for lead in found}


def ways(text: str) -> dict[int, int | None]:
    """Return the ranks of the rules that lead to the first goal, written down or not."""
    program = compiled(text)
    return {way.rule: way.rank for way in GoalPaths(program).ways(program.goals[0])}


def test_a_rank_counts_the_firings_that_are_still_needed() -> None:
    assert leads("?g(R). a(R). a(R) -o b(R). b(R) -o c(R). c(R) -o g(R). b(R) -o x(R). x(R) -o 1.") == {
        0: 2,
        1: 1,
        2: 0,
    }


def test_constants_decide_where_they_are_known() -> None:
    text = "?in(R, c). in(R, a). in(R, a) -o in(R, b). in(R, b) -o in(R, c). in(R, a) -o in(R, d)."
    assert leads(text) == {0: 1, 1: 0}


def test_a_rank_that_depends_on_the_match_is_left_to_the_robot() -> None:
    text = (
        "?at(R, c). go(R). near(R, c). go(R), near(R, X) -o at(R, X). at(R, a) -o at(R, c). $go(R) -o x(R). x(R) -o 1."
    )
    assert leads(text) == {0: None, 1: 0}


def test_ranks_of_a_goal_are_omitted_when_most_depend_on_the_match() -> None:
    text = "?at(R, c). go(R). near(R, c). go(R), near(R, X) -o at(R, X)."
    assert leads(text) is None
    assert ways(text) == {0: None}


def test_a_goal_that_nothing_reaches_has_no_leads_and_needs_no_search() -> None:
    assert leads("?at(R, c). at(R, a). at(R, a) -o at(R, b). at(R, b) -o at(R, a).") == {}


def test_heads_of_comprehensions_do_not_count_towards_a_goal_rank() -> None:
    text = "?g(R, 1). t(R). n(R, 1). $t(R) -o {N | n(R, N) | g(R, 1)}. t(R) -o {N | n(R, N) | g(R, 2)}."
    assert ways(text) == {0: None}
    assert ways(text.replace("{N | n(R, N) | g(R, 1)}", "{N | n(R, N) | g(R, 1)}, g(R, 1)")) == {0: 0}


def test_a_count_may_be_any_number() -> None:
    assert ways("?g(R, 3). t(R). n(R). t(R) -o [count => N | n(R) | g(R, N)]. n(R) -o t(R).") == {0: None, 1: None}


def test_every_step_counts() -> None:
    text = "type action look(robot). ?g(R). t(R). t(R) -o look(R) then b(R). b(R) -o look(R) then g(R)."
    assert leads(text) == {0: 1, 1: 0}


def test_goal_ranks_pass_through_action_effects_unless_they_may_have_no_value() -> None:
    text = """
    type action go(R: robot, N: int) -o over(R, 8 / N), gone(R).
    ?{}. t(R). t(R) -o go(R, 2). t(R) -o x(R). x(R) -o 1.
    """
    assert ways(text.format("gone(R)")) == {0: 0}
    assert ways(text.format("over(R, 4.0)")) == {0: None}


def test_a_fact_for_another_robot_leads_nowhere_but_one_for_a_variable_may_stay() -> None:
    text = "type peer(robot, robot). ?g(R). t(R). t(R), peer(R, B) -o g(B). t(R) -o g(@4). t(R) -o g(R)."
    assert ways(text) == {0: None, 1: None, 2: 0}
    assert ways(text.replace("?g(R)", "?g(@4)")) == {0: None, 1: 0, 2: 0}
    assert ways(text.replace("?g(R)", "?g(@5)")) == {0: None, 2: 0}


def test_a_rule_of_one_robot_leads_on_at_that_robot_only() -> None:
    text = "?g(R). a(@1) -o g(@1). b(R) -o a(R). b(R). a(R)."
    assert ways(text) == {0: 0, 1: None}
    assert ways(text.replace("?g(R)", "?g(@1)")) == {0: 0, 1: 1}
    assert ways(text.replace("?g(R)", "?g(@2)")) == {}


def test_own_robot_is_no_constant_in_goal_ranks() -> None:
    text = "?link(R, R). t(R). t(R) -o link(R, R). t(R) -o link(R, @2)."
    assert ways(text) == {0: 0, 1: None}
    assert ways(text.replace("?link(R, R)", "?link(@2, @2)")) == {0: 0, 1: 0}


def test_the_same_variable_twice_wants_the_same_twice() -> None:
    text = "?p(R, X, X). t(R, 1). t(R, N) -o p(R, 1, 1). t(R, N) -o p(R, 1, 2). t(R, N) -o p(R, N, 1)."
    assert ways(text) == {0: 0, 2: None}


def test_conditions_that_contradict_each_other_lead_nowhere() -> None:
    assert ways("?g(R). a(R, 1). a(R, X), X = 1, X = 2 -o g(R).") == {}


def test_goal_search_work_is_bounded_and_the_rest_is_left_to_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    text = " ".join(["?p(R, 30).", *(f"p(R, {n}) -o p(R, {n + 1})." for n in range(30)), "?q(R).", "p(R, 0) -o q(R)."])
    assert leads(text) is not None
    monkeypatch.setattr(goal_paths, "COMPARISONS_MAX", 20)
    assert (leads(text), leads(text, 1)) == (None, None)
    monkeypatch.undo()
    monkeypatch.setattr(goal_paths, "STEPS_MAX", 50)
    assert (leads(text), leads(text, 1)) == (None, None)
    program = compiled(text)
    with pytest.raises(TooMuch):
        GoalPaths(program).ways(program.goals[0])


def test_goal_search_stops_when_its_work_bound_is_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goal_paths, "STEPS_MAX", 10)
    program = compiled("".join(f"p(R, {i}) -o p(R, {i + 1}). ?p(R, {i}). " for i in range(20)) + "p(R, 0).")
    found = GoalPaths(program)
    with pytest.raises(TooMuch):
        found.ways(program.goals[-1])
    monkeypatch.setattr(goal_paths, "Levels", None)
    for goal in program.goals:
        assert found.leads(goal) is None


def test_size_of_goal_ranks_is_proportional_to_the_program() -> None:
    chain = " ".join(f"p(R, {n}) -o p(R, {n + 1})." for n in range(9))
    assert leads(f"?p(R, 9). ?p(R, 8). p(R, 0). {chain}") is not None
    goals = " ".join(f"?p(R, {n})." for n in range(5, 10))
    assert {leads(f"{goals} p(R, 0). {chain}", goal) is None for goal in range(5)} == {True}
