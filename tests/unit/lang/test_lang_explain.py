"""What `rmr check --explain` says; whole outputs stand in explain/, rewritten with RMR_REWRITE=1 and read as a diff."""

import json
import os
import re
from dataclasses import fields
from pathlib import Path

import pytest
from command_runner import Result, invoke
from lang_source import compiled

from rmr.analysis import goal_levels, servers
from rmr.base.values import Robot, Symbol
from rmr.commands.subcommands import command as main
from rmr.lang import explain as told_columns
from rmr.lang.analyse import fact_size as sizes
from rmr.lang.compiler import compile_source
from rmr.lang.explain import Explanation, explain
from rmr.lang.explain import explained_assertions as told_assertions
from rmr.lang.explain import explained_goals as told_goals
from rmr.lang.explain import explained_rules as told_rules
from rmr.lang.explain.show import OBSTACLES_SHOWN_MAX, RULES_SHOWN_MAX, STEPS_SHOWN_MAX, show
from rmr.lang.explain.texts import Spot
from rmr.node.payloads import FACT_BODY_OCTETS_MAX, Delivery, DeliveryRole, encode_delivery

ROOT = Path(__file__).parents[3]
HERE = Path(__file__).parent / "explain"
PROGRAMS = [
    ROOT / "deploy" / "labs" / "corridor" / "corridor.rmr",
    ROOT / "tests" / "programs" / "figure3.rmr",
    ROOT / "tests" / "programs" / "figure4.rmr",
    HERE / "ensemble.rmr",
    HERE / "jobs.rmr",
    HERE / "shared.rmr",
    HERE / "team.rmr",
]


