"""Section III of the paper: every program that it prints compiles as printed. One test per claim."""

import pytest

from rmr.bytecode.codec import encode
from rmr.bytecode.program import Comprehension, DeriveAction, Kind
from rmr.bytecode.verify import verify
from rmr.lang.compiler import compile_source

FIGURE_3 = """// initial fact that R is in s
location(R, s).
// goal fact that go to middle if possible
?location(R, middle).
// rule 1: if R is in s, then go to middle
location(R, L), L = s
    -o location(R, middle).
// rule 2: if R is in s, then go to t
location(R, L), L = s
    -o location(R, t).
// rule 3: if R is in middle, then go to t
location(R, L), L = middle
    -o location(R, t).
"""

FIGURE_4 = """type action moveto(robot, area).
location(R, s).
?location(R, middle).
// use action moveto instead
location(R, L), L = S -o moveto(R, middle).
location(R, L), L = s -o moveto(R, t).
location(R, L), L = middle -o moveto (R, t).
"""

COMPREHENSION = """online(A,L) -o {B | edge(A,B) |
    ready(B,A)}.
"""

ASSERTION = """assert(offline(A,L), online(A,L), 10,
    broadcast (A)).
"""


def compiled(text):
    compilation = compile_source(text)
    assert compilation.program is not None, compilation.diagnostics
    return compilation.program


@pytest.mark.parametrize("text", [FIGURE_3, FIGURE_4, COMPREHENSION, ASSERTION, COMPREHENSION + ASSERTION])
def test_section_iii_every_printed_program_compiles_into_valid_byte_code_of_at_most_256_octets(text):
    program = compiled(text)
    assert verify(program) == []
    assert len(encode(program, debug=False)) <= 256


def test_figure_3_compiles_without_a_doubt():
    assert compile_source(FIGURE_3).diagnostics == []


def test_figure_4_compiles_with_one_warning_about_the_variable_that_looks_like_its_constant():
    compilation = compile_source(FIGURE_4)
    [warning] = compilation.diagnostics
    assert (warning.code, FIGURE_4[warning.span.start : warning.span.end]) == ("W101", "S")
    assert "`s`" in (warning.hint or "")


def test_section_iii_a_variables_begin_upper_case_and_constants_lower_case():
    program = compiled("p(R, x). p(R, X), X = y -o q(R, X).")
    assert str(program.facts[0].args[0]) == "x"


def test_section_iii_b_the_first_argument_of_a_fact_is_a_robot():
    assert [each.code for each in compile_source("location(s, middle).").errors] == ["E021"]


def test_section_iii_b_a_bang_declares_a_persistent_fact_and_none_a_temporary_one():
    program = compiled("type !edge(robot, robot). type location(robot, area).")
    assert [each.kind for each in program.predicates] == [Kind.PERSISTENT, Kind.TEMPORARY]


def test_section_iii_b_a_question_mark_declares_a_goal():
    program = compiled(FIGURE_3)
    assert [str(goal.args[0].value) for goal in program.goals] == ["middle"]


def test_section_iii_c_actions_must_be_declared():
    undeclared = FIGURE_4.replace("type action moveto(robot, area).\n", "")
    assert "W108" in [each.code for each in compile_source(undeclared).diagnostics]
    assert all(isinstance(rule.head[0], DeriveAction) for rule in compiled(FIGURE_4).rules)


def test_section_iii_c_moveto_inserts_the_location_on_arrival_as_figure_5_does():
    program = compiled(FIGURE_4)
    [effect] = program.predicates[program.index("moveto")].effects
    assert program.predicates[effect.predicate].name == "location"


def test_section_iii_d_a_comprehension_applies_its_head_to_every_match():
    [rule] = compiled(COMPREHENSION).rules
    assert isinstance(rule.head[0], Comprehension)


def test_section_iii_e_a_time_assertion_has_start_finish_deadline_and_violation():
    [assertion] = compiled(ASSERTION).assertions
    program = compiled(ASSERTION)
    names = [program.predicates[each.predicate].name for each in (assertion.start, assertion.finish)]
    assert names == ["offline", "online"]
    assert assertion.deadline[0].operand == 10
    assert program.predicates[assertion.violation.predicate].name == "broadcast"


def test_section_iv_a_the_same_program_compiles_into_the_same_octets():
    assert encode(compiled(FIGURE_4), debug=True) == encode(compiled(FIGURE_4), debug=True)
