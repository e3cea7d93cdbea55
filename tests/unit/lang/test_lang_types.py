"""The types of lists, aggregates, steps, effects and assertions; what declarations, uses and bangs say together."""

import pytest
from lang_source import compiled, errors, places

from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Kind
from rmr.lang.analyse.types import type_text
from rmr.lang.compiler import compile_source


def types(text, name):
    program = compiled(text)
    return [type_text(kind) for kind in program.predicates[program.index(name)].types]


# ---- lists


@pytest.mark.parametrize(
    ("text", "name", "expected"),
    [
        ("q(R, [1, 2]).", "q", ["list int"]),
        ("q(R, [1, 2]). q(R, [2.5]).", "q", ["list float"]),
        ("q(R, [1, 2.5]).", "q", ["list float"]),
        ("q(R, []).", "q", ["list open"]),
        ("q(R, []). q(R, [[], [@1]]).", "q", ["list list robot"]),
        ("q(R, L) -o p(R, L). type p(robot, list area).", "q", ["list area"]),
        ("q(R, [1]). q(R, [H | T]) -o h(R, H, T).", "h", ["int", "list int"]),
        ("q(R, [[1], [2.5]]). q(R, [[H | _] | T]) -o h(R, H, T).", "h", ["float", "list list float"]),
        ("q(R, [1]). q(R, L), L = [H | T] -o h(R, H, T).", "h", ["int", "list int"]),
        ("q(R, [1]). q(R, L), [A, B] = L -o h(R, A, B).", "h", ["int", "int"]),
        ("q(R, [1]). q(R, L), [_ | T] = L, [B] = T -o h(R, B).", "h", ["int"]),
        ("type q(robot, list float). n(R, 1). q(R, [H | T]), n(R, X), H > X -o h(R, X, H).", "h", ["int", "float"]),
        ("n(R, 1). n(R, X) -o q(R, [X, X]), q(R, [X | []]).", "q", ["list int"]),
        ("n(R, 1). q(R, [a]). n(R, X), q(R, L), M = [X], K = L + [b] -o r(R, M, K).", "r", ["list int", "list symbol"]),
        (
            "q(R, [a]). q(R, L) -o h(R, nth(L, 0), len(L), sort(L), L + L).",
            "h",
            ["symbol", "int"] + ["list symbol"] * 2,
        ),
        ("q(R, [a]). q(R, L) -o h(R, (member(a, L)), if(len(L) > 1, L, [])).", "h", ["bool", "list symbol"]),
        ('n(R, "a"). n(R, X) -o h(R, X + "b", len(X)).', "h", ["string", "int"]),
    ],
)
def test_types_flow_into_lists_and_out_of_them(text, name, expected):
    assert types(text, name) == expected


def test_a_list_of_ints_is_one_of_floats_where_it_is_given_to_one():
    text = "type p(robot, list float). n(R, 1). n(R, X) -o p(R, [X, 2]), p(R, [X / 2]), p(R, [1, 2])."
    program = compiled(text)
    assert types(text, "n") == ["int"]
    mixed, floats, constant = (part.args[0] for part in program.rules[0].head)
    assert [code[-1].op for code in (mixed, floats)] == [Op.FLOAT, Op.LIST]
    assert repr(constant[0].operand) == "(1.0, 2.0)"


def test_what_takes_a_list_apart_takes_its_type_from_where_the_parts_go():
    text = "type n(robot, int). q(R, [H | T]) -o n(R, H), q(R, T)."
    assert types(text, "q") == ["list int"]


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("q(R, [1, a]).", "a"),
        ("q(R, [1]). q(R, [a]).", "[a]"),
        ("q(R, [1 | 2]).", "2"),
        ("q(R, [1 | [a]]).", "[a]"),
        ("q(R, [1]). q(R, [H | T]), H = a -o 1.", "H"),
        ("q(R, [1]). q(R, [b | T]) -o 1.", "[b | T]"),
        ("q(R, [1]). q(R, L) -o q(R, L + 1).", "L + 1"),
        ("q(R, [1]). q(R, L) -o q(R, L + [a]).", "L + [a]"),
        ("q(R, [1]). q(R, L) -o n(R, L * 2).", "L"),
        ("q(R, [1]). q(R, L), L < L -o 1.", "L"),
        ("q(R, [2.5]). q(R, L) -o n(R, L). type n(robot, list int).", "L"),
        ("q(R, 1). q(R, L), len(L) > 1 -o 1.", "L"),
        ("q(R, [1]). q(R, L), (member(a, L)) -o 1.", "(member(a, L))"),
        ("q(R, [[1]]). q(R, L) -o q(R, sort(L)).", "L"),
        ("q(R, [true]). q(R, L) -o q(R, sort(L)).", "L"),
        ("q(R, [1]). q(R, L) -o n(R, nth(L, 1.5)).", "1.5"),
        ('q(R, "a"). q(R, S) -o q(R, S + 1).', "S + 1"),
    ],
)
def test_a_contradiction_of_lists_is_reported_once_at_its_place(text, place):
    found = [each for each in compile_source(text).diagnostics if each.code.startswith("E")]
    assert [(each.code, text[each.span.start : each.span.end]) for each in found] == [("E020", place)]


