"""What is legal and yet probably not meant."""

import pytest
from lang_source import codes, places

from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.fact_size import DELIVERY_OCTETS_MAX, FACT_OCTETS_MAX, value_octets
from rmr.lang.compiler import compile_source, compile_text
from rmr.lang.read.source_text import SourceText
from rmr.node.payloads import (
    FACT_BODY_OCTETS_MAX,
    PARTS_MAX,
    Delivery,
    DeliveryRole,
    WireError,
    encode_delivery,
    encode_fact_frames,
)


def doubts(text):
    compilation = compile_source(text)
    assert compilation.program is not None, compilation.errors
    return [(each.code, text[each.span.start : each.span.end]) for each in compilation.diagnostics]


def messages(text, code):
    return [each.message for each in compile_source(text).diagnostics if each.code == code]


def hints(text, code):
    return [each.hint for each in compile_source(text).diagnostics if each.code == code]


# ---- variables that may be constants


def test_a_symbol_in_a_list_or_an_aggregate_is_a_constant_too():
    assert doubts("p(R, [s, t]). p(R, L), L = [S | _] -o 1.") == [("W101", "S")]
    assert doubts("p(R, s). t(R). t(R) -o [count => N | p(R, S) | n(R, N)].") == [("W101", "S")]
    assert doubts("p(R, s). t(R). t(R) -o {S | p(R, S) | n(R, S)}.") == []


# ---- rules that never fire


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("egg(R) -o hen(R). hen(R) -o egg(R).", ["egg(R)"]),
        ("loop(R, X) -o loop(R, X + 1).", ["loop(R, X)"]),
        ("b(R) -o a(R), b(R). a(R) -o c(R). c(R) -o d(R). d(R) -o 1.", ["b(R)"]),
        ("d(R) -o 1. c(R) -o d(R). a(R) -o c(R). a(R), b(R) -o a(R).", ["a(R)", "b(R)"]),
        ("a(R) -o b(R). b(R) -o a(R). x(R) -o y(R). y(R) -o x(R).", ["a(R)", "x(R)"]),
        ("t(R). t(R) -o {X | a(R, X) | a(R, X)}.", ["a(R, X)"]),
        ("t(R). t(R) -o [min X => V | a(R, X) | a(R, V)].", ["a(R, X)"]),
        ("a(R) -o b(R) then a(R).", ["a(R)"]),
        ("a(R) -o ?a(R), b(R). b(R) -o a(R).", ["a(R)"]),
    ],
)
def test_mutually_dependent_rules_get_one_warning_for_each_cycle(text, expected):
    assert sorted(place for code, place in doubts(text) if code == "W102") == expected


@pytest.mark.parametrize(
    "text",
    [
        "egg(R). egg(R) -o hen(R). hen(R) -o egg(R).",
        "type egg(robot). egg(R) -o hen(R). hen(R) -o egg(R).",
        "type action lay(R: robot) -o egg(R). egg(R) -o hen(R). hen(R) -o egg(R), lay(R).",
        "t(R). t(R) -o [count => V | a(R, V) | a(R, V)]. a(R, X) -o 1.",
        "t(R). t(R), not egg(R) -o egg(R). egg(R) -o hen(R).",
        "at(R, exit) -o a(R). a(R) -o b(R). b(R) -o a(R).",
    ],
)
def test_rule_cycle_with_an_initial_fact_gets_no_warning(text):
    assert "W102" not in codes(text)


def test_warning_names_the_comprehension_or_aggregate_that_finds_nothing():
    text = """t(R). t(R) -o {X | a(R, X) | c(R, X)}, [count => N | b(R, _), false | n(R, N)],
    {X | t(R), X = 1, X = 2 | t(R)}."""
    assert messages(text, "W102") == [
        "nothing states or derives `a`, the comprehension derives nothing",
        "nothing states or derives `b`, the aggregate finds nothing",
        "this is never true, the aggregate finds nothing",
        "`X` cannot be both, the comprehension derives nothing",
    ]


def test_function_used_as_a_fact_gets_a_hint():
    [hint] = hints("p(R, 1). p(R, X), max(R, X) -o 1.", "W102")
    assert "`(max(...))`" in hint


def test_a_constant_that_contradicts_is_found_on_either_side_and_worked_out():
    text = "p(R, 5). p(R, X), X = 2 + 3, 7 - 1 = X -o 1."
    assert ("W102", "7 - 1 = X") in doubts(text)


# ---- goals and finish facts


