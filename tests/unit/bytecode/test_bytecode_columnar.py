"""Why a program does not suit columns: every reason, in words and with its place."""

import pytest

from rmr.analysis import column_obstacles
from rmr.analysis.column_obstacles import obstacles
from rmr.analysis.straight_line import Unsuitable, straight
from rmr.base.values import Symbol
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Code, InitialFact, Instruction, Program, Type
from rmr.lang.compiler import compile_source

REASONS = {
    "type action go(robot). a(R). a(R) -o go(R).": (
        "the rule derives the action `go`: columns hold facts, nobody carries actions out"
    ),
    "a(R). a(R) -o ?b(R).": "the rule derives the goal `b`: columns hold goals that the program states",
    "a(R, @2). a(R, B) -o b(B).": "the rule sends `b` to another robot",
    "a(R). a(R) -o {B | e(R, B) | f(R, B)}.": "a comprehension is for many facts of a predicate, columns hold one",
    "type e(robot, int). a(R). a(R) -o [sum X => V | e(R, X) | f(R, V)].": (
        "an aggregate is for many facts of a predicate, columns hold one"
    ),
    "type sensor seen(robot). a(R). a(R), seen(R) -o 1.": "`seen` is sensed: its facts come and go from outside",
    "a(R). a(R), peer(R, B) -o 1.": "`peer` is sensed: its facts come and go from outside",
    "?at(R, hall). a(R). a(R) -o 1.": "the goal `at` waits for what robots sense",
    'a(R, "x"). a(R, X) -o 1.': "argument 2 of `a` is a string",
    "a(R, [1]). a(R, X) -o 1.": "argument 2 of `a` is a list",
    "a(R, X) -o a(R, X).": "argument 2 of `a` has no fixed type",
    "a(R, 1). a(R, N), len([1, N]) > 1 -o 1.": "an expression has a list, which columns do not hold",
    "type b(robot, float). a(R). a(R) -o b(R, now()).": "an expression has `now`, which columns do not hold",
    "a(R). a(R) -o a(R). crossing: watch(a(R), b(R), 5, broadcast(R)).": (
        "the time assertion crossing: columns keep no deadlines"
    ),
    "?b(R, 3). type b(robot, int). a(R, 1). a(R, X) -o b(R, X).": (
        "how near a firing brings the goal `b` depends on the match, or on the robot"
    ),
    "a(R). a(R). a(R) -o 1.": "a robot may hold several facts `a`: it is given more than one",
    "a(R). b(R). $b(R), a(R) -o a(R), c(R).": (
        "a robot may hold several facts `c`: the rule derives `c` and consumes no fact in its place; "
        "let it consume one, or say `not c(...)`"
    ),
}


def texts(text: str) -> list[str]:
    """What stands in the way of a program."""
    program = compile_source(text, "p.rmr").program
    assert program is not None
    return [each.text for each in obstacles(program)]


@pytest.mark.parametrize("text", REASONS)
def test_program_unsuited_to_columns_is_reported_with_the_reason(text: str) -> None:
    assert REASONS[text] in texts(text)


def test_a_program_that_suits_has_no_obstacle() -> None:
    assert texts("type a(robot, int). a(R, 1). $a(R, X), X > 3 -o !big(R). a(R, X), X < 9 -o a(R, X + id(R)).") == []


def test_an_obstacle_stands_where_its_rule_or_predicate_stands() -> None:
    program = compile_source('a(R).\ns(R, "x").\n\na(R),\n s(R, X) -o b(@2).\n', "p.rmr").program
    assert program is not None
    places = {each.text.partition(" ")[0]: each.place for each in obstacles(program)}
    assert {word: place and (place.file, place.line) for word, place in places.items()} == {
        "argument": ("p.rmr", 2),
        "the": ("p.rmr", 4),
    }


def test_without_the_debug_section_obstacles_have_no_place() -> None:
    program = Program(*[getattr(compiled(REASON), each) for each in ("predicates", "facts", "goals", "rules")])
    assert [each.place for each in obstacles(program)] == [None]


REASON = "a(R, @2). a(R, B) -o b(B)."


def compiled(text: str) -> Program:
    """A program without errors."""
    program = compile_source(text, "p.rmr").program
    assert program is not None
    return program


