import random
import re
from pathlib import Path

import pytest
from lang_source import codes, compiled, errors, places

from rmr.lang.compiler import compile_source
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.read.grammar import grammar_text
from rmr.lang.read.misfit import word_of
from rmr.lang.read.parser import NESTING_MAX, parse
from rmr.lang.read.source_text import SourceText
from rmr.lang.read.syntax import (
    AggregateNode,
    ComprehensionNode,
    Condition,
    FactItem,
    FactNode,
    IncludeItem,
    ListTerm,
    Literal,
    RuleItem,
    StepsNode,
)
from rmr.lang.read.table_maker import parser_of


def parsed(text):
    found = Diagnostics()
    module = parse(SourceText("test", text), found)
    assert found.in_order() == []
    return module.items


def value(text):
    [item] = parsed(f"p(R, {text}).")
    assert isinstance(item, FactItem)
    literal = item.fact.arguments[1]
    assert isinstance(literal, Literal)
    return literal.value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("3", 3),
        ("-2", -2),
        ("2.5", 2.5),
        ("1e-3", 0.001),
        ("500ms", 0.5),
        ("2s", 2.0),
        ("1.5min", 90.0),
        ("true", True),
        ("middle", "middle"),
        ('"a \\"b\\" \\\\ \\n"', 'a "b" \\ \n'),
        ("@65533", 65533),
        ("-9223372036854775808", -(2**63)),
    ],
)
def test_a_word_of_the_source_has_its_value(text, expected):
    assert value(text) == expected
    assert type(value(text)).__mro__[-2] is type(expected).__mro__[-2]


def test_times_are_floats_and_whole_numbers_are_ints():
    assert isinstance(value("2s"), float)
    assert type(value("2")) is int


@pytest.mark.parametrize("text", ["99999999999999999999", "9223372036854775808", "1e999", "@65534", "9" * 10000])
def test_a_number_that_does_not_fit_is_an_error(text):
    assert errors(f"p(R, {text}).") == ["E005"]


def test_an_arrow_is_unspaced_and_a_spaced_one_subtracts():
    [rule] = parsed("p(R, X, o), Y = X - o -o q(R, Y).")
    assert isinstance(rule, RuleItem)
    assert len(rule.body) == 2
    assert compiled("p(R) ⊸ q(R).") == compiled("p(R) -o q(R).")


def test_an_arrow_inside_of_arguments_is_an_error_and_never_a_subtraction():
    assert errors("p(R, X) -o q(R, X -o).") == ["E001"]
    assert errors("p(R, X), Y = (X -o) -o q(R, Y).") == ["E001"]


def test_a_call_alone_is_a_fact_and_inside_an_expression_a_function():
    [rule] = parsed("id(R, N), id(R) = N, (if(N > 1, true, false)) -o 1.")
    assert [type(part) for part in rule.body] == [FactNode, Condition, Condition]


def test_not_before_a_call_is_absence_and_before_an_expression_negation():
    [rule] = parsed("a(R, X), not p(R), not !q(R), not (X > 3), not X = 3 -o 1.")
    assert [type(part) for part in rule.body] == [FactNode, FactNode, FactNode, Condition, Condition]
    assert [part.absent for part in rule.body[:3]] == [False, True, True]


def test_the_whole_grammar_is_read():
    text = """
    include "formation.rmr".
    order textual.
    const total = 4.
    type p(robot, list list int).  /* a comment with a . in it */
    a(R, [H | T]) -o b(R) then c(R), [sum X => V | d(R, X) | e(R, V)], {B, C | f(R, B, C) | g(B, C)}.
    """
    items = parsed(text)
    assert isinstance(items[0], IncludeItem)
    rule = items[-1]
    assert isinstance(rule.body[0].arguments[1], ListTerm)
    assert [type(part) for part in rule.head] == [StepsNode, AggregateNode, ComprehensionNode]


def test_names_may_begin_like_reserved_words():
    assert parsed("typewriter(R). notes(R, listing). ordering(R). assertive(R) -o thenceforth(R).")