@pytest.mark.parametrize(
    "deriving",
    [
        "t(R) -o g(R, 1).",
        "t(R) -o u(R) then g(R, 1).",
        "t(R) -o [sum X => V | u(R, X) | g(R, V)].",
        "t(R) -o {X | u(R, X) | g(R, X)}.",
        "t(R) -o g(@7, 1).",
        "type action a(R: robot, B: robot) -o g(B, 1).",
        "type action a(R: robot) -o u(R) else g(R, 1).",
    ],
)
def test_a_goal_and_a_finish_fact_are_reached_by_whatever_derives_them(deriving):
    text = f"t(R). type u(robot). {deriving} ?g(R, 1). x: assert(t(R), g(R, 1), 1, stop(R)).".replace(
        "type u(robot). t(R) -o [", "type u(robot, int). t(R) -o ["
    ).replace("type u(robot). t(R) -o {", "type u(robot, int). t(R) -o {")
    assert {"W103", "W104"}.isdisjoint(codes(text))


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("t(R). t(R) -o g(R, 2) then u(R). ?g(R, 1).", "g(R, 1)"),
        ("t(R, s). t(R, L), L = s -o g(R, L). ?g(R, t).", "g(R, t)"),
        ("t(R). t(R) -o g(R, 1, 2). ?g(R, X, X).", "g(R, X, X)"),
        ("t(R, 1). t(R, X) -o g(R, X, X). ?g(R, 1, 2).", "g(R, 1, 2)"),
        ("g(@1, 1). ?g(@2, 1).", "g(@2, 1)"),
        ("t(R). t(R) -o g(R, [1, 2]). ?g(R, [1]).", "g(R, [1])"),
        ("t(R). t(R) -o ?g(R, 1).", "?g(R, 1)"),
        ("t(R, s). t(R, L), L = s -o g(R, L), ?g(R, t).", "?g(R, t)"),
    ],
)
def test_unreachable_goal_gets_a_warning(text, place):
    assert ("W103", place) in doubts(text)


def test_no_hint_says_to_declare_what_the_program_derives():
    assert hints("t(R). t(R) -o g(R, 2). ?g(R, 1). ?h(R).", "W103") == [
        None,
        "declare it if it comes from outside: `type h(...)`",
    ]


# ---- sizes and times

LONG = '"' + "x" * 50 + '"'


@pytest.mark.parametrize(
    "derived",
    [
        f"q(B, [{LONG}, {LONG}, 1, 2])",
        f"t(R) then q(B, [{LONG}, {LONG}, 1])",
        f"q(B, [{LONG}] + [{LONG}, 1])",
        f"q(@5, [{LONG}, if(R = B, {LONG}, {LONG} + {LONG})])",
        f"{{C | p(R, C) | q(C, [{LONG}, {LONG}, 1])}}",
        f"[count => N | p(R, _) | q(B, [{LONG}, {LONG}, N])]",
        f"q(B, [{LONG} | [{LONG}, {LONG}]])",
    ],
)
def test_fact_for_another_robot_larger_than_a_frame_gets_a_warning(derived):
    derived = derived.replace(", 1", ', "1"').replace(", 2", ', "2"').replace(", N]", ', "N"]')
    text = f"type p(robot, robot). type q(robot, list string). type t(robot). p(R, B), t(R) -o {derived}."
    assert "W105" in [code for code, _ in doubts(text)]
    assert "W105" not in codes(text.replace("q(B", "q(R").replace("q(@5", "q(R").replace("q(C", "q(R"))


@pytest.mark.parametrize(("letters", "expected"), [(6905, ["W105"]), (6906, ["E008"])])
def test_fact_for_another_robot_larger_than_one_delivery_is_an_error(letters, expected):
    text = f'p(R, 1). type told(robot, string). p(R, _), peer(R, B) -o told(B, "{"x" * letters}").'
    assert codes(text) == expected
    assert codes(text.replace("told(B", "told(R")) == []


def test_delivery_size_limit_equals_that_of_the_node():
    kind = Type(Base.STRING)
    fits, exceeds = ("x" * (DELIVERY_OCTETS_MAX - value_octets("", kind) + more) for more in (0, 1))
    assert len(encode_fact_frames(0, 0, 0, encode_delivery(Delivery(DeliveryRole.FACT, 0, (fits,)), {}))) == PARTS_MAX
    with pytest.raises(WireError):
        encode_fact_frames(0, 0, 0, encode_delivery(Delivery(DeliveryRole.FACT, 0, (exceeds,)), {}))


def test_smaller_branch_of_an_if_decides_whether_a_fact_is_too_large_to_send():
    long = '"' + "x" * 7000 + '"'
    text = f'p(R, 1). type told(robot, string). p(R, X), peer(R, B) -o told(B, if(X > 1, {long}, "s")).'
    assert codes(text) == ["W105"]
    assert codes(text.replace('"s"', long)) == ["E008"]


def test_violation_for_another_robot_larger_than_a_frame_gets_a_warning():
    text = f"p(R, @2). p(R, B) -o q(R). watch(p(R, B), q(R), 1, say(B, {LONG} + {LONG} + {LONG}))."
    assert [code for code, _ in doubts(text)] == ["W105"]
    assert codes(text.replace("say(B", "say(R")) == []


