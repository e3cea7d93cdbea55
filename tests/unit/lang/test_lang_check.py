"""Kinds, arities, types and bindings: what compiles and what is an error where."""

import pytest
from lang_source import CORRIDOR, codes, compiled, errors, places

from rmr.bytecode.program import Base, Kind, Type
from rmr.lang.compiler import compile_source


def predicate(text, name):
    program = compiled(text)
    return program.predicates[program.index(name)]


def test_one_bang_makes_an_undeclared_predicate_persistent():
    assert predicate("p(R, 1). !p(R, X) -o q(R, X).", "p").kind is Kind.PERSISTENT
    assert predicate("p(R, 1). p(R, X) -o q(R, X).", "p").kind is Kind.TEMPORARY


def test_a_declared_persistent_fact_needs_no_bang_in_a_use():
    assert errors("type !due(robot, int). due(R, 3). due(R, X) -o p(R, X).") == []


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("type p(robot). !p(R).", "E012", "!p(R)"),
        ("type !p(robot). $p(R) -o q(R).", "E012", "$p(R)"),
        ("type action a(robot). a(R) -o q(R).", "E012", "a(R)"),
        ("type action a(robot). a(R).", "E012", "a(R)"),
        ("type action a(robot). ?a(R).", "E012", "a(R)"),
        ("type action a(robot). p(R), ?a(R) -o q(R).", "E012", "?a(R)"),
        ("type sensor s(robot). p(R) -o s(R).", "E012", "s(R)"),
        ("type sensor s(robot). p(R) -o q(R). x: assert(p(R), q(R), 1, s(R)).", "E012", "s(R)"),
        ("assert(p(R), q(R), 1, v(R)). p(R) -o v(R), q(R).", "E013", "v(R)"),
        ("type p(robot). type !p(robot).", "E010", "p"),
        ("type p(area).", "E021", "area"),
        ("p().", "E021", "p()"),
        ("p(s, R).", "E021", "s"),
        ("p(R), q(R, 1) -o q(R).", "E011", "q(R)"),
        ("p(R), X = dist(1, 2) -o q(R, X).", "E011", "dist(1, 2)"),
        ("p(R), X = sqr(2) -o q(R, X).", "E015", "sqr"),
        ("p(R) -o q(R, X).", "E030", "X"),
        ("p(R), X < 3 -o q(R).", "E030", "X"),
        ("p(R), X = Y, Y = X -o q(R).", "E030", "X"),
        ("p(R) -o q(R, _).", "E030", "_"),
        ("p(R), X = _ -o 1.", "E030", "_"),
        ("p(R), not q(R, _ + 1) -o 1.", "E030", "_"),
        ("p(R), not q() -o 1.", "E021", "not q()"),
        ("p(R), not q(R, Y), not r(R, Z), Z = Y + W -o 1.", "E030", "W"),
        ("p(R) -o {B, B | e(R, B) | q(B)}.", "E031", "B"),
        ("p(R, X) -o {X | e(R, X) | q(X)}.", "E031", "X"),
        ("p(R) -o {B | e(R, B), f(R, C) | q(B)}.", "E030", "C"),
        ("p(R) -o {B | e(B, R) | q(B)}.", "E033", "e(B, R)"),
        ("p(R, B), not q(B) -o r(R).", "E033", "not q(B)"),
        ("true -o p(@1).", "E032", "true"),
        ("not p(R) -o q(R).", "E032", "not p(R)"),
        ("p(R), now() > 3 -o q(R).", "E034", "now()"),
        ("p(R, X), X + 1 -o q(R).", "E022", "X + 1"),
        ("p(R, X), ready -o q(R).", "E022", "ready"),
        ("p(R, a), p(R, X), X > 3 -o q(R).", "E020", "X > 3"),
        ("p(R, X), X = R + 1 -o q(R).", "E020", "R"),
        ("p(R, a). p(R, A), q(R, B), A < B -o 1.", "E020", "A"),
        ("type p(robot, robot). p(R, B), B >= R -o 1.", "E020", "B"),
        ("type p(robot, robot). p(R, B), B <= @3 -o 1.", "E020", "B"),
        ("type p(robot, bool). p(R, X), X > false -o 1.", "E020", "X"),
        ("type p(robot, area). p(R, A) -o q(R, if(A <= middle, 1, 2)).", "E020", "A"),
        ("p(R, X), X < middle -o 1.", "E020", "middle"),
        ("type p(robot, int). p(R, 2.5).", "E020", "2.5"),
        ("type p(robot, int). p(R, 2.5) -o 1.", "E020", "2.5"),
        ("type p(robot, area). type q(robot, line). p(R, A) -o q(R, A).", "E020", "A"),
        ("p(R, X).", "E023", "X"),
        ("p(R + 1, 2).", "E023", "R + 1"),
        ("assert(p(R), q(R), D, v(R)). p(R) -o q(R).", "E030", "D"),
        ("order textul.", "E015", "textul"),
        ("const a = b(1).", "E023", "b(1)"),
    ],
)
def test_a_mistake_has_its_code_and_its_place(text, code, place):
    assert (code, place) in places(text)


