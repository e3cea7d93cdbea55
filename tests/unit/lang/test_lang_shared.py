"""`type shared p(...)`: facts of another robot that a rule reads as what its own robot has heard of them."""

import pytest

from rmr.bytecode.codec import decode, encode
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.hidden_words import hidden_label, hidden_words
from rmr.bytecode.program import Atom, Duty, HiddenPredicate, Kind, Mode, Program
from rmr.lang.compiler import compile_source

TYPES = """
type shared dist(robot, float).
type !source(robot).
type best(robot, float).
start(R).
dist(R, 1.0).
"""


def compiled(text: str) -> Program:
    compilation = compile_source(TYPES + text)
    assert compilation.diagnostics == [], [each.message for each in compilation.diagnostics]
    assert compilation.program is not None
    return compilation.program


def found(text: str) -> list[tuple[str, str]]:
    """Return the codes of what is found, each with the text at its place."""
    compilation = compile_source(text)
    return [(each.code, compilation.source.text[each.span.start : each.span.end]) for each in compilation.diagnostics]


def heard(program: Program) -> HiddenPredicate:
    (hidden,) = program.ensemble
    assert hidden.duty is Duty.HEARD
    return hidden


READERS = {
    "body": "$start(R), neighbor(R, N), dist(N, D) -o best(R, D).",
    "kept": "$start(R), neighbor(R, N), $dist(N, D) -o best(R, D).",
    "absent": "$start(R), neighbor(R, N), not dist(N, 2.0) -o best(R, 0.0).",
    "none": "$start(R), not (neighbor(R, N), dist(N, D), D < 3.0) -o best(R, 0.0).",
    "fold": "$start(R), D = min(X, neighbor(R, N), dist(N, X)) -o best(R, D).",
    "aggregate": "start(R) -o [min X => D | neighbor(R, N), dist(N, X) | best(R, D)].",
    "comprehension": "start(R) -o {N, D | neighbor(R, N), dist(N, D) | best(R, D)}.",
    "choice": "start(R) -o if id(R) > 2 then {N, D | neighbor(R, N), dist(N, D) | best(R, D)} end.",
    "outer link": "start(R), neighbor(R, N) -o [max X => D | dist(N, X) | best(R, D)].",
    "constant": "$start(R), dist(@2, D) -o best(R, D).",
    "computed": "$start(R), id(R, I), N = robot(I + 1), dist(N, D) -o best(R, D).",
    "own and other": "dist(R, D), neighbor(R, N), dist(N, E), E + 1.0 < D -o dist(R, E + 1.0).",
}


@pytest.mark.parametrize("rule", READERS.values(), ids=READERS)
def test_what_a_neighbour_has_told_is_a_sensed_fact_of_the_reader(rule):
    program = compiled(rule)
    hidden = heard(program)
    predicate = program.predicates[hidden.predicate]
    told = program.predicates[hidden.other]
    assert (told.name, told.kind, predicate.kind) == ("dist", Kind.TEMPORARY, Kind.SENSED)
    assert [each.base.name for each in predicate.types] == ["ROBOT", "FLOAT"]
    assert len(program.rules) == 1, "nobody is asked: the rule is one of one robot"
    octets = encode(program, debug=True)
    assert decode(octets) == program
    assert "heard__1: heard of dist" in disassemble(octets)


def test_of_the_own_facts_one_is_used_up_and_of_the_others_none():
    program = compiled(READERS["own and other"])
    atoms = [each for each in program.rules[0].body if isinstance(each, Atom)]
    assert [(program.predicates[each.predicate].name, each.mode) for each in atoms] == [
        ("dist", Mode.CONSUME),
        ("neighbor", Mode.READ),
        ("heard__1", Mode.READ),
    ]


def test_a_program_that_reads_no_shared_fact_from_afar_has_the_same_byte_code():
    rule = "dist(R, D), D > 1.0 -o dist(R, D / 2)."
    plain = compile_source(TYPES.replace("shared ", "") + rule, "p.rmr").program
    shared = compile_source(TYPES + rule, "p.rmr").program
    assert encode(shared, debug=False) == encode(plain, debug=False)
    assert shared.ensemble == ()