@pytest.mark.parametrize("word", ["type", "list", "then", "order", "sensor", "not", "include"])
def test_a_reserved_word_names_nothing(word):
    assert set(errors(f"p(R, {word}).")) & {"E006", "E001"}


def test_a_syntax_error_costs_only_its_own_item():
    text = 'p(R, ). q(R). r(R) : x. s(R, "open). t(R) -o u(R, Y). v(R)'
    assert [code for code in errors(text) if code == "E001"] == ["E001"] * 4
    assert ("E030", "Y") in places(text)


def test_every_token_has_a_word_and_none_is_a_regular_expression():
    words = {each.name: word_of(each.name) for each in parser_of(grammar_text()).terminals}
    assert [name for name, word in words.items() if word is None] == ["COMMENT", "WHITESPACE"]
    spelt = [word.strip("`") for word in words.values() if word is not None and word.startswith("`")]
    assert [word for word in spelt if re.search(r"[\\^]|\(.|\[.|.[?*+]", word)] == []
    assert word_of("MINUS") == "`-`"
    assert word_of("ARROW") == "`-o`"


# ---- mistakes of spelling


def told(text):
    """Return place, message and hint of each syntax error."""
    found = compile_source(text).errors
    return [(each.span.start, each.message, each.hint) for each in found if each.code == "E001"]


def test_a_missing_full_stop_is_reported_at_the_end_of_its_item_and_both_are_read():
    text = "type p(robot)\ntype q(robot).\np(R, 1).\nq(R, 1).\n"
    assert told(text) == [(13, "a `.` is missing before `type`", "every item ends with `.`")]
    assert errors(text) == ["E001", "E011", "E011"]


@pytest.mark.parametrize(
    ("text", "sign"),
    [
        ("p(R)\nq(R) -o r(R).", "."),
        ("p(R)\n  q(R) -o r(R).", ","),
        ("p(R) q(R) -o r(R).", ","),
        ("p(R) q(R).", "."),
        ("p(R) -o q(R)\n-o r(R).", None),
        ("p(R) -o q(R)\n  r(R).", ","),
        ("p(R) -o q(R)\nr(R).", "."),
        ("p(R),\nq(R)\nr(R) -o s(R).", ","),
        ("p(R) -o q(R) r(R) -o s(R).", "."),
        ("p(R)", "."),
        ("const a = 1\n!p(R).", "."),
    ],
)
def test_missing_comma_and_missing_full_stop_are_distinguished_by_the_next_token(text, sign):
    [(_, message, _)] = told(text)
    assert message.startswith(f"a `{sign}` is missing") == (sign is not None)


def test_a_missing_comma_does_not_hide_the_rest():
    text = "type p(robot, int).\np(R X), Y > X -o p(R, a) q(R, Z)."
    assert told(text) == [
        (23, "a `,` is missing before `X`", told(text)[0][2]),
        (44, "a `,` is missing before `q`", told(text)[1][2]),
    ]
    assert {("E030", "Y"), ("E020", "a"), ("E030", "Z")} <= set(places(text))


def test_a_missing_bracket_is_shown_with_the_one_it_closes():
    [diagnostic] = compile_source("p(R, [1, 2).").errors
    assert diagnostic.message == "a `]` is missing before `)`"
    assert [(note.span.start, note.message) for note in diagnostic.notes] == [(5, "opened here")]


@pytest.mark.parametrize(
    ("text", "place", "hint"),
    [
        ("p(R), -o q(R).", ",", "drop it"),
        ("p(R)) -o q(R).", ")", "expected `,` or `-o` or `.`"),
        ("p(R; 1) -o q(R).", ";", "`,` stands between arguments"),
        ("p(R) -> q(R).", "->", "a rule is written `body -o head.`"),
        ("p(R) => q(R).", "=>", "a rule is written `body -o head.`"),
        ("p(R) - o q(R).", "- o", "an arrow is written `-o`, without a space"),
        ("p(R, X), X == 1 -o q(R).", "==", "equality is written `=`"),
        ("p(R, X), X = 1 and X < 2 -o q(R).", "and", "write `,` between conditions, or `&&`"),
        ("p(R, X), (X = 1 or X = 2) -o q(R).", "or", "write `||`"),
        ("P(R) -o q(R).", "P", "names of facts and actions begin with a lower-case letter: `p`"),
        ("p(R) -o Q(R).", "Q", "names of facts and actions begin with a lower-case letter: `q`"),
    ],
)
def test_a_foreign_or_surplus_sign_is_one_mistake_and_the_item_is_read(text, place, hint):
    errors = compile_source(text + " type p(robot, int). p(R, X, Y).").errors
    assert [(text[each.span.start : each.span.end], each.hint) for each in errors if each.code == "E001"] == [
        (place, hint)
    ]
    assert "E011" in [each.code for each in errors]