def test_a_join_without_a_link_is_refused_with_the_whole_rule_and_a_fact_of_each():
    rule = "waiting(A, L), free(B, L), not done(A), !edge(A, C) -o go(A, L), go(B, X)."
    compilation = compile_source(f"p(R).\n{rule}\n")
    text = compilation.source.text
    [joined] = [each for each in compilation.errors if each.code == "E035"]
    assert text[joined.span.start : joined.span.end] == rule
    assert [text[note.span.start : note.span.end] for note in joined.notes] == ["waiting(A, L)", "free(B, L)"]
    assert ("E030", "X") in places(text)


# ---- lists


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("p(R, X), not q(R, [X, Y]) -o 1.", "E030", "Y"),
        ("p(R, X), not q(R, [X, _]) -o 1.", "E030", "_"),
        ("p(R, X), Y = [X | T] -o 1.", "E030", "T"),
        ("p(R, X), Y = [X, _] -o q(R, Y).", "E030", "_"),
        ("p(R, X), [A, 1] = [X, B] -o q(R, A).", "E030", "A"),
        ("p(R, [X + 1]) -o q(R, 1).", "E030", "X"),
        ("p(R, X) -o q(R, [X | T]).", "E030", "T"),
        ("p(R, [R]).", "E023", "[R]"),
        ("?p(R, [X]).", "E023", "[X]"),
        ("p(R, L), X = rest(L, 1) -o q(R, X).", "E015", "rest"),
    ],
)
def test_a_list_with_unknown_parts_is_an_error_where_it_cannot_be_taken_apart(text, code, place):
    assert (code, place) in places(text)


def test_lists_nested_in_long_lists_are_bounded():
    deep = "X"
    for _ in range(40):
        deep = f"[{', '.join('1' * 40)}, {deep}]"
    assert errors(f"p(R, X) -o q(R, {deep}).") == ["E008"]
    assert errors("p(R, X) -o q(R, [" + ", ".join("X" * 300) + "]).") == ["E008"]
    long = [f"[{', '.join(f'{name}{k}' for k in range(200))}]" for name in "XY"]
    assert errors(f"p(R, {long[0]}, {long[1]}) -o 1.") == ["E008"]


# ---- aggregates


@pytest.mark.parametrize(
    ("head", "code", "place"),
    [
        ("[cuont => N | q(R, X) | r(R, N)]", "E015", "cuont"),
        ("[count X => N | q(R, X) | r(R, N)]", "E011", "X"),
        ("[sum => N | q(R, X) | r(R, N)]", "E011", "sum"),
        ("[sum X => V | q(R, X) | r(R, X)]", "E030", "X"),
        ("[collect Z => V | q(R, X) | r(R, V)]", "E030", "Z"),
        ("[sum X => V | q(R, X) | r(R, V, Y)]", "E030", "Y"),
        ("[sum X => A | q(R, X) | r(R, A)]", "E031", "A"),
        ("[sum X => X | q(R, X) | r(R, X)]", "E031", "X"),
        ("[sum X => V | q(B, X) | r(R, V)]", "E033", "q(B, X)"),
        ("[sum X => V | q(R, X), now() > 3 | r(R, V)]", "E034", "now()"),
        ("[sum X => V | q(R, X) | r(R, _)]", "E030", "_"),
    ],
)
def test_a_mistake_in_an_aggregate_has_its_code_and_its_place(head, code, place):
    assert (code, place) in places(f"p(R, A) -o {head}.")


