import pytest
from lang_source import CORRIDOR, compiled

from rmr.base.values import Symbol
from rmr.bytecode.program import Slot
from rmr.lang.fact_text import FactError, read_fact, stated

PROGRAM = compiled(CORRIDOR)


def parse_fact(text, program):
    return stated(read_fact(text), program)


def test_a_fact_is_resolved_and_converted_to_the_programs_types():
    fact = parse_fact("due(@1, 25)", PROGRAM)
    assert (PROGRAM.predicates[fact.predicate].name, fact.owner) == ("due", 1)
    assert repr(fact.args) == "(25.0,)"


def test_a_variable_owner_is_every_robot_and_a_full_stop_is_allowed():
    assert parse_fact("!due(R, 500ms).", PROGRAM).owner is None
    assert parse_fact(" start(R) ", PROGRAM).args == ()


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
        ("due(@1, X + 1)", "constants"),
        ("due(@1, 1 / 0)", "division by zero"),
        ("due(@1, 9223372036854775807 + 1)", "64 bits"),
        ("due(@1, 1 + a)", "contradict"),
        ("due(@1, [2])", "is float, not list int"),
        ("", "unexpected"),
        ('"', "no end"),
    ],
)
def test_fact_unknown_to_the_program_is_refused_with_the_reason(text, message):
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


def test_lists_symbols_and_sensed_facts_of_any_kind_may_be_stated():
    text = """
    type route(robot, list area).
    type marks(robot, list list float).
    route(R, L), marks(R, M), battery(R, V), at(R, nowhere), turn(R, jam, K) -o 1.
    """
    program = compiled(text)
    assert parse_fact("route(@1, [entry, never_heard_of])", program).args == (
        (Symbol("entry"), Symbol("never_heard_of")),
    )
    assert repr(parse_fact("marks(@1, [[1, 2.5], []])", program).args) == "(((1.0, 2.5), ()),)"
    assert parse_fact("battery(@2, 1 / 4)", program).args == (0.25,)
    assert parse_fact("at(@2, elsewhere)", program).args == (Symbol("elsewhere"),)
    assert parse_fact("turn(@2, no_such_event, 3)", program).args == (Symbol("no_such_event"), 3)


def test_mismatched_fact_is_reported_with_the_declaration_of_the_program():
    hints = []
    for text in ("due(@1)", "due(@1, exit)", "at(@1, 3)", "start(@1, 2)"):
        with pytest.raises(FactError) as caught:
            parse_fact(text, PROGRAM)
        hints.append(caught.value.hint)
    due = "it is `type !due(robot, float).`"
    assert hints == [due, due, "it is `type sensor at(robot, area).`", "it is `type start(robot).`"]


def test_a_provided_fact_that_no_rule_uses_is_named_as_such():
    with pytest.raises(FactError, match="no rule uses it"):
        parse_fact("battery(@1, 0.5)", PROGRAM)
