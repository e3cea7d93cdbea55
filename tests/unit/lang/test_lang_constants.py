"""Constants and what is worked out before the program runs."""

import pytest
from lang_source import codes, compiled, errors, places

from rmr.base.values import Robot, Symbol
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Constant, Guard, Slot
from rmr.lang.compiler import compile_file, compile_source


def value(expression, before=""):
    [fact] = compiled(f"{before} p(R, {expression}).").facts
    return fact.args[0]


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("2 * 3 + 1", 7),
        ("-(5)", -5),
        ("7 / 2", 3.5),
        ("-7 % 3", 2),
        ("1.5min + 10", 100.0),
        ('"a" + "b"', "ab"),
        ("[1, 2] + [3]", (1, 2, 3)),
        ("[1 | [2, 3]]", (1, 2, 3)),
        ("[[a], []]", ((Symbol("a"),), ())),
        ("[1, 2.5]", (1.0, 2.5)),
        ("nth([a, b], 1)", Symbol("b")),
        ("sort([3, 1, 2])", (1, 2, 3)),
        ("len([1, 2]) + len(\"xyz\")", 5),
        ("member(@2, [@1, @2])", True),
        ("max(1, 2.5)", 2.5),
        ("floor(dist(0, 0, 3, 4))", 5),
        ("id(@7)", 7),
        ("1 < 2 && not (2 = 3)", True),
        ("a != b || false", True),
        ("if(1 > 2, left, right)", Symbol("right")),
        ("-9223372036854775807 - 1", -(2**63)),
    ],
)  # fmt: skip
def test_operators_and_functions_of_constants_are_constants(expression, expected):
    found = value(expression)
    assert found == expected
    assert type(found) is type(expected)
    assert value("c", f"const c = {expression}.") == expected


def test_a_constant_stands_for_its_value_wherever_an_expression_may_stand():
    text = """
    const boss = @1. const area = entry. const n = 2 + 1. const route = [area, exit].
    p(boss, area, n, route). ?q(boss, n). q(boss, 9).
    p(R, A, N, L), A = area, nth(route, 1) = A -o q(boss, n), [count => V | p(R, area, _, _) | q(R, V + n)].
    x: assert(p(R, area, N, L), q(R, n), n * 1s, stop(boss)).
    """
    program = compiled(text)
    assert program.facts[0].owner == 1
    assert program.facts[0].args == (Symbol("entry"), 3, (Symbol("entry"), Symbol("exit")))
    [rule] = program.rules
    assert rule.body[0].args[0] == Constant(Symbol("entry"))
    assert rule.head[0].owner[0].operand == Robot(1)
    [assertion] = program.assertions
    assert assertion.finish.args == (Constant(3),)
    assert [each.operand for each in assertion.deadline] == [3.0]


def test_constant_parts_of_a_rule_are_one_constant_in_the_byte_code():
    program = compiled("p(R, 1). p(R, X), X < 2 * 3, X != 4 + X * (3 - 1) -o p(R, -(2 + 3)), p(R, 2 * 3 + X).")
    guards = [each.code for each in program.rules[0].body if isinstance(each, Guard)]
    assert [each.operand for each in guards[0]] == [1, 6, None]
    assert [each.op for each in guards[1]] == [Op.LOAD, Op.INT, Op.LOAD, Op.INT, Op.MUL, Op.ADD, Op.NE]
    assert [[(each.op, each.operand) for each in head.args[0]] for head in program.rules[0].head] == [
        [(Op.INT, -5)],
        [(Op.INT, 6), (Op.LOAD, 1), (Op.ADD, None)],
    ]


