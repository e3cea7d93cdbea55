"""What the compiler works out beforehand is what the virtual machine would have made of it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.base.values import Robot, Symbol, format_value
from rmr.bytecode.arithmetic import NoValue, same
from rmr.bytecode.opcodes import Op
from rmr.lang.compiler import compile_source
from rmr.vm.evaluate import evaluate

pytestmark = pytest.mark.medium

NUMBERS = st.sampled_from([0, 1, 2, -3, 7, 2**62, -(2**63) + 1, 0.0, 0.5, -2.5, 1e308])
WORDS = st.sampled_from(["", "a", "xyz", Symbol("a"), Symbol("exit"), True, False, Robot(1), Robot(40)])
ITEMS = [[0, 1, 2, 3], [1, 2.5], ["b", "a"], [Robot(1), Robot(0)]]
LISTS = st.one_of(*(st.lists(st.sampled_from(each), max_size=3) for each in ITEMS))
CONSTANTS = NUMBERS | NUMBERS | WORDS | LISTS.map(tuple)

BINARY = ["+", "-", "*", "/", "%", "=", "!=", "<", "<=", ">", ">=", "&&", "||"]
FORMS = [
    *(f"({{}} {operator} {{}})" for operator in BINARY),
    *("-({})", "(not {})", "[{}]", "[{}, {}]", "[{}, {} | {}]", "if({}, {}, {})"),
    *("abs({})", "min({}, {})", "max({}, {})", "floor({})", "sqrt({})", "sin({})", "atan2({}, {})", "id({})"),
    *("len({})", "nth({}, {})", "member({}, {})", "sort({})"),
]


def combined(parts):
    """Return an expression over parts; each is a text with a `#` for every constant, and these constants."""
    return st.sampled_from(FORMS).flatmap(
        lambda form: st.lists(parts, min_size=form.count("{}"), max_size=form.count("{}")).map(
            lambda given: (form.format(*(text for text, _ in given)), [value for _, each in given for value in each])
        )
    )


EXPRESSIONS = st.recursive(CONSTANTS.map(lambda value: ("#", [value])), combined, max_leaves=8)


def program(text, words):
    for word in words:
        text = text.replace("#", word, 1)
    return text


@given(EXPRESSIONS)
@settings(max_examples=200, deadline=None)
def test_a_folded_expression_has_the_value_that_the_machine_gives_it(expression):
    text, values = expression
    names = [f"X{index}" for index in range(len(values))]
    folded = compile_source("t(R) -o out(R, " + program(text, map(format_value, values)) + ").")
    arguments = "".join(f", {name}" for name in names)
    computed = compile_source(f"t(R{arguments}) -o out(R, {program(text, names)}).")
    if folded.program is None or computed.program is None:
        return
    [instruction, *others] = folded.program.rules[0].head[0].args[0]
    code = computed.program.rules[0].head[0].args[0]
    try:
        value = evaluate(code, [Robot(9), *values], 0)
    except NoValue:
        assert others, "folded to a value that the machine does not find"
        assert "W110" in [each.code for each in folded.diagnostics]
        return
    if others:
        lazy = "if(" in text or "&&" in text or "||" in text
        assert lazy, "left to the machine, although it has a value"
    else:
        assert instruction.op in {Op.CONST, Op.INT}
        assert same(instruction.operand, value)
        assert type(instruction.operand) is type(value)


@given(EXPRESSIONS)
@settings(max_examples=100, deadline=None)
def test_a_constant_has_a_value_or_an_error_that_says_why_not(expression):
    text, values = expression
    given = program(text, map(format_value, values))
    compilation = compile_source(f"const c = {given}. p(R, {given}). ?q(R, {given}). r(R, c).")
    assert all(each.code in {"E005", "E020", "E021", "E022", "E023"} for each in compilation.errors)
    if compilation.program is not None:
        here, there = (fact.args for fact in compilation.program.facts)
        assert same(here, there)