def test_effect_on_another_robot_larger_than_a_frame_gets_a_warning():
    text = f"type action give(R: robot, B: robot) -o q(B, {LONG} + {LONG} + {LONG})."
    assert [code for code, _ in doubts(text)] == ["W105"]
    assert codes(text.replace("q(B", "q(R")) == []


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        (True, Type(Base.BOOL)),
        (7, Type(Base.INT)),
        (-129, Type(Base.INT)),
        (2.5, Type(Base.FLOAT)),
        ("naïve", Type(Base.STRING)),
        (((1, 300), ()), Type(Base.LIST, element=Type(Base.LIST, element=Type(Base.INT)))),
    ],
)
def test_value_sizes_equal_those_in_a_frame(value, kind):
    empty, full = (len(encode_delivery(Delivery(DeliveryRole.FACT, 0, args), {})) for args in ((), (value,)))
    assert value_octets(value, kind) == full - empty
    assert FACT_BODY_OCTETS_MAX - empty == FACT_OCTETS_MAX


@pytest.mark.parametrize("deadline", ["5ms", "1 / 100", "0", "2 * 8ms", "const tick"])
def test_deadline_below_a_tick_gets_a_warning(deadline):
    before, written = ("const tick = 1ms.", "tick") if deadline == "const tick" else ("", deadline)
    text = f"{before} p(R). watch(p(R), q(R), {written}, stop(R)). p(R) -o q(R)."
    assert doubts(text) == [("W106", written)]


# ---- types


@pytest.mark.parametrize(
    ("declarations", "doubted", "meant"),
    [
        ("type p(robot, flaot).", "flaot", "float"),
        ("type p(robot, list strng).", "strng", "string"),
        ("type p(robot, it).", "it", "int"),
        ("type p(robot, ints).", "ints", "int"),
        ("type p(robot, booll).", "booll", "bool"),
        ("type action a(R: robot, B: roobt).", "roobt", "robot"),
        ("type p(robot, integer). type q(robot, integer).", "integer", "int"),
        ("type p(robot, zone). type q(robot, zone). type r(robot, zoen).", "zoen", "zone"),
        ("type p(robot, zone). type q(robot, zone). type r(robot, zones).", "zones", "zone"),
        ("type p(robot, colours).", "colours", "colour"),
    ],
)
def test_type_name_similar_to_a_known_one_gets_a_warning(declarations, doubted, meant):
    text = declarations
    assert [(code, place) for code, place in doubts(text) if code == "W111"] == [("W111", doubted)]
    assert hints(text, "W111") == [f"did you mean `{meant}`?"]


@pytest.mark.parametrize(
    "declarations",
    [
        "type p(robot, lane). type q(robot, lane). type r(robot, line).",
        "type p(robot, zones). type q(robot, zone).",
        "type p(robot, area, event, colour, tool, list bool).",
        "type p(robot, point, unit, floor, spring, cool).",
        "type p(robot, zoen). type q(robot, zoen). type r(robot, zone). type s(robot, zone).",
    ],
)
def test_distinct_type_name_gets_no_warning(declarations):
    assert "W111" not in codes(declarations)


# ---- effort


def test_spelling_suggestions_are_bounded_and_go_to_the_first_names():
    known = "".join(f"type thing{k}(robot). " for k in range(120))
    misspelt = "".join(f"thign{k}(R) -o 1. " for k in range(120))
    found = [hint for hint in hints(known + misspelt, "W102") if hint and hint.startswith("did you mean")]
    assert 50 <= len(found) <= 100


def test_overlong_names_get_no_spelling_suggestions():
    long = "a" * 50_000
    assert (
        hints(f"type p(robot, {long}). type q(robot, {long}). type r(robot, {long}s). {long}(R) -o {long}b(R).", "W111")
        == []
    )


def test_warnings_are_in_source_order():
    spans = [each.span.start for each in compile_source("b(R) -o a(R). ?c(R). d(R), e(R) -o f(R).").diagnostics]
    assert spans == sorted(spans)
    assert places("b(R) -o a(R).")[0] == ("W102", "b(R)")


# --- a declared persistent fact that nothing brings


WANTED = "type !broken(robot).\nstart(@1).\nstart(R), !broken(R) -o left(R).\nleft(R) -o 1.\n"


@pytest.mark.parametrize(
    ("text", "given", "closed", "code"),
    [
        (WANTED, {}, True, "W102"),
        (WANTED, {}, False, None),  # it may come from outside
        (WANTED, {"broken": True}, True, None),
        (WANTED.replace("left(R) -o 1.", "left(R) -o !broken(R)."), {}, True, "W102"),  # a cycle
        (WANTED + "!broken(@2).\n", {}, True, None),
        (WANTED.replace("!broken(R) -o", "not broken(R) -o"), {}, True, None),
        (WANTED.replace("!", "").replace("type ", "type sensor "), {}, True, None),
    ],
)
def test_a_declared_persistent_fact_is_missed_where_all_that_comes_from_outside_is_known(text, given, closed, code):
    found = compile_text(SourceText("p.rmr", text), given, closed=closed).diagnostics
    assert [each.code for each in found] == ([] if code is None else [code])
    if code is not None:
        assert "that there is none is `not broken(...)`" in (found[0].hint or "")