def test_a_contradiction_within_lists_shows_where_the_items_come_from():
    text = "n(R, 1). n(R, X) -o q(R, [X, X]). q(R, [a])."
    [diagnostic] = compile_source(text).errors
    assert diagnostic.message == "this argument of `q` is a list of ints, here it is a list of symbols"
    assert [text[note.span.start : note.span.end] for note in diagnostic.notes] == ["1"]


@pytest.mark.parametrize(
    ("call", "hint"),
    [("nth(0, L)", "`nth(L, 0)`"), ("if(member(L, 1), 1, 2)", "`member(X, L)`"), ("nth(L, 2 / 2)", "`floor(X)`")],
)
def test_swapped_and_fractional_arguments_get_a_hint(call, hint):
    [diagnostic] = compile_source(f"q(R, [1]). q(R, L) -o n(R, {call}).").errors
    assert (diagnostic.code, hint in (diagnostic.hint or "")) == ("E020", True)


def test_functions_of_lists_have_their_number_of_arguments_and_rest_is_none():
    assert places("q(R, [1]). q(R, L) -o n(R, nth(L)), n(R, rest(L, 1)).") == [("E011", "nth(L)"), ("E015", "rest")]


ENDLESS = [
    ("p(R, X) -o p(R, [X]).", "[X]"),
    ("p(R, [X]) -o p(R, X).", "[X]"),
    ("p(R, X), X = [X] -o 1.", "[X]"),
    ("p(R, L), L = [X], X = L -o 1.", "[X]"),
    ("p(R, X) -o p(R, [[X]]).", "[[X]]"),
    ("p(R, X) -o q(R, [X]). q(R, X) -o p(R, X).", "[X]"),
    ("p(R, X), q(R, [X | X]) -o 1.", "[X | X]"),
    ("p(R, X) -o [collect X => L | p(R, X) | p(R, L)].", "[collect X => L | p(R, X) | p(R, L)]"),
]


@pytest.mark.parametrize(("text", "place"), ENDLESS)
def test_a_type_without_end_is_an_error_at_the_list_that_makes_it(text, place):
    assert place in [found for code, found in places(text) if code == "E020"]


def test_use_of_an_infinite_type_is_no_error_beside_its_definition():
    text = "p(R, X) -o p(R, [X]), q(R, [X, X]). q(R, Y), Z = [Y, Y] -o s(R, Z)."
    assert [found for code, found in places(text) if code == "E020"] == ["[X]"]


def test_lists_in_lists_are_bounded():
    deep = "list " * 17 + "int"
    assert places(f"type p(robot, {deep}).") == [("E004", deep)]
    value = "[" * 17 + "X" + "]" * 17
    assert places(f"type n(robot, int). n(R, X) -o p(R, {value}).") == [("E004", value)]
    assert errors(f"p(R, {value.replace('X', '1')}).") == ["E023"]
    assert errors(f"type p(robot, {'list ' * 16}int). p(R, {'[' * 16}1{']' * 16}).") == []


# ---- aggregates


@pytest.mark.parametrize(
    ("aggregate", "expected"),
    [
        ("[count => V | q(R, X, A) | v(R, V)]", "int"),
        ("[sum X => V | q(R, X, A) | v(R, V)]", "float"),
        ("[sum N => V | n(R, N) | v(R, V)]", "int"),
        ("[min X + 1 => V | q(R, X, A) | v(R, V)]", "float"),
        ("[max S => V | name(R, S) | v(R, V)]", "string"),
        ("[collect A => V | q(R, X, A) | v(R, V)]", "list area"),
        ("[collect [A] => V | q(R, X, A) | v(R, V)]", "list list area"),
        ("[min X => V | q(R, X, A) | v(R, A)]", "area"),
    ],
)
def test_an_aggregate_gives_its_result_a_type(aggregate, expected):
    text = f"type q(robot, float, area). type n(robot, int). type name(robot, string). t(R). t(R) -o {aggregate}."
    assert types(text, "v") == [expected]


def test_the_sum_of_nothing_is_an_int_that_floats_take():
    program = compiled("type q(robot, float). type v(robot, float). t(R). t(R) -o [sum X => V | q(R, X) | v(R, V)].")
    assert [each.op for each in program.rules[0].head[0].head[0].args[0]] == [Op.LOAD, Op.FLOAT]


def test_variables_of_an_aggregate_are_its_own():
    text = "type q(robot, float). t(R). t(R) -o [sum X => V | q(R, X) | v(R, V)], [count => X | q(R, _) | w(R, X)]."
    assert (types(text, "v"), types(text, "w")) == (["float"], ["int"])