def test_an_equation_with_a_constant_expression_replaces_its_variable():
    [rule] = compiled("p(R, 1). p(R, X), X = 2 * 3 -o p(R, X).").rules
    assert (rule.slots, rule.body[0].args) == (1, (Constant(6),))
    [rule] = compiled("p(R, [1]). p(R, X), X = [1] + [2] -o p(R, X).").rules
    assert rule.body[0].args == (Constant((1, 2)),)


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("const a = 1 / 0.", "E023", "1 / 0"),
        ("const a = 2 + sqrt(0 - 1).", "E023", "sqrt(0 - 1)"),
        ("const a = nth([1], 1).", "E023", "nth([1], 1)"),
        ("const a = 9223372036854775807 + 1.", "E005", "9223372036854775807 + 1"),
        ("const a = 1e308 * 10.", "E005", "1e308 * 10"),
        ("const a = now().", "E023", "now()"),
        ("const a = X.", "E023", "X"),
        ('const a = "x" * 2.', "E023", '"x" * 2'),
        ("p(R, 3 % 0).", "E023", "3 % 0"),
        ("?p(R, 9223372036854775807 * 2).", "E005", "9223372036854775807 * 2"),
        ("p(R, X + 1).", "E023", "X + 1"),
        ("p(R, [X]).", "E023", "[X]"),
        ("?p(R, [X]).", "E023", "[X]"),
        ("const a = b. const b = 1.", "E023", "b"),
        ("const a = [1, a].", "E023", "a"),
    ],
)
def test_non_constant_is_reported_with_place_and_reason(text, code, place):
    assert (code, place) in places(text)
    assert errors(text) == [code]


def test_type_contradiction_in_a_stated_fact_is_reported_once():
    assert places("p(R, 1 + a).") == [("E020", "a")]
    assert places("p(R, [1, a]).") == [("E020", "a")]


@pytest.mark.parametrize(
    ("rule", "place"),
    [
        ("p(R, X), X > 1 / 0 -o 1.", "1 / 0"),
        ("p(R, X) -o p(R, X % (2 - 2)).", "X % (2 - 2)"),
        ("p(R, X) -o p(R, if(X > 1, 9223372036854775807 + 1, X)).", "9223372036854775807 + 1"),
        ("p(R, X) -o [sum X / 0 => V | p(R, X) | p(R, floor(V))].", "X / 0"),
        ("assert(p(R, X), p(R, 2), sqrt(-1), stop(R)).", "sqrt(-1)"),
        ("type action a(R: robot) -o p(R, nth([1], 4)). p(R, 7) -o a(R).", "nth([1], 4)"),
    ],
)
def test_constant_expression_without_value_in_a_rule_is_a_warning_and_not_folded(rule, place):
    text = f"p(R, 1). p(R, 2). {rule}"
    assert ("W110", place) in places(text)
    assert compile_source(text).program is not None


def test_lazy_operators_keep_operands_that_fail_to_fold():
    program = compiled("p(R, 1). p(R, X), X = 0 || 1 / X > 2 -o p(R, if(true, 1, 1 / 0)).")
    assert [each.op for each in program.rules[0].head[0].args[0]][1] is Op.JUMP_IF_FALSE
    assert codes("p(R, 1). p(R, X) -o ?p(R, if(true, 1, 1 / 0)).") == ["W110"]


def test_constants_of_an_included_file_are_earlier(tmp_path):
    (tmp_path / "sizes.rmr").write_text("const width = 2.\nconst area = width * width.\n")
    main = tmp_path / "main.rmr"
    main.write_text('include "sizes.rmr".\nconst volume = area * width.\np(R, volume).\n')
    program = compile_file(main).program
    assert program is not None
    assert program.facts[0].args == (8,)
    main.write_text('const volume = area * 2.\ninclude "sizes.rmr".\np(R, volume).\n')
    [diagnostic] = compile_file(main).errors
    assert (diagnostic.code, diagnostic.notes[0].span.file) == ("E023", str(tmp_path / "sizes.rmr"))


def test_a_list_in_a_pattern_of_constants_is_one_constant():
    [rule] = compiled("p(R, [1, 2]). p(R, [1, 2]), not p(R, [1] + [3]) -o 1.").rules
    assert [each.args for each in rule.body] == [(Constant((1, 2)),), (Constant((1, 3)),)]
    [rule] = compiled("p(R, [1, 2]). p(R, [1, X]) -o 1.").rules
    assert rule.body[0].args == (Slot(1),)
