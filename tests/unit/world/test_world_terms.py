"""Facts as a lab file writes them."""

import pytest

from rmr.base.values import Robot, Symbol
from rmr.bytecode.program import ANY, Constant
from rmr_world.fact_syntax import TermError, parse_fact, parse_finish
from rmr_world.random_facts import Range


@pytest.mark.parametrize(
    ("text", "owner", "args"),
    [
        ("due(@1, 25)", 1, (25,)),
        ("due(R, 2.5)", None, (2.5,)),
        ("!edge(@1, @2).", 1, (Robot(2),)),
        ("at(@65533, exit)", 65533, (Symbol("exit"),)),
        ('says(@1, "a \\"b\\"\\n, c")', 1, ('a "b"\n, c',)),
        ("flags(@1, true, false)", 1, (True, False)),
        ("wait(@1, 500ms, 2s, 1.5min)", 1, (0.5, 2.0, 90.0)),
        ("deep(@1, [1, [-2, x], []])", 1, ((1, (-2, Symbol("x")), ()),)),
        ("big(@1, 9223372036854775807, 1e-3)", 1, (9223372036854775807, 0.001)),
        ("alone(@4)", 4, ()),
        ("due(@1, 20..60)", 1, (Range(20, 60),)),
        ("due(@1, -2.5..3)", 1, (Range(-2.5, 3),)),
        ("due(@1, 500ms..2s)", 1, (Range(0.5, 2.0),)),
        ("  spaced ( @1 ,2 ) ", 1, (2,)),
    ],
)
def test_a_fact_is_its_name_owner_and_values(text, owner, args):
    fact = parse_fact(text)
    assert (fact.owner, fact.args) == (owner, args)
    assert [type(a) for a in fact.args] == [type(a) for a in args]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "expected a fact such as due(@1, 25), found the end"),
        ("Due(@1)", "expected a fact such as due(@1, 25), found 'Due(@1)'"),
        ("due", "expected '(', found the end"),
        ("due(@1, 25", "expected ',' or ')', found the end"),
        ("due(@1,, 2)", "expected a value, found ', 2)'"),
        ("due(@1, 25) x", "expected the end, found 'x'"),
        ("due()", "the first argument is the owner, a robot: due(@1, ...)"),
        ("due(3)", "the first argument is the owner, a robot: due(@1, ...)"),
        ("due(@1, X)", "only the owner may be a variable here"),
        ("due(@1, [X])", "a list cannot hold a variable here"),
        ("due(@65534)", "@65534 is no robot: ids are 0 to 65533"),
        ("due(@1, 9223372036854775808)", "9223372036854775808 does not fit 64 bits"),
        ("due(@1, 1e999)", "1e999 is too large"),
        ("due(@1, 25x)", "expected a value, found '25x)'"),
        ("due(@1, 1 + 2)", "expected ',' or ')', found '+ 2)'"),
        ("due(@1, 60..20)", "the range 60..20 is the wrong way round: its smaller end comes first"),
        ("due(@1, 0.61..0.68)", "the range 0.61..0.68 holds no number with one decimal"),
        ("due(@1, 0.0..1e308)", "the range 0.0..1e+308 is too large"),
        ("due(@1, 20..)", "expected a value, found '20..)'"),
        ("due(@1, 20..x)", "expected a value, found '20..x)'"),
        ("due(@1, 20...60)", "expected a value, found '20...60)'"),
        ("due(@1, [20..60])", "a list cannot hold a range"),
        ("due(20..60)", "the first argument is the owner, a robot: due(@1, ...)"),
        ("p(@1, " + "[" * 50, "lists are nested too deeply"),
    ],
)
def test_invalid_fact_is_reported_with_what_was_expected(text, complaint):
    with pytest.raises(TermError) as caught:
        parse_fact(text)
    assert str(caught.value) == complaint


def test_variables_of_a_finish_match_anything():
    assert parse_finish("at(R, exit)").patterns == (Constant(Symbol("exit")),)
    assert parse_finish("seen(R, _, X, 3)").patterns == (ANY, ANY, Constant(3))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("at(@1, exit)", "its owner is a variable"),
        ("p(R, R)", "variable R stands twice"),
        ("p(R, 1..2)", "a range cannot stand here"),
    ],
)
def test_a_finish_concerns_every_robot(text, complaint):
    with pytest.raises(TermError, match=complaint):
        parse_finish(text)