@pytest.mark.parametrize(
    ("aggregate", "place", "hint"),
    [
        ("[sum A => V | q(R, A, B) | v(R, V)]", "A", "`collect` lists values"),
        ("[min A => V | q(R, A, B) | v(R, V)]", "A", None),
        ("[max B => V | q(R, A, B) | v(R, V)]", "B", "`[max id(B) => V | ...`"),
        ("[count => V | q(R, A, B) | name(R, V)]", "V", None),
        ("[collect A => V | q(R, A, B) | name(R, V)]", "V", None),
    ],
)
def test_a_term_that_does_not_fit_its_aggregate_is_an_error(aggregate, place, hint):
    text = f"type q(robot, area, robot). type name(robot, string). t(R). t(R) -o {aggregate}."
    [diagnostic] = compile_source(text).errors
    assert (diagnostic.code, text[diagnostic.span.start : diagnostic.span.end]) == ("E020", place)
    assert diagnostic.hint is None if hint is None else hint in diagnostic.hint


# ---- other robots


def test_the_robot_of_an_effect_is_a_robot():
    text = "type action give(R: robot, B: robot, N: int) -o has(B, N). q(R, B) -o give(R, B, 3). q(@1, @2)."
    assert types(text, "has") == ["int"]
    assert places(text.replace("has(B, N)", "has(N, B)")) == [("E021", "N")]


def test_robots_of_an_assertion_are_known_by_standing_first():
    text = "x: assert(off(A, B, N), on(B, N), 3, alarm(B, A)). off(A, B, N) -o on(B, N)."
    assert types(text, "off") == ["robot", "open"]
    assert types(text, "alarm") == ["robot"]


def test_the_owners_name_and_a_repeated_variable_have_one_type():
    assert types("p(R, R).", "p") == ["robot"]
    assert types("type q(robot, int). q(R, X) -o p(R, X, X). ?p(R, X, X).", "p") == ["int", "int"]
    assert places("p(R, 3). p(R, R).") == [("E020", "R")]
    assert ("E020", "X") in places("p(@1, 3, a). ?p(R, X, X).")


def test_steps_give_types_as_facts_do():
    text = "type action go(robot, area). t(R, A), u(R, N) -o go(R, A) then n(R, N + 0.5) then ?n(R, 2)."
    assert (types(text, "t"), types(text, "n")) == (["area"], ["float"])


# ---- bangs, and what they contradict


def test_one_bang_anywhere_makes_every_use_persistent():
    for text in (
        "p(R, 1). p(R, X), !p(R, X) -o 1.",
        "p(R, 1) -o 1. q(R) -o !p(R, 2.5). q(R).",
        "p(R, 1). type action a(R: robot) -o !p(R, 2).",
        "assert(!p(R, X), q(R), 1, v(R)). p(R, 1). r(R) -o q(R). r(R).",
        "p(R, 1). t(R) -o [count => N | !p(R, X) | n(R, N)]. t(R).",
        "p(R, 1). t(R), not !p(R, 2) -o 1. t(R).",
    ):
        program = compiled(text)
        assert program.predicates[program.index("p")].kind is Kind.PERSISTENT, text


def test_a_fact_that_is_kept_and_persistent_shows_the_bang():
    text = "p(R, 1). !p(R, 2). $p(R, X) -o 1."
    [diagnostic] = compile_source(text).errors
    [note] = diagnostic.notes
    assert (diagnostic.code, text[note.span.start : note.span.end]) == ("E012", "!p(R, 2)")


def test_a_bang_and_a_contradiction_count_across_files(tmp_path):
    from rmr.lang.compiler import compile_file

    (tmp_path / "facts.rmr").write_text("!p(R, 1).\nq(R, a).\n")
    main = tmp_path / "main.rmr"
    main.write_text('include "facts.rmr".\np(R, 2.5).\nq(R, 3).\n')
    compilation = compile_file(main)
    [diagnostic] = compilation.errors
    assert (diagnostic.code, diagnostic.span.file) == ("E020", str(main))
    assert [note.span.file for note in diagnostic.notes] == [str(tmp_path / "facts.rmr")]
    main.write_text('include "facts.rmr".\np(R, 2.5).\n')
    program = compile_file(main).program
    assert program is not None
    predicate = program.predicates[program.index("p")]
    assert (predicate.kind, predicate.types[0].base) == (Kind.PERSISTENT, Base.FLOAT)


def test_open_type_is_inferred_as_the_narrowest_of_its_uses():
    asking = ["p(R, X) -o a(R, X).", "p(R, X) -o b(R, X)."]
    for items in (asking, asking[::-1]):
        text = "type a(robot, int). type b(robot, float). " + " ".join(items)
        assert types(text, "p") == ["int"]