def test_a_broken_item_ends_where_the_next_one_clearly_begins():
    text = "p(R : 3\ntype q(robot).\nq(R, 1).\nr(R ; 4\n\nq(R, 2)."
    assert errors(text) == ["E001", "E011", "E001", "E011"]


def test_a_number_that_goes_on_as_a_name_is_named_whole():
    assert told("p(R, 10x).")[0][1:] == ("`10x` is no number", "times are written `500ms`, `2s` and `1.5min`")
    assert told("p(R, 10sec).")[0][1:] == ("`10sec` is no number", "`10s`")
    assert told("p(R, 2.5x).")[0][1] == "`2.5x` is no number"


NO_PROGRAMS = {
    "python": Path(re.__file__).read_text(encoding="utf-8"),
    "c": '#include <stdio.h>\nint main(void) {\n  printf("hello %d\\n", 1);\n  return 0;\n}\n' * 50,
    "json": '{"a": [1, 2, {"b": null}], "c": "d"}\n' * 100,
    "prose": "Six robots meet in a corridor. Each of them has somewhere to go, and little time. What now? " * 50,
    "noise": "".join(chr(random.Random(1).randrange(1, 0x250)) for _ in range(20_000)),
    "numbers": "1 2 3 4.5 6\n" * 1000,
    "full stops": "." * 10_000,
    "commas": "," * 100_000,
    "quotes": '"' * 10_001,
    "one item": "p " * 200_000,
}


@pytest.mark.parametrize("text", NO_PROGRAMS.values(), ids=NO_PROGRAMS)
def test_a_text_that_is_no_program_yields_few_errors(text):
    found = compile_source(text).errors
    assert 1 <= len(found) <= 45
    assert {each.code for each in found} <= {"E001", "E005", "E006", "E007", "E008"}


def test_an_open_comment_is_reported_where_it_begins():
    assert ("E001", "/*") in places("p(R). /* q(R).")


@pytest.mark.parametrize("deep", ["({})", "-{}", "[{}]", "(not {})", "1 + {}", "f({})"])
def test_deep_nesting_is_an_error_and_never_a_recursion(deep):
    text = "1"
    before, after = deep.split("{}")
    text = before * 5000 + "1" + after * 5000
    assert errors(f"p(R), X = {text} -o q(R, X). r(R, Y).") == ["E004", "E023"]


def test_signs_without_an_end_are_not_told_as_brackets_alone():
    source = f"p(R), X = {'-' * 64_000}1 -o q(R, X)."
    [found] = [each for each in compile_source(source).errors if each.code == "E004"]
    assert found.message == f"brackets or signs are nested more than {NESTING_MAX} deep"


def test_nesting_within_the_bound_compiles():
    depth = NESTING_MAX - 10
    compiled(f"p(R, X), Y = {'(' * depth}X{')' * depth} -o q(R, Y + {' + '.join(['1'] * depth)}).")


@pytest.mark.parametrize(
    "text", ["\0", "§", ".", "..", "-o", "p", "(", '"', "p(R)) .", "p(R) -o .", "{", "`", "@", "p(R"]
)
def test_garbage_is_a_diagnostic(text):
    assert errors(text)[0] == "E001"


def test_empty_program_is_legal_and_gets_a_warning():
    assert codes("") == ["W107"]
    assert codes("// nothing\n") == ["W107"]
    assert compiled("").rules == ()