# ---- what names other robots


def test_an_effect_on_what_another_robot_senses_is_an_error():
    text = "type sensor s(robot). type action a(R: robot, B: robot) -o s({})."
    assert errors(text.format("R")) == []
    assert places(text.format("B")) == [("E012", "B")]
    assert places(text.format("@3")) == [("E012", "@3")]


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("assert(p(A), q(B), 1, v(A)).", "E030", "B"),
        ("assert(p(A), q(A), 1, v(B)).", "E030", "B"),
        ("assert(p(A), q(_), 1, v(A)).", "E030", "_"),
        ("assert(p(_), q(@1), 1, v(_)).", "E030", "_"),
        ("assert(p(A, N), q(N + 1), 1, v(A)).", "E021", "N + 1"),
        ("p(A, 3). assert(p(A, N), q(N), 1, v(A)).", "E021", "N"),
    ],
)
def test_the_robots_of_an_assertion_are_named_or_bound_by_its_start(text, code, place):
    assert (code, place) in places(text)


def test_the_second_place_of_a_contradiction_is_shown():
    text = "p(R, 3). p(R, area)."
    [diagnostic] = compile_source(text).errors
    assert [text[note.span.start : note.span.end] for note in diagnostic.notes] == ["3"]


def test_every_error_of_a_file_is_reported_in_source_order():
    text = "p(R, X).\ntype q(area).\nq(R) : .\na(R) -o b(R, Y).\n"
    assert errors(text) == ["E023", "E021", "E001", "E030"]


def test_declarations_in_an_item_with_syntax_error_cause_no_further_errors():
    assert errors(
        "type action moveto[robot](area). type p(robot, int). p(R, X) -o moveto(R, X). moveto(R, a) -o 1."
    ) == ["E001"]


# ---- inference


def types(text, name):
    return [(kind.base, kind.name) for kind in predicate(text, name).types]


def test_types_flow_from_declarations_through_rules():
    text = "type !due(robot, float). start(R), due(R, D) -o crossing(R, D). crossing(R, D) -o late(R, D * 2)."
    assert types(text, "crossing") == [(Base.FLOAT, "")]
    assert types(text, "late") == [(Base.FLOAT, "")]


def test_int_and_float_make_float_and_what_nothing_fixes_stays_open():
    assert types("p(R, 1). p(R, 2.5).", "p") == [(Base.FLOAT, "")]
    assert types("p(R, 2). p(R, X) -o q(R, X / 2).", "q") == [(Base.FLOAT, "")]
    assert types("p(R, 2). p(R, X), X = 2.5 -o 1.", "p") == [(Base.FLOAT, "")]
    assert types("p(R, X) -o q(R, X).", "p") == [(Base.OPEN, "")]


def test_a_type_is_taken_from_where_the_value_goes_if_nothing_else_gives_one():
    assert types("type action lineup(robot, area, int). p(R, K) -o lineup(R, entry, K).", "p") == [(Base.INT, "")]
    assert types("location(R, L), L = s -o 1.", "location") == [(Base.SYMBOL, "")]


def test_an_int_stays_an_int_although_it_goes_into_a_float():
    text = "type speed(robot, float). n(R, 3). n(R, X) -o speed(R, X). n(R, X) -o n(R, X - 1)."
    assert types(text, "n") == [(Base.INT, "")]


def test_a_robot_is_known_by_standing_first():
    assert types("online(A, L) -o {B | edge(A, B) | ready(B, A)}.", "ready") == [(Base.ROBOT, "")]


# ---- what every robot provides


