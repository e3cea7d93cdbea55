"""Facts that stand for a rule over several robots are shown with their meaning and the place of the rule."""

from dataclasses import replace

import pytest
from ensemble_campaign import PROGRAM, QUARTET, TRIO

from rmr.bytecode.hidden_words import MEANINGS, hidden_label, hidden_words
from rmr.lang.compiler import compile_source

TOLD = "type !edge(robot, robot).\n!edge(A, C), !path(C, B) -o !path(A, B).\n"


def compiled(text):
    program = compile_source(text, "crew.rmr").program
    assert program is not None
    return program


def index(program, name):
    found = program.index(name)
    assert found is not None
    return found


@pytest.mark.parametrize("text", [PROGRAM, TRIO, QUARTET, TOLD])
def test_every_predicate_that_the_compiler_makes_has_a_meaning(text):
    program = compiled(text)
    for hidden in program.ensemble:
        predicate = program.predicates[hidden.predicate]
        texts = [f"<{number}>" for number in range(len(predicate.types) + 1)]
        words = hidden_words(program, hidden.predicate, texts)
        assert words is not None
        assert "__" not in words + hidden_label(program, hidden.predicate)
        assert any(each in words for each in texts)


def test_every_meaning_is_one_of_a_predicate_that_the_compiler_makes():
    made = {
        program.predicates[hidden.predicate].name.rpartition("__")[0]
        for program in map(compiled, (PROGRAM, TRIO, QUARTET, TOLD))
        for hidden in program.ensemble
    }
    assert set(MEANINGS) == made - {"aside", "returned"}


def test_an_offer_names_robots_values_and_the_rule():
    program = compiled(PROGRAM)
    offer = index(program, "offer__1")
    assert hidden_words(program, offer, ["@3", "@1", "0", "5", "0", "west"]) == (
        "offered to @3 by @1 (west), rule crew.rmr:7"
    )
    assert hidden_label(program, offer) == "offer of rule crew.rmr:7"
    assert hidden_words(program, index(program, "waiting"), ["@3", "1"]) is None
    assert hidden_label(program, index(program, "waiting")) == "waiting"


def test_a_fact_that_is_set_aside_is_shown_as_itself():
    program = compiled(PROGRAM)
    assert hidden_words(program, index(program, "aside__1"), ["@3", "8", "4"]) == "waiting(@3, 4) is set aside"
    assert hidden_words(program, index(program, "returned__1"), ["@3", "4"]) == "waiting(@3, 4) returns"


def test_byte_code_without_places_or_of_another_compiler_is_shown_too():
    program = replace(compiled(PROGRAM), debug=None)
    offer = index(program, "offer__1")
    assert hidden_words(program, offer, ["@3", "@1", "0", "5", "0"]) == (
        "offered to @3 by @1, a rule over several robots"
    )
    named = list(program.predicates)
    named[offer] = replace(named[offer], name="note_3__1")
    other = replace(program, predicates=tuple(named))
    assert hidden_words(other, offer, ["@3", "@1"]) == "note_3__1 (@1), a rule over several robots"
