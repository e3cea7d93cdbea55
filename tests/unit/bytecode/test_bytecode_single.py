"""What shows that a robot holds at most one fact of a predicate, and what does not."""

import pytest

from rmr.analysis import at_most_one
from rmr.analysis.at_most_one import several
from rmr.lang.compiler import compile_source

SINGLE = {
    "a token that is passed on": "a(R). a(R) -o b(R). b(R) -o a(R).",
    "a token that splits in two that never meet": "a(R). a(R) -o b(R), x(R, 1). b(R), x(R, N) -o a(R).",
    "a token that is lost": "a(R). a(R) -o 1.",
    "a fact of one robot each": "a(@1, 1). a(@2, 2). a(R, X) -o a(R, X + 1).",
    "a set of one fact": "type !p(robot, int). !p(R, 1). t(R). $t(R) -o !p(R, 1).",
    "a set of another fact on each robot": "type !p(robot, int). !p(@1, 1). !p(@2, 2).",
    "the robot itself in a set": "type !p(robot, robot). t(R). $t(R) -o !p(R, R).",
    "a set that a token brings": "type !p(robot, int). t(R, 7). t(R, X) -o !p(R, X).",
    "a rule that fires once": "type !p(robot). !p(R). p(R) -o a(R). a(R) -o b(R).",
    "a fact that comes while there is none": "t(R). $t(R), not a(R) -o a(R). $t(R), a(R) -o 1.",
    "one of two that comes while there is none": "t(R). $t(R), not a(R), not b(R) -o a(R). a(R) -o b(R). b(R) -o 1.",
}

SEVERAL = {
    "stated twice": ("a(R). a(R). a(R) -o 1.", {"a": None}),
    "stated for all and for one": ("a(R). a(@2). a(R) -o 1.", {"a": None}),
    "derived for nothing": ("t(R). a(R). $t(R), a(R) -o a(R), b(R).", {"b": 0}),
    "doubled": ("a(R). a(R) -o a(R), a(R).", {"a": 0}),
    "two tokens in one place": ("a(R). b(R). a(R) -o c(R). b(R) -o c(R).", {"c": 0}),
    "a set of two facts": ("type !p(robot, int). t(R). !p(R, 1). $t(R) -o !p(R, 2).", {"p": 0}),
    "a set of what is matched": ("type !p(robot, int). t(R, 1). t(R, X) -o t(R, X + 1), !p(R, X).", {"p": 0}),
    "a rule that fires once, and a fact": ("type !p(robot). !p(R). a(R). p(R) -o a(R). a(R) -o b(R).", {"a": 0}),
    "a rule that fires once, and one while there is none": (
        "type !p(robot). !p(R). t(R). p(R) -o a(R). $t(R), not a(R) -o a(R).",
        {"a": 1},
    ),
    "while there is none of some kind": ("t(R). $t(R), not a(R, 1) -o a(R, 2). $t(R), a(R, _) -o 1.", {"a": 0}),
    "while there is none of another": ("t(R). $t(R), not a(R) -o a(R). a(R) -o b(R).", {"b": 1}),
}


def names(text):
    """By predicate of which there may be several, the rule that is to blame."""
    program = compile_source(text, "p.rmr").program
    assert program is not None
    return {program.predicates[each.predicate].name: each.rule for each in several(program, program.facts)}


@pytest.mark.parametrize("case", SINGLE)
def test_there_is_one_fact_at_most(case):
    assert names(SINGLE[case]) == {}


@pytest.mark.parametrize("case", SEVERAL)
def test_there_may_be_several(case):
    text, found = SEVERAL[case]
    assert names(text).items() >= found.items()


def test_a_program_of_very_many_predicates_is_looked_at_in_a_bounded_number_of_steps(monkeypatch):
    chain = " ".join(f"p{i}(R), q{i}(R), r{i}(R) -o p{i + 1}(R), q{i + 1}(R), r{i + 1}(R)." for i in range(40))
    text = f"p0(R). q0(R). r0(R). {chain} p40(R), q40(R), r40(R) -o p0(R), p0(R), q0(R)."
    assert "p0" in names(text)
    monkeypatch.setattr(at_most_one, "STEPS_MAX", 0)
    assert len(names(text)) == 122
