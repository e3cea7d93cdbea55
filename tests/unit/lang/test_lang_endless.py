"""Rules that never stop, programs that nothing starts, symbols that look misspelt: certain cases only."""

from pathlib import Path

import pytest
from lang_source import codes

from rmr.lang.compiler import compile_file, compile_source

ROOT = Path(__file__).parents[3]
OWN = [*sorted((ROOT / "deploy").rglob("*.rmr")), *sorted((ROOT / "docs").rglob("*.rmr"))]


@pytest.mark.parametrize("path", OWN, ids=lambda path: path.name)
def test_no_false_positive_in_labs_and_examples(path):
    assert compile_file(path).diagnostics == []


@pytest.mark.parametrize(
    "text",
    [
        "a(R). a(R) -o a(R).",
        "a(R, 1). a(R, X) -o a(R, X).",
        "a(R, 1). a(R, X), X > 0 -o a(R, X).",
        "a(R, 1). a(R, _) -o a(R, 2).",
        "a(R). !e(R, 1). a(R), e(R, X) -o a(R), b(R, X). b(R, _) -o 1.",
        "a(R). b(R). a(R), b(R) -o b(R), a(R).",
        "a(@1). a(@1) -o a(@1).",
        "a(R). type action f(robot). a(R) -o b(R) then a(R) then f(R). b(R) -o 1.",
        "a(R). a(R) -o b(R). b(R) -o c(R). c(R) -o a(R).",
    ],
)
def test_a_rule_or_cycle_that_satisfies_itself_never_stops(text):
    assert codes(text).count("W113") == 1


@pytest.mark.parametrize(
    "text",
    [
        "a(R, 3). a(R, X), X > 0 -o a(R, X - 1).",
        "a(R, 3). !e(R, 3). a(R, X), e(R, X) -o a(R, X + 1).",
        "a(R, 3, 3). a(R, X, X) -o a(R, X, X + 1).",
        "a(R, 1). a(R, 1) -o a(R, 2).",
        "a(R). a(R) -o a(R). a(R) -o 1.",
        "a(R). b(R). a(R), b(R) -o a(R).",
        "a(R). a(R), a(R) -o a(R).",
        "a(R). a(R), obstacle(R) -o a(R).",
        "a(R). a(R), not b(R) -o a(R), b(R). b(R) -o 1.",
        "a(R). b(R). $b(R), a(R) -o a(R). b(R) -o 1.",
        "a(@1). a(R), peer(R, B) -o a(B).",
        "a(R). type action f(robot). a(R) -o f(R) then a(R).",
        "a(R). a(R) -o ?a(R).",
        "a(R). go(R). go(R) -o {X | a(R), peer(R, X) | told(X)}. told(R) -o 1. a(R) -o a(R).",
    ],
)
def test_rule_that_another_rule_may_stop_gets_no_endless_loop_warning(text):
    assert "W113" not in codes(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("!c(R, 0). !c(R, N) -o !c(R, N + 1).", True),
        ("!c(R, 0). !c(R, N) -o !c(R, 1 + N).", True),
        ("!c(R, 0, 1). !e(R). !c(R, N, M), e(R) -o !c(R, N - 2, M).", True),
        ('!c(R, "a"). !c(R, N) -o !c(R, N + "a").', True),
        ("c(R, 0). $c(R, N) -o c(R, N).", True),
        ("!c(R, 0). !c(R, N), N < 5 -o !c(R, N + 1).", False),
        ("!c(R, 0). !c(R, N) -o !c(R, N).", False),
        ("!c(R, 0). !c(R, N) -o !c(R, N + 0).", False),
        ("!c(R, 0). !c(R, N) -o !c(R, 7).", False),
        ("!c(R, 0). a(R). !c(R, N), a(R) -o !c(R, N + 1).", True),
        ("!c(R, 0). a(R). type action f(robot). !c(R, N), a(R) -o f(R) then !c(R, N + 1).", True),
        ("!c(R, 0). a(R). !c(R, N), a(R), N < 9 -o !c(R, N + 1).", False),
        ("!c(R, 0). a(R). !c(R, N), a(R), not !c(R, N + 1) -o !c(R, N + 1).", False),
        ("!c(R, 0). a(R). !c(R, N), a(R), not !c(R, _) -o !c(R, N + 1).", False),
        ("!c(R, 0). a(R, 1). !c(R, N), a(R, N) -o !c(R, N + 1).", False),
        ("!c(R, 0). a(R, 1). !c(R, _), a(R, N) -o !c(R, N + 1).", False),
        ("!c(@1, 0). a(R). !c(R, N), a(R), peer(R, B) -o !c(B, N + 1).", False),
        ("!c(R, 0). !e(R, 1). !c(R, N), e(R, N) -o !c(R, N + 1).", False),
        ("!c(@1, 0). !c(R, N), peer(R, B) -o !c(B, N + 1).", False),
    ],
)
def test_facts_that_certainly_grow_without_bound_get_a_warning(text, expected):
    assert ("W114" in codes(text)) is expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("type s(robot). type action f(robot). s(R) -o f(R).", True),
        ("type s(robot). type t(robot). type action f(robot). s(R) -o t(R). t(R) -o s(R), f(R).", True),
        ("type s(robot). type action f(robot). s(R) -o f(R). s(@2).", False),
        ("type s(robot). type action f(robot). s(R) -o f(R). obstacle(R) -o f(R).", False),
        ("type !s(robot). type action f(robot). s(R) -o f(R).", False),
        ("type sensor s(robot). type action f(robot). s(R) -o f(R).", False),
        ("type s(robot). type t(robot). watch(s(R), t(R), 1, stop(R)). s(R) -o t(R).", False),
        ("type s(robot).", False),
    ],
)
def test_program_whose_rules_all_need_outside_facts_gets_a_warning(text, expected):
    assert ("W115" in codes(text)) is expected