def test_a_provided_fact_is_known_undeclared_and_only_emitted_if_used():
    text = """
    go(R), at(R, exit), pose(R, X, Y, T), turn(R, go, K), id(R, N) -o q(R, X, K, N).
    go: assert(q(R, X, K, N), at(R, exit), 1, broadcast(R)).
    """
    program = compiled(text)
    provided = {each.name: each.kind for each in program.predicates if each.provided}
    assert provided == {"at": Kind.SENSED, "pose": Kind.SENSED, "turn": Kind.SENSED, "id": Kind.PERSISTENT}
    assert predicate(text, "q").types == (Type(Base.FLOAT), Type(Base.INT), Type(Base.INT))


def test_a_provided_fact_stays_provided_when_declared_alike():
    assert predicate("type sensor at(robot, place). at(R, exit) -o q(R).", "at").provided


@pytest.mark.parametrize(
    "text",
    ["at(R, s). at(R, s) -o q(R).", "p(R) -o at(R, s). p(R).", "type at(robot, area).", "type sensor at(robot, int)."],
)
def test_a_program_may_mean_something_else_by_a_provided_name(text):
    assert not predicate(text, "at").provided


def test_a_provided_fact_with_other_arguments_is_an_error():
    assert places("at(R) -o q(R).")[0] == ("E011", "at(R)")


def test_a_declaration_that_contradicts_a_provided_action_is_an_error():
    assert errors("type action moveto(robot, int).") == ["E014"]
    assert errors("type action moveto(R: robot, P: place) -o at(R, P).") == []


def test_an_assertions_violation_need_not_be_declared():
    text = "assert(p(R), q(R), 1, alarm(R, 3)). p(R) -o q(R)."
    assert predicate(text, "alarm").kind is Kind.ACTION
    assert predicate(text, "alarm").types == (Type(Base.INT),)


def test_battery_without_a_declared_sensor_gets_a_warning():
    rule = "battery(R, V), V < 0.2 -o 1."
    assert places(rule) == [("W102", "battery(R, V)")]
    assert codes(f"type sensor battery(robot, float). {rule}") == []


@pytest.mark.parametrize("text", ["type battery(robot, float). p(R), battery(R, V) -o q(R, V).", "battery(R, 3)."])
def test_a_battery_of_the_programs_own_is_a_fact_as_others_are(text):
    assert errors(text) == []


def test_hints_never_suggest_unsupported_syntax():
    hints = [each.hint for each in compile_source("battry(R, V) -o 1. rnge(R, B, D) -o 1.").diagnostics]
    assert hints == ["declare it if it comes from outside: `type battry(...)`", "did you mean `range`?"]


@pytest.mark.parametrize("operator", ["<", "<=", ">", ">="])
def test_numbers_strings_and_what_nothing_fixes_have_an_order(operator):
    assert errors(f"p(R, X), X {operator} 2.5, X + 1 {operator} X -o 1.") == []
    assert errors(f'p(R, X), X {operator} "b" -o 1.') == []
    assert errors(f"p(R, X, Y), X {operator} Y -o 1.") == []


def test_comparison_of_robots_gets_a_hint_to_compare_their_numbers():
    [diagnostic] = compile_source("type p(robot, robot). p(R, B), B < R -o 1.").errors
    assert "`id(A) < id(B)`" in (diagnostic.hint or "")


# ---- names of time assertions

SHARED = [
    ("assert(p(R), q(R), 1, v(R)).", "assert(r(R), q(R), 2, v(R)).", "q", "q"),
    ("assert(p(R), q(R, a), 1, v(R)).", "watch(p(R), q(R, b), 2, v(R)).", "q", "q"),
    ("q: assert(p(R), r(R), 1, v(R)).", "assert(p(R), q(R), 2, v(R)).", "q", "q"),
    ("assert(p(R), q(R), 2, v(R)).", "q: watch(p(R), r(R), 1, v(R)).", "q", "q"),
]


@pytest.mark.parametrize(("one", "other", "here", "there"), SHARED)
def test_two_assertions_with_one_event_are_an_error_at_both_places(one, other, here, there):
    text = f"{one}\n{other}"
    [diagnostic] = compile_source(text).errors
    [note] = diagnostic.notes
    assert (diagnostic.code, text[diagnostic.span.start : diagnostic.span.end]) == ("E010", here)
    assert diagnostic.span.start > len(one)
    assert text[note.span.start : note.span.end] == there
    assert note.span.end < len(one)
    assert "name them" in (diagnostic.hint or "")