def test_a_rule_over_several_robots_reads_them_where_its_home_is():
    program = compiled(
        """
        type !peers(robot, robot).
        type free(robot).
        peers(@1, @2).
        free(R).
        start(A), peers(A, B), free(B), dist(B, D), D < 2.0 -o best(A, D).
        """
    )
    (told,) = [each for each in program.ensemble if each.duty is Duty.HEARD]
    assert program.predicates[told.other].name == "dist"
    asides = [program.predicates[each.other].name for each in program.ensemble if each.duty is Duty.ASIDE]
    assert "dist" not in asides
    assert "start" in asides


@pytest.mark.parametrize(
    "rule",
    [
        "start(R), dist(N, D) -o best(R, D).",
        "start(R), dist(_, D) -o best(R, D).",
        "start(R), D = sum(X, dist(N, X)) -o best(R, D).",
        "start(R) -o [min X => D | dist(N, X) | best(R, D)].",
        "start(R) -o {N, D | dist(N, D) | best(R, D)}.",
        "dist(A, D), dist(B, E), D < E -o best(A, E).",
        "start(R), not dist(N, 1.0) -o best(R, 1.0).",
    ],
)
def test_a_robot_that_no_link_leads_to_is_reported(rule):
    assert [code for code, _ in found(TYPES + rule)] == ["E035"]


@pytest.mark.parametrize("kind", ["!", "sensor ", "action "])
def test_only_temporary_facts_are_shared(kind):
    assert ("E012", "shared") in found(f"type shared {kind}p(robot).\np(@1).\n")


def test_a_type_that_fits_no_frame_is_refused():
    types = ", ".join(["float"] * 12)
    values = ", ".join(["_"] * 12)
    text = f"type shared p(robot, {types}).\ntype seen(robot, robot).\nneighbor(R, N), p(N, {values}) -o seen(R, N).\n"
    assert ("E038", "p") in found(text)
    assert "E038" not in [code for code, _ in found(text.replace("float, ", "", 1).replace("_, ", "", 1))]


def test_a_wrong_number_of_arguments_is_reported_once():
    assert [code for code, _ in found(TYPES + "start(R), neighbor(R, N), dist(N) -o best(R, 1.0).")] == ["E011"]


def test_shared_is_also_a_name():
    program = compile_source("type shared(robot).\ntype unordered shared2(robot).\nshared(R) -o shared2(R).").program
    assert [each.name for each in program.predicates] == ["shared", "shared2"]
    assert compile_source("type shared unordered(robot).\nunordered(R).").program is not None
    assert compile_source("type unordered shared(robot).\nshared(R).").program.predicates[0].unordered


def test_a_rule_that_reads_neighbours_is_no_certain_loop():
    assert found(TYPES + "neighbor(R, N), dist(N, D), dist(R, _) -o dist(R, D).") == []
    assert found(TYPES + "dist(R, _), neighbor(R, N), dist(N, D) -o dist(R, D).") == []


@pytest.mark.parametrize(
    ("rule", "code"),
    [
        ("start(R), neighbor(R, N), not q(N, 1) -o 1.", "E033"),
        ("start(R) -o [sum X => S | neighbor(R, N), q(N, X) | total(R, S)].", "E033"),
        ("$start(R), neighbor(R, N), $q(N, X) -o total(R, X).", "E041"),
    ],
)
def test_what_cannot_be_read_from_afar_has_a_hint_that_leads_to_shared(rule, code):
    text = f"type q(robot, int).\ntype total(robot, int).\nstart(R).\nq(R, 1).\n{rule}\n"
    (only,) = [each for each in compile_source(text).diagnostics if each.severity.name == "ERROR"]
    assert only.code == code
    assert "type shared q(...)" in only.hint
    mended = text.replace("type q(", "type shared q(")
    assert [each.code for each in compile_source(mended).errors] == []


def test_what_is_heard_is_told_in_words():
    program = compiled(READERS["body"])
    hidden = heard(program)
    assert hidden_words(program, hidden.predicate, ["@1", "@2", "2.5"]) == "dist(@2, 2.5), as @1 has heard"
    assert hidden_label(program, hidden.predicate) == "dist"