def test_program_that_is_given_the_outside_fact_gets_no_warning(tmp_path):
    path = tmp_path / "p.rmr"
    path.write_text("type s(robot). type action f(robot). s(R) -o f(R).")
    assert [each.code for each in compile_file(path).diagnostics] == ["W115"]
    assert compile_file(path, {"s": False}).diagnostics == []


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("libary", "library", True),
        ("libarry", "library", True),
        ("liibrary", "library", True),
        ("librory", "library", True),
        ("librarys", "library", True),
        ("slot1", "slot2", False),
        ("room10", "room1", False),
        ("wall_a", "wall_b", False),
        ("gateA", "gateB", False),
        ("load", "lead", False),
        ("left", "lift", False),
        ("hall", "ball", False),
        ("north", "south", False),
        ("exit", "exits", True),
        ("patrol", "patrols", True),
        ("inner_x", "inner_y", False),
    ],
)
def test_symbols_one_typo_apart_get_a_warning_unless_numbered_or_lettered(one, other, expected):
    text = f"type p(robot, area). p(R, {other}). p(R, {other}) -o p(R, elsewhere). ?p(R, {one})."
    assert codes(text) == (["W112"] if expected else ["W103"])


def test_symbols_of_different_sets_are_not_compared():
    text = "type p(robot, area). type q(robot, colour). p(R, orange). q(R, ornage). p(R, orange), q(R, ornage) -o 1."
    assert codes(text) == []
    assert codes("type p(robot, area). type q(robot, colour). p(R, orange), q(R, ornage) -o p(R, orange).") == ["W115"]


def test_the_first_of_two_errors_does_not_hide_one_in_another_item():
    text = "type p(robot, int). p(r, 1). p(R, n), n > 2 -o p(R, n - 1). p(R, 1, 2). p(R, 7) -o p(R, 8.5)."
    assert [each.code for each in compile_source(text).errors] == ["E021", "E020", "E011", "E020"]