def run(*arguments: object, folder: Path = HERE) -> Result:
    """Run `rmr check` in a folder, so that places are told by the names of files alone."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        return invoke(main, ["check", *map(str, arguments)], catch_exceptions=False)
    finally:
        os.chdir(before)


def explained(text: str) -> Explanation:
    """Explain a program without errors."""
    compiled(text)
    explanation = explain(compile_source(text, "p.rmr"))
    assert explanation is not None
    return explanation


def compare(text: str, golden: Path) -> None:
    if os.environ.get("RMR_REWRITE"):
        golden.write_text(text, "utf-8")
    assert text == golden.read_text("utf-8")


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_an_explanation_reads_as_its_golden_file(program: Path) -> None:
    compare(run("--explain", program.name, folder=program.parent).stdout, HERE / f"{program.stem}.txt")


@pytest.mark.parametrize("program", [PROGRAMS[0], PROGRAMS[-1]], ids=lambda path: path.stem)
def test_an_explanation_in_json_is_its_golden_file(program: Path) -> None:
    compare(run("--explain", "--json", program.name, folder=program.parent).stdout, HERE / f"{program.stem}.json")


# ---- the command


def test_without_explain_the_json_has_diagnostics_alone() -> None:
    assert list(json.loads(run("--json", "jobs.rmr").stdout)) == ["version", "diagnostics"]


def test_with_explain_it_is_an_object_with_diagnostics_and_an_explanation_of_each_program() -> None:
    found = json.loads(run("--json", "--explain", "jobs.rmr", "team.rmr").stdout)
    assert list(found) == ["version", "diagnostics", "explanation"]
    assert [each["file"] for each in found["explanation"]["programs"]] == ["jobs.rmr", "team.rmr"]
    assert {each["code"] for each in found["diagnostics"]} == {"W105", "W116"}


def test_a_program_with_errors_has_diagnostics_only(tmp_path: Path) -> None:
    (tmp_path / "wrong.rmr").write_text("?g(R). a(R). a(R) -o g(X).")
    (tmp_path / "right.rmr").write_text("?g(R). a(R). a(R) -o g(R).")
    result = run("--explain", "wrong.rmr", "right.rmr", folder=tmp_path)
    assert result.exit_code == 3
    assert "wrong.rmr:1:24: error[E030]" in result.stderr
    assert result.stdout.startswith("right.rmr: 1 rule, 1 goal, 0 time assertions\n")
    found = json.loads(run("--explain", "--json", "wrong.rmr", folder=tmp_path).stdout)
    assert [each["code"] for each in found["diagnostics"]] == ["E030"]
    assert found["explanation"] == {"programs": []}


def test_a_program_of_several_files_is_explained_by_the_places_in_each(tmp_path: Path) -> None:
    (tmp_path / "main.rmr").write_text('include "part.rmr".\n?g(R).\na(R).\na(R) -o b(R).\n')
    (tmp_path / "part.rmr").write_text("\n// comment\nb(R) -o g(R).\n")
    text = run("--explain", "main.rmr", folder=tmp_path).stdout
    assert "    rank 0, compiled  part.rmr:3  b(R) -o g(R).\n" in text
    assert (
        "    rank 1, compiled  main.rmr:4  a(R) -o b(R).\n      derives b(R), needed by the rule at part.rmr:3\n"
        in text
    )


def test_the_keys_of_the_json_are_those_of_the_page() -> None:
    page = (ROOT / "docs" / "explain.md").read_text("utf-8").partition("\n## JSON\n")[2]
    rows = [line.split("|")[1:3] for line in page.splitlines() if line.startswith(("| a", "| needs", "| some"))]
    kinds = {
        "a program": Explanation,
        "a place": Spot,
        "a ranking": told_goals.RankingBudget,
        "a goal": told_goals.ExplainedGoal,
        "a rule of a goal": told_goals.LeadingRule,
        "an assertion": told_assertions.ExplainedAssertion,
        "a serving action": told_assertions.ServingAction,
        "a step of a way": told_assertions.WayStep,
        "an origin": told_assertions.Origin,
        "a rule": told_rules.ExplainedRule,
        "a rule over several robots": told_rules.ExplainedEnsemble,
        "another robot of a rule": told_rules.ExplainedRemote,
        "needs": told_rules.Needs,
        "a part of a head": told_rules.ExplainedPart,
        "an answer on columns": told_columns.ExplainedColumns,
        "an obstacle": told_columns.ExplainedObstacle,
        "something derived": told_rules.ExplainedDerivation,
    }
    told = {name: [field.name for field in fields(kind)] for name, kind in kinds.items()}
    assert {name.strip(): re.findall(r"`(\w+)`", keys) for name, keys in rows} == told


def test_the_limits_of_the_page_are_those_of_the_code() -> None:
    page = (ROOT / "docs" / "explain.md").read_text("utf-8").partition("\n## Limits\n")[2].replace("10 000", "10000")
    limits = [RULES_SHOWN_MAX, STEPS_SHOWN_MAX, told_goals.WAYS_MAX]
    limits += [OBSTACLES_SHOWN_MAX, told_columns.OBSTACLES_MAX, goal_levels.STEPS_MAX, servers.STEPS_MAX]
    assert told_assertions.STEPS_MAX == told_goals.WAYS_MAX
    assert [int(number) for number in re.findall(r"\d+", page)] == limits


# ---- what is told


def test_explanation_lists_every_ranked_rule_with_the_fact_that_leads_on() -> None:
    [goal] = explained("?g(R, k). a(R). a(R) -o b(R), x(R). b(R) -o x(R), g(R, k). x(R) -o 1.").goals
    assert [(each.rule, each.rank, each.derives, each.needed_by) for each in goal.rules] == [
        (1, 0, "g(R, k)", None),
        (0, 1, "b(R)", 1),
    ]


def test_explanation_shows_the_best_rank_where_it_depends_on_the_match() -> None:
    [goal] = explained("?g(R, k). a(R, k). a(R, X) -o g(R, X).").goals
    assert [(each.rank, each.rank_min) for each in goal.rules] == [(None, 0)]


def test_variables_of_inner_bodies_bear_their_names() -> None:
    [goal] = explained(
        "?g(R, 3). t(R). n(R, 3). t(R) -o {N | n(R, N) | g(R, N)}. t(R) -o [max N => M | n(R, N) | g(R, M)]."
    ).goals
    assert [each.derives for each in goal.rules] == ["g(R, N)", "g(R, _)"]


def test_explanation_reports_a_goal_whose_search_exceeds_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rmr.lang.lower.goal_paths.COMPARISONS_MAX", 0)
    explanation = explained("?g(R). a(R). a(R) -o g(R).")
    assert not explanation.goals[0].worked_out
    assert "so much leads there" in show(explanation)


def test_a_comment_and_a_line_in_a_string_stay_out_of_and_in_a_rule_s_text() -> None:
    [rule] = explained(
        'type action say(robot, string).\na(R).\na(R) // one\n  /* two */ -o\n\tsay(R, "b // c  d").'
    ).rules
    assert rule.text == 'a(R) -o say(R, "b // c  d").'


def test_a_text_that_controls_a_terminal_is_made_visible() -> None:
    explanation = explained('type action say(robot, string). a(R). a(R) -o say(R, "\x1b[31m").')
    assert "\x1b" not in show(explanation)


def test_explanation_shows_that_effects_on_other_robots_are_sent_at_completion() -> None:
    text = """
    type action give(R: robot, B: robot, N: int) -o has(B, N), gave(R), seen(@7, N + 1).
    p(R, @2). p(R, C) -o give(R, C, 300).
    """
    [rule] = explained(text).rules
    sent = [(each.what, each.text, each.to) for part in rule.head for each in part.derives if each.to is not None]
    assert sent == [("effect", "has(C, 300)", "C"), ("effect", "seen(@7, N + 1)", "@7")]


# ---- columns


def test_explanation_reports_that_a_program_suits_columns() -> None:
    explanation = explained("type a(robot, int). a(R, 1). a(R, X), X < 9 -o a(R, X + 1).")
    assert explanation.columns == told_columns.ExplainedColumns(True, (), 0)
    assert show(explanation).endswith(
        "  yes: a robot holds at most one fact of each predicate, and each rule changes its own robot alone\n"
    )


def test_explanation_lists_obstacles_to_columns_with_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "a(R, @2).\na(R, B) -o b(B), c(R, B).\n"
    explanation = explained(text)
    [obstacle] = explanation.columns.obstacles
    assert (obstacle.text, obstacle.place) == ("the rule sends `b` to another robot", Spot("p.rmr", 2, 1))
    assert "    p.rmr:2  the rule sends `b` to another robot\n" in show(explanation)
    monkeypatch.setattr(told_columns, "OBSTACLES_MAX", 1)
    columns = explained(text + "a(R, B) -o d(B).").columns
    assert (columns.suited, len(columns.obstacles), columns.obstacles_left_out) == (False, 1, 1)


def test_number_of_obstacles_to_columns_shown_is_bounded() -> None:
    text = show(explained("a(R, @2)." + "a(R, B) -o b(B).\n" * (OBSTACLES_SHOWN_MAX + 3)))
    assert text.count("the rule sends") == OBSTACLES_SHOWN_MAX
    assert text.endswith("    and 3 more\n")


# ---- sizes


VALUES = {
    "true": True,
    "7": 7,
    "300": 300,
    "2.5": 2.5,
    "@9": Robot(9),
    "middle": Symbol("middle"),
    '"für"': "für",
    "[1, 2]": (1, 2),
}


@pytest.mark.parametrize("text", VALUES)
def test_the_octets_of_a_constant_are_those_that_it_takes_on_the_air(text: str) -> None:
    [rule] = explained(f"p(R, @2). p(R, B) -o q(B, {text}).").rules
    [sent] = rule.head[0].derives
    symbols = {"middle": 0}
    taken = len(encode_delivery(Delivery(DeliveryRole.FACT, 0, (VALUES[text],)), symbols))
    empty = len(encode_delivery(Delivery(DeliveryRole.FACT, 0, ()), symbols))
    assert (sent.octets_min, sent.octets_max) == (taken - empty, taken - empty)


def test_a_frame_has_as_much_room_as_is_said() -> None:
    room = {
        role: FACT_BODY_OCTETS_MAX - len(encode_delivery(Delivery(role, 0, ()), {}))
        for role in (DeliveryRole.FACT, DeliveryRole.ACTION)
    }
    assert room[DeliveryRole.FACT] == sizes.FACT_OCTETS_MAX
    assert room[DeliveryRole.ACTION] == sizes.FACT_OCTETS_MAX - told_rules.ACTION_OCTETS


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("bool", (1, 1)), ("int", (2, 9)), ("float", (9, 9)), ("robot", (3, 3)), ("area", (3, 3)), ("string", (3, None))],
)
def test_the_octets_of_a_variable_are_those_of_its_type(kind: str, expected: tuple[int, int | None]) -> None:
    [rule] = explained(f"type p(robot, robot, {kind}). p(R, B, X) -o q(B, X).").rules
    [sent] = rule.head[0].derives
    assert (sent.octets_min, sent.octets_max, sent.fits) == (*expected, True if expected[1] else None)


# ---- bounds


def chain(length: int, goals: int) -> str:
    rules = [f"p(R, {n}) -o p(R, {n + 1})." for n in range(length)]
    stated = [f"?p(R, {length - n}). a{n}: assert(s(R), p(R, {length - n}), 9, broadcast(R))." for n in range(goals)]
    return "\n".join(["type action go(R: robot) -o p(R, 0).", "s(R).", *stated, *rules])


def test_only_the_nearest_rules_are_shown() -> None:
    text = show(explained(chain(RULES_SHOWN_MAX + 7, 1)))
    assert text.count("    rank ") == RULES_SHOWN_MAX
    assert "    and 7 more rules\n" in text
    assert text.count("which derives p(R, ") == STEPS_SHOWN_MAX
    assert "more steps\n" in text


def test_explanation_size_is_bounded_over_all_goals_and_assertions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(told_goals, "WAYS_MAX", 40)
    monkeypatch.setattr(told_assertions, "STEPS_MAX", 50)
    explanation = explained(chain(30, 3))
    assert [(len(each.rules), each.rules_left_out) for each in explanation.goals] == [(30, 0), (10, 19), (0, 28)]
    ways = [(len(each.serving[0].way), each.serving[0].way_left_out) for each in explanation.assertions]
    assert ways == [(30, 0), (20, 9), (0, 28)]
