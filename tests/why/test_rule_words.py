"""Conjuncts of byte-code as text: infix expressions with as few parentheses as the language needs, values in place."""

import pytest

from rmr.base.values import Robot
from rmr.bytecode.program import Atom, Bind, Guard
from rmr.lang.compiler import compile_text
from rmr.lang.read.source_text import SourceText
from rmr.why.rule_words import LENGTH_MAX, conjunct_text, rule_name, shortened


def conjuncts(condition):
    stated = "type p(robot, int, int).\ntype q(robot, list int).\np(R, 1, 2).\nq(R, [1]).\n"
    text = f"{stated}p(R, X, Y), {condition} -o 1.\n"
    program = compile_text(SourceText("a.rmr", text)).program
    assert program is not None, condition
    return program, program.rules[0]


@pytest.mark.parametrize(
    "condition",
    [
        "X + Y * 2 > 3",
        "(X + Y) * 2 > 3",
        "X - (Y - 1) < 5",
        "X - Y - 1 < 5",
        "X > 3 || Y > 2 && X < 4",
        "(X > 3 || Y > 2) && X < 4",
        "not (X > 3 && Y > 2)",
        "-(X + Y) < 0",
        "X / 2 != 1.5",
        "if(X > 1, Y, X + 1) = 2",
        "if(X > 1 || Y > 1, if(Y > 2, 1, 2), 3) = 2",
        "max(X, abs(Y - 3)) >= X % 2",
        "len([X, Y, 3]) = 3",
        "member(X, [1, 2])",
    ],
)
def test_condition_is_written_as_in_the_program_with_values(condition):
    program, rule = conjuncts(condition)
    slots = {"X": 8, "Y": 9}
    env = [Robot(1), 8, 9, *[None] * rule.slots]
    [guard] = [each for each in rule.body if isinstance(each, Guard)]
    expected = "".join(str(slots.get(each, each)) for each in condition)
    assert conjunct_text(program, guard, 1, env) == expected


def test_unknown_values_are_underscores_and_bindings_have_their_variable_in_front():
    program, rule = conjuncts("Z = X + Y, Z > 3, not q(R, [Z])")
    nothing = [Robot(1), *[None] * rule.slots]
    texts = [conjunct_text(program, each, 1, nothing) for each in rule.body]
    assert texts[0] == "p(@1, _, _)"
    assert "_ = _ + _" in texts
    assert "_ > 3" in texts
    assert [text for text in texts if text.startswith("not q(@1, ")]
    assert any(isinstance(each, Bind) for each in rule.body)
    assert isinstance(rule.body[0], Atom)


def test_rules_are_named_by_file_and_line_and_long_texts_lose_their_middle():
    program, _ = conjuncts("X > 1")
    assert rule_name(program, 0) == "rule a.rmr:5"
    assert len(shortened("x" * 5000)) < LENGTH_MAX + 10
