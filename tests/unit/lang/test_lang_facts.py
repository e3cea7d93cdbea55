import pytest
from lang_source import CORRIDOR, compiled

from rmr.base.values import Symbol
from rmr.bytecode.program import ANY, Constant, Slot
from rmr.lang.facts import FactError, parse_fact, parse_pattern

PROGRAM = compiled(CORRIDOR)


def test_a_fact_is_resolved_and_converted_to_the_programs_types():
    fact = parse_fact("due(@1, 25)", PROGRAM)
    assert (PROGRAM.predicates[fact.predicate].name, fact.owner) == ("due", 1)
    assert repr(fact.args) == "(25.0,)"


def test_a_variable_owner_is_every_robot_and_a_full_stop_is_allowed():
    assert parse_fact("!due(R, 500ms).", PROGRAM).owner is None
    assert parse_fact(" start(R) ", PROGRAM).args == ()


def test_a_pattern_may_have_variables():
    assert parse_pattern("at(R, exit)", PROGRAM).args == (Constant(Symbol("exit")),)
    assert parse_pattern("at(@2, _)", PROGRAM).args == (ANY,)
    assert parse_pattern("due(R, X)", PROGRAM).args == (ANY,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("duee(@1, 2)", "did you mean `due`"),
        ("due(@1, exit)", "is float, not symbol"),
        ("due(@1)", "2 arguments, not 1"),
        ("due(1, 2)", "is a robot"),
        ("at(R, X)", "constant arguments"),
        ("lineup(@1, entry, 2)", "is an action"),
        ("!start(R)", "not a persistent one"),
        ("due(@1, 2). due(@2, 3)", "not a fact"),
        ("due(@1, 2", "is missing before"),
        ("p(R) -o q(R)", "not a fact"),
        ("due(@70000, 2)", "robot ids"),
        ("due(@1, 1e999)", "does not fit"),
        ("due(@1, now())", "constants"),
        ("", "unexpected"),
        ('"', "no end"),
    ],
)
def test_what_is_no_fact_of_the_program_is_refused_with_the_reason(text, message):
    with pytest.raises(FactError, match=message):
        parse_fact(text, PROGRAM)


def test_the_owners_variable_stands_for_the_robot_itself():
    program = compiled("type link(robot, robot, int). link(R, B, N) -o 1.")
    assert parse_fact("link(R, R, 1)", program).args == (Slot(0), 1)
    for text, message in (
        ("link(R, 1, R)", "is robot, not int"),
        ("link(_, _, 1)", "constant"),
        ("link(@1, R, 1)", "constant"),
    ):
        with pytest.raises(FactError, match=message):
            parse_fact(text, program)


def test_a_mistake_has_the_place_and_the_code_of_the_diagnostic_that_it_would_be():
    with pytest.raises(FactError) as caught:
        parse_fact("due(@1, exit)", PROGRAM)
    assert (caught.value.code, caught.value.span.start, caught.value.span.end) == ("E020", 8, 12)


def test_the_same_variable_twice_in_a_pattern_is_refused():
    with pytest.raises(FactError, match="twice"):
        parse_pattern("due(R, R)", PROGRAM)