def test_assertions_with_one_finish_fact_and_names_are_two_events():
    text = "x: assert(p(R), q(R), 1, v(R)). y: assert(p(R), q(R), 2, v(R)). assert(p(R), q(R), 3, v(R))."
    assert errors(text) == []


# ---- warnings


def test_declared_fact_may_be_inserted_from_outside():
    assert codes("type q(robot, int). ?q(R, 1).") == []
    assert codes("type p(robot). type q(robot). watch(p(R), q(R), 1, v(R)).") == []


def test_warning_about_a_declared_fact_from_which_others_are_derived():
    text = "type p(robot). type q(robot, int). p(R) -o q(R, 2). ?q(R, 1). x: assert(p(R), q(R, 3), 1, v(R))."
    [goal, finish] = compile_source(text).diagnostics
    assert (goal.code, goal.message) == ("W103", "nothing in the program derives a fact that matches `?q(...)`")
    assert (finish.code, finish.hint) == ("W104", None)
    assert "unless one comes from outside" in finish.message


def test_misprint_in_figure_4_gets_a_warning():
    text = "location(R, s). location(R, L), L = S -o moved(R)."
    assert places(text) == [("W101", "S")]


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("ready(R). redy(R) -o go(R).", "W102", "redy(R)"),
        ("type p(robot, area). p(R, L), L = s, L = t -o 1.", "W102", "L = t"),
        ("type p(robot). p(R), false -o 1.", "W102", "false"),
        (CORRIDOR.replace("turn(R, crossing", "turn(R, crosing"), "W102", "crosing"),
        ("type p(robot). ?q(R, 1). p(R) -o q(R, 2).", "W103", "q(R, 1)"),
        ("type p(robot). assert(p(R), q(R), 1, v(R)).", "W104", "q(R)"),
        ('type p(robot, robot). p(R, B) -o q(B, "' + "x" * 120 + '").', "W105", 'q(B, "' + "x" * 120 + '")'),
        ("type p(robot). assert(p(R), p(R), 5ms, v(R)). p(R) -o p(R).", "W106", "5ms"),
        ("type p(robot). p(R) -o stop(R).", "W108", "stop(R)"),
        ("type p(robot). type location(robot, area). p(R) -o locatoin(R, s).", "W108", "locatoin(R, s)"),
    ],
)
def test_warning_has_its_code_and_its_place(text, code, place):
    assert (code, place) in places(text)
    assert compile_source(text).program is not None


def test_sound_program_has_no_warnings():
    assert codes(CORRIDOR) == []


def test_missing_definition_gets_no_warning_after_a_syntax_error():
    assert codes("ready(R) -o . go(R) -o 1.") == ["E001"]


# ---- constants


def test_a_constant_stands_for_its_value():
    program = compiled("const total = 4. const half = total / 2. const first = @1. p(first, total, half).")
    assert program.facts[0].args == (4, 2.0)
    assert program.facts[0].owner == 1


def test_a_constant_defined_twice_is_an_error():
    assert errors("const a = 1. const a = 2.") == ["E010"]


def test_too_many_parts_are_an_error():
    body = ", ".join(f"p(R, X{each})" for each in range(300))
    assert errors(f"{body} -o q(R).") == ["E008"]


def test_errors_beyond_the_bound_are_counted_and_warnings_hide_none():
    warnings = "".join(f"g{each}(R) -o 1.\n" for each in range(600))
    found = compile_source(warnings + "p(R, X).\n").diagnostics
    assert [each.code for each in found if each.code != "W102"] == ["E023", "W109"]


@pytest.mark.parametrize("kind", ["", "!", "action "])
def test_unordered_in_a_type_reaches_the_byte_code(kind):
    assert predicate(f"type unordered {kind}p(robot).", "p").unordered
    assert not predicate(f"type {kind}p(robot).", "p").unordered


def test_unordered_is_also_a_name():
    assert not predicate("type unordered(robot). unordered(R) -o 1.", "unordered").unordered


def test_a_sensed_fact_is_never_sent_so_unordered_is_refused():
    assert errors("type unordered sensor p(robot).") == ["E012"]
