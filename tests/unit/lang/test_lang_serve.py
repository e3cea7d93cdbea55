"""Which actions serve an assertion, and the way from their effect to the finish fact."""

import pytest
from lang_source import compiled

from rmr.analysis import servers
from rmr.analysis.servers import Servers, steps_of
from rmr.base.values import Symbol
from rmr.bytecode.program import ANY, Constant, Pattern, Slot


def serving(text: str) -> list[tuple[str, tuple[Pattern, ...]]]:
    program = compiled(text)
    return [(program.predicates[each.action].name, each.args) for each in program.assertions[0].serving]


def test_conditions_that_equate_say_which_arguments_serve() -> None:
    text = """
    type action go(R: robot, A: area, N: int) -o here(R, A, N).
    assert(s(R, X), e(R, X), 9, v(R)). s(R, 1).
    here(R, A, N), A = hall, N = M, M = 3 -o e(R, N).
    """
    assert serving(text) == [("go", (Constant(Symbol("hall")), Constant(3)))]


def test_facts_derived_by_comprehensions_and_steps_serve_an_assertion() -> None:
    text = """
    type action go(R: robot, N: int) -o here(R, N).
    type action look(R: robot) -o seen(R).
    assert(s(R, X), e(R, X), 9, v(R)). s(R, 1). ready(R).
    ready(R) -o {N | here(R, N) | e(R, N)}.
    seen(R) -o look(R) then e(R, 2).
    """
    assert serving(text) == [("go", (Slot(1),)), ("look", ())]


def test_count_result_serves_an_assertion_with_any_value() -> None:
    text = """
    type action fetch(R: robot, N: int) -o box(R, N).
    assert(s(R, X), e(R, X), 9, v(R)). s(R, 1). tick(R).
    tick(R) -o [count => N | $box(R, B) | e(R, N)].
    """
    assert serving(text) == [("fetch", (ANY,))]


def test_an_effect_on_another_robot_serves_no_job_at_home() -> None:
    text = """
    type action give(R: robot, B: robot, N: int) -o has(B, N).
    type action take(R: robot, N: int) -o has(R, N).
    assert(s(R, N), has(R, N), 9, v(R)). s(R, 1).
    """
    assert serving(text) == [("take", (Slot(1),))]


def test_a_finish_fact_of_another_robot_is_served_by_what_the_job_s_robot_sends_it() -> None:
    text = """
    type action give(R: robot, B: robot, N: int) -o has(B, N).
    type action take(R: robot, N: int) -o has(R, N).
    type action call(R: robot) -o line(R).
    assert(s(R, B, N), has(B, N), 9, v(R)). s(R, @2, 1). peers(R, @2).
    line(R), peers(R, B) -o has(B, 5).
    line(R) -o has(R, 5).
    """
    assert serving(text) == [("give", (Slot(1), Slot(2))), ("call", ())]


def test_the_rules_of_the_robot_that_an_assertion_names_count_for_it() -> None:
    text = """
    type action go(R: robot, B: robot) -o here(R, B).
    assert(s(@3), e(@3), 9, v(@3)). s(@3).
    here(@3, B) -o e(@3). here(@4, @7) -o e(@4).
    """
    assert serving(text) == [("go", (ANY,))]


def test_the_way_from_an_effect_to_the_finish_fact_is_the_shortest() -> None:
    text = """
    type action go(R: robot) -o a(R).
    assert(s(R), e(R), 9, v(R)). s(R).
    a(R) -o b(R). b(R) -o c(R). c(R) -o e(R). b(R) -o e(R).
    """
    program = compiled(text)
    [served] = Servers(program).walk(program.assertions[0]).served
    way = []
    passed = served.effect
    while passed.towards is not None:
        assert passed.derivation is not None
        way.append((program.predicates[passed.predicate].name, passed.derivation.rule))
        passed = passed.towards
    assert way == [("a", 0), ("b", 3)]


def steps(text: str) -> list[tuple[str, tuple[Pattern, ...], int]]:
    program = compiled(text)
    return [(program.predicates[each.action].name, each.args, each.later) for each in steps_of(program)[0]]


STEPS = """
type action pick(R: robot, N: int) -o picked(R, N).
type action weigh(R: robot) -o weighed(R).
type action load(R: robot, N: int) -o loaded(R, N).
type action blink(R: robot).
type action wait(R: robot, T: float) -o rested(R).
assert(s(R, X), e(R, X), 9, v(R)). go(R, 1).
"""


@pytest.mark.parametrize(
    "rules",
    [
        "go(R, N) -o s(R, N), pick(R, N). picked(R, N) -o weigh(R), of(R, N). weighed(R), of(R, N) -o load(R, N).",
        "go(R, N) -o s(R, N), pick(R, N) then weigh(R) then blink(R) then wait(R, 2.0) then load(R, N).",
        "go(R, N) -o s(R, N). $s(R, N) -o pick(R, N) then weigh(R). weighed(R), of(R, N) -o load(R, N).",
    ],
)
def test_actions_on_the_way_from_the_start_fact_are_steps_by_rules_and_in_chains(rules: str) -> None:
    assert steps(f"{STEPS}{rules} loaded(R, N) -o e(R, N).") == [("pick", (Slot(1),), 2), ("weigh", (), 1)]


def test_what_precedes_the_start_or_follows_the_end_of_a_job_is_no_step() -> None:
    rules = "picked(R, N) -o s(R, N), weigh(R). weighed(R) -o load(R, 1). loaded(R, N) -o e(R, N), go(R, N)."
    assert steps(f"{STEPS}go(R, N) -o pick(R, N). {rules}") == [("weigh", (), 1)]


def test_an_action_that_may_serve_the_job_itself_is_no_earlier_step() -> None:
    rules = "go(R, N) -o s(R, N), pick(R, N) then pick(R, 2) then weigh(R) then pick(R, N). picked(R, N) -o e(R, N)."
    assert steps(STEPS + rules) == [("weigh", (), 1)]


def test_a_job_whose_finish_is_another_robots_has_steps() -> None:
    text = """
    type action weigh(R: robot) -o weighed(R).
    type action give(R: robot, B: robot) -o has(B).
    assert(s(R, B), has(B), 9, v(R)). s(@1, @2).
    s(R, B) -o weigh(R) then give(R, B).
    """
    assert steps(text) == [("weigh", (), 1)]


def test_search_for_serving_actions_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    rules = " ".join(f"p(R, {n}) -o p(R, {n + 1})." for n in range(30))
    text = f"type action go(R: robot) -o p(R, 0). assert(s(R), p(R, 30), 9, v(R)). s(R). {rules}"
    assert serving(text) == [("go", ())]
    monkeypatch.setattr(servers, "STEPS_MAX", 10)
    assert serving(text) == []
    program = compiled(text)
    assert Servers(program).walk(program.assertions[0]).cut