def test_a_fact_that_is_given_beside_the_stated_ones_counts() -> None:
    program = compiled("a(R). a(R) -o 1. peer(R, B), a(R) -o a(R).")
    peer = program.index("peer")
    assert peer is not None
    assert "a robot may hold several facts `a`: it is given more than one" in [
        each.text for each in obstacles(program, [InitialFact(0, 3, ())])
    ]
    given = obstacles(program, [InitialFact(peer, 3, (Symbol("x"),))])
    assert "a fact `peer` is given, which robots state themselves" in [each.text for each in given]


def test_too_many_goals_and_places_that_may_fail_are_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(column_obstacles, "GOALS_MAX", 1)
    monkeypatch.setattr(column_obstacles, "FALLIBLE_MAX", 1)
    assert texts("?b(R). ?c(R). type a(robot, int). a(R, 1). a(R, X), X + 1 < 9 -o a(R, X * 2).")[:2] == [
        "expressions may fail at 2 places, at most 1 are possible",
        "2 goals are stated, at most 1 are possible",
    ]


# ---- what only byte-code says


def code(*parts: object) -> Code:
    """Instructions: operators, and operators with operands."""
    return tuple(Instruction(*each) if isinstance(each, tuple) else Instruction(each) for each in parts)  # type: ignore[arg-type]


LOAD_INT, LOAD_OPEN = (Op.LOAD, 1), (Op.LOAD, 9)
UNSUITABLE = {
    "a jump into another branch": code(
        (Op.CONST, True), (Op.JUMP_IF_FALSE, 1), (Op.JUMP, 1), (Op.JUMP, 0), (Op.INT, 1)
    ),
    "a branch without another": code((Op.INT, 1), (Op.CONST, True), (Op.JUMP_IF_FALSE, 0)),
    "a way that changes what is beneath": code(
        LOAD_INT, (Op.CONST, True), (Op.AND, 3), (Op.INT, 1), Op.ADD, (Op.CONST, False), Op.EQ
    ),
    "three branches": code(
        (Op.CONST, True), (Op.JUMP_IF_FALSE, 2), (Op.INT, 1), (Op.JUMP, 2), (Op.INT, 2), (Op.JUMP, 0), Op.NEG
    ),
    "a text": code((Op.CONST, "x")),
    "a constant list": code((Op.CONST, (1, 2))),
    "a jump on its own": code((Op.JUMP, 0), (Op.INT, 1)),
    "a number as a condition": code(LOAD_INT, (Op.AND, 1), (Op.CONST, True)),
    "branches of two types": code((Op.CONST, True), (Op.JUMP_IF_FALSE, 2), (Op.INT, 1), (Op.JUMP, 1), (Op.CONST, 0.5)),
    "a slot of no type": code(LOAD_OPEN, Op.NEG),
    "symbols in an order": code((Op.CONST, Symbol("a")), (Op.CONST, Symbol("b")), Op.LT),
    "an operator of symbols": code((Op.CONST, Symbol("a")), Op.NEG),
}


@pytest.mark.parametrize("case", UNSUITABLE)
def test_expression_that_columns_do_not_support_is_an_obstacle(case: str) -> None:
    with pytest.raises(Unsuitable):
        straight(UNSUITABLE[case], {1: Base.INT})


HANDMADE = {
    "a condition is neither true nor false": "guard",
    "argument 2 of `a`, an int, is compared with a symbol: they are never the same": "join",
    "argument 2 of `a` is a float, not an int": "head",
}


def handmade(what: str) -> Program:
    """A program that the compiler would not make."""
    from vm_hand import INT, Hand, V, code, guard

    hand = Hand()
    a, s = hand.temporary("a", INT), hand.temporary("s", Type(Base.SYMBOL, "mark"))
    body = {"guard": [guard(V(1))], "join": [hand.atom(s, V(2)), hand.absent(a, V(2))], "head": []}[what]
    head = code(0.5, V(1), Op.ADD) if what == "head" else V(1)
    hand.rule([hand.atom(a, V(1)), *body], [hand.head(a, head)])
    return hand.program()


@pytest.mark.parametrize("text", HANDMADE)
def test_obstacles_of_hand_made_byte_code_are_reported(text: str) -> None:
    assert text in [each.text for each in obstacles(handmade(HANDMADE[text]))]
