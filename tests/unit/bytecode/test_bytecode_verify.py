"""The verifier finds each kind of unsound program, and accepts the sound ones."""

import ast
import inspect
import re
from collections.abc import Callable
from dataclasses import replace

import pytest
from vm_hand import AREA, FLOAT, INT, OPEN, ROBOT, Hand, V, _, code, guard

from rmr.base.values import Robot, Symbol
from rmr.bytecode import part_checks
from rmr.bytecode import verify as verifier
from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.limits import SLOTS_MAX
from rmr.bytecode.opcodes import FORMS, Op
from rmr.bytecode.program import (
    GOALS_OF,
    Aggregate,
    Assertion,
    Atom,
    Base,
    Best,
    Bind,
    Code,
    Comprehension,
    Constant,
    Debug,
    DeriveAction,
    DeriveFact,
    Duty,
    Effect,
    Fold,
    Guard,
    HeadValue,
    HiddenPredicate,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Lead,
    Mode,
    Operator,
    OwnFunction,
    Place,
    Predicate,
    Program,
    Rule,
    Slot,
    Steps,
    Type,
    When,
)
from rmr.bytecode.verify import RANK_MAX, REASONS_MAX, verify

HERE = code(V(0))


def base() -> tuple[Hand, int, int, int]:
    """A temporary p(area), a persistent q(int), an action go(area); s(area) is sensed, r(robot) temporary."""
    hand = Hand()
    p, q, go = hand.temporary("p", AREA), hand.persistent("q", INT), hand.action("go", AREA)
    hand.sensed("s", AREA)
    hand.temporary("r", ROBOT)
    return hand, p, q, go


S, R = 3, 4


def reasons(change: Callable[[Hand, int, int, int], object]) -> str:
    hand, p, q, go = base()
    assert verify(hand.program()) == []
    changed = change(hand, p, q, go)
    return "; ".join(verify(changed if isinstance(changed, Program) else hand.program()))


def i(op: Op, operand: object = None) -> Instruction:
    return Instruction(op, operand)  # type: ignore[arg-type]


def expression(*instructions: Instruction) -> Callable[[Hand, int, int, int], object]:
    return lambda h, p, q, go: h.rules.append(Rule(2, (Guard(instructions),), ()))


def aggregate(h: Hand, p: int, **changes: object) -> None:
    """A rule with ``[min 1 => $2 | p($0, $1) | p($0, a)]``, changed."""
    sound = Aggregate(Operator.MIN, code(1), 2, (1,), (h.atom(p, V(1)),), (h.head(p, "a"),))
    h.rules.append(Rule(3, (), (replace(sound, **changes),)))  # type: ignore[arg-type]


def asserted(h: Hand, go: int, **changes: object) -> None:
    """``assert(r(R, $1), r(R, $1), 1, go(R, a))``, changed."""
    violation = DeriveAction(go, HERE, (code("a"),))
    sound = Assertion("a", 2, h.keep(R, V(1)), h.keep(R, V(1)), code(1), violation, True)
    h.assertions.append(replace(sound, **changes))  # type: ignore[arg-type]


def predicate(h: Hand, *types: Type, name: str = "t", **more: object) -> None:
    h.predicates.append(Predicate(name, Kind.TEMPORARY, types, **more))  # type: ignore[arg-type]


def nested(depth: int) -> Type:
    return Type(Base.LIST, element=nested(depth - 1)) if depth else INT


def placed(h: Hand, *places: Place) -> Program:
    return replace(h.program(), debug=Debug(predicates=places))


def folded(h: Hand, p: int, **changes: object) -> None:
    """A rule with ``p($0, $1), $3 = max($2, p($0, $2))``, changed."""
    sound = Fold(Operator.MAX, code(V(2)), 3, (2,), (h.keep(p, V(2)),))
    h.rules.append(Rule(5, (h.atom(p, V(1)), replace(sound, **changes)), ()))  # type: ignore[arg-type]


def hidden(h: Hand, *table: HiddenPredicate) -> Program:
    return replace(h.program(), ensemble=table)


def kept_best(h: Hand, kind: Kind, argument: int, *types: Type) -> None:
    h.predicates.append(Predicate("t", kind, types, best=Best(argument, True)))


def function(h: Hand, *instructions: Instruction, name: str = "f", arity: int = 1) -> Program:
    return replace(h.program(), functions=(OwnFunction(name, arity, instructions),))


def before(h: Hand, p: int, fold: Fold) -> None:
    h.rules.append(Rule(4, (fold, h.atom(p, V(1))), ()))


RANDOM = i(Op.CALL, next(index for index, each in enumerate(FUNCTIONS) if each.drawn))


def goals_of(h: Hand, name: str, *types: Type, kind: Kind = Kind.SENSED) -> None:
    h.predicates.append(Predicate(GOALS_OF + name, kind, types))


def goal_of_goals(h: Hand, q: int) -> None:
    goals_of(h, h.predicates[q].name, *h.predicates[q].types)
    h.goals.append(InitialGoal(len(h.predicates) - 1, None, (_,)))


UNSOUND: list[tuple[str, Callable[[Hand, int, int, int], object]]] = [
    (
        "predicate p: the name is not an identifier, or another predicate has it",
        lambda h, p, q, go: predicate(h, name="p"),
    ),
    ("the name is not an identifier, or another predicate has it", lambda h, p, q, go: predicate(h, name="")),
    ("the name is not an identifier, or another predicate has it", lambda h, p, q, go: predicate(h, name="Upper")),
    ("the name is not an identifier, or another predicate has it", lambda h, p, q, go: predicate(h, name="a b")),
    ("no predicate has such goals, or another predicate stands for them", lambda h, p, q, go: goals_of(h, "nothing")),
    (
        "no predicate has such goals, or another predicate stands for them",
        lambda h, p, q, go: goals_of(h, "go", Type(Base.OPEN)),
    ),
    ("the goals of p must be sensed and have its types", lambda h, p, q, go: goals_of(h, "p", INT, INT, INT)),
    ("a fact or goal of a predicate that stands for goals", lambda h, p, q, go: goal_of_goals(h, q)),
    ("is not the name of a set of symbols", lambda h, p, q, go: predicate(h, Type(Base.SYMBOL, "Area"))),
    ("is not the name of a set of symbols", lambda h, p, q, go: predicate(h, Type(Base.INT, "area"))),
    ("an element type on a type other than list", lambda h, p, q, go: predicate(h, Type(Base.INT, element=INT))),
    (f"lists nested deeper than {NESTING_MAX}", lambda h, p, q, go: predicate(h, nested(NESTING_MAX + 1))),
    (
        "unordered, but sensed facts are never sent",
        lambda h, p, q, go: h.predicates.append(Predicate("t", Kind.SENSED, (), unordered=True)),
    ),
    (
        "marked as provided, but there is no such provided predicate",
        lambda h, p, q, go: predicate(h, INT, name="id", provided=True),
    ),
    ("keeps the best of facts that are not persistent", lambda h, p, q, go: kept_best(h, Kind.TEMPORARY, 0, INT)),
    ("keeps the best by argument 1 of 1", lambda h, p, q, go: kept_best(h, Kind.PERSISTENT, 1, INT)),
    (
        "keeps the best by an argument whose type has no order",
        lambda h, p, q, go: kept_best(h, Kind.PERSISTENT, 0, ROBOT),
    ),
    ("function F: the name is not an identifier", lambda h, p, q, go: function(h, i(Op.INT, 1), name="F")),
    ("slot 1 is used before it is bound", lambda h, p, q, go: function(h, i(Op.LOAD, 1))),
    ("there is no function 3 of the program", expression(Instruction(Op.APPLY, 3, OwnFunction("f", 0)))),
    ("random() outside of a head", expression(RANDOM)),
    ("an atom behind a fold", lambda h, p, q, go: before(h, p, Fold(Operator.COUNT, None, 3, (), (h.keep(p, _),)))),
    ("a fold that consumes", lambda h, p, q, go: folded(h, p, body=(h.atom(p, V(2)),))),
    (
        "a fold within a fold",
        lambda h, p, q, go: folded(h, p, body=(h.keep(p, V(2)), Fold(Operator.COUNT, None, 4, (), ())), slots=(2, 4)),
    ),
    ("slot 2 is the result and a variable of the matches", lambda h, p, q, go: folded(h, p, result=2)),
    ("MAX with a wrong number of terms", lambda h, p, q, go: folded(h, p, term=None)),
    ("an inner body binds a variable that is not listed", lambda h, p, q, go: folded(h, p, slots=())),
    ("slot 1 is used before it is bound", lambda h, p, q, go: h.rules.append(Rule(2, (), (When(1, h.head(p, "a")),)))),
    ("slot 0 is bound twice", lambda h, p, q, go: h.rules.append(Rule(2, (), (HeadValue(0, code(1)),)))),
    ("an aggregate that derives nothing", lambda h, p, q, go: aggregate(h, p, head=())),
    ("only an action has effects", lambda h, p, q, go: predicate(h, effects=(Effect(q, (code(1),)),))),
    (
        "an effect on what another robot senses, s",
        lambda h, p, q, go: h.action("act", ROBOT, effects=(Effect(S, (code("a"),), code(V(1))),)),
    ),
    ("slot 2 is used", lambda h, p, q, go: h.action("act", AREA, effects=(Effect(p, (code(V(2)),)),))),
    ("go is an action", lambda h, p, q, go: h.action("act", effects=(Effect(go, (code("a"),)),))),
    ("is not a robot", lambda h, p, q, go: h.action("act", AREA, effects=(Effect(p, (code("a"),), code(V(1))),))),
    ("owner 65534 is not a robot id", lambda h, p, q, go: h.facts.append(InitialFact(q, 65534, (1,)))),
    ("owner -1 is not a robot id", lambda h, p, q, go: h.goals.append(InitialGoal(q, -1, (_,)))),
    (
        "the robot itself as an argument whose type is not robot",
        lambda h, p, q, go: h.facts.append(InitialFact(q, None, (Slot(0),))),
    ),
    (
        "the robot itself as an argument whose type is not robot",
        lambda h, p, q, go: h.goals.append(InitialGoal(p, None, (Slot(0),))),
    ),
    ("uses slot 1 of 1", lambda h, p, q, go: h.facts.append(InitialFact(R, None, (Slot(1),)))),
    ("uses slot 2 of 2", lambda h, p, q, go: h.goals.append(InitialGoal(q, None, (Slot(2),)))),
    ("has the wrong type", lambda h, p, q, go: h.facts.append(InitialFact(q, None, (1.0,)))),
    ("has the wrong type", lambda h, p, q, go: h.facts.append(InitialFact(p, None, (Symbol("No"),)))),
    ("goal 0: go is an action", lambda h, p, q, go: h.goals.append(InitialGoal(go, None, (_,)))),
    (
        "a lead names a rule that does not exist",
        lambda h, p, q, go: h.goals.append(InitialGoal(q, None, (_,), (Lead(0, 0),))),
    ),
    (
        "the leads are not in ascending order of their rules",
        lambda h, p, q, go: (
            h.rule([], []),
            h.goals.append(InitialGoal(q, None, (_,), (Lead(0, 0), Lead(0, 1)))),
        ),
    ),
    (
        f"a rank beyond {RANK_MAX}",
        lambda h, p, q, go: (h.rule([], []), h.goals.append(InitialGoal(q, None, (_,), (Lead(0, RANK_MAX + 1),)))),
    ),
    (f"{SLOTS_MAX + 1} variables, at most", lambda h, p, q, go: h.rules.append(Rule(SLOTS_MAX + 1, (), ()))),
    ("no slot for the robot itself", lambda h, p, q, go: h.rules.append(Rule(0, (), ()))),
    ("no slot for the robot itself", lambda h, p, q, go: asserted(h, go, slots=0)),
    ("there is no predicate 99", lambda h, p, q, go: h.rule([Atom(99, (), Mode.CONSUME)], [])),
    ("go is an action", lambda h, p, q, go: h.rule([Atom(go, (Slot(1),), Mode.READ)], [])),
    ("p is not an action", lambda h, p, q, go: h.rule([], [DeriveAction(p, HERE, (code("a"),))])),
    ("p with 0 arguments instead of 1", lambda h, p, q, go: h.rule([Atom(p, (), Mode.CONSUME)], [])),
    ("argument 1 of q has the wrong type", lambda h, p, q, go: h.rule([h.atom(q, "one")], [])),
    ("argument 1 of q has the wrong type", lambda h, p, q, go: h.rule([], [h.head(q, "one")])),
    ("p uses slot 9 of 3", lambda h, p, q, go: h.rule([h.atom(p, V(9))], [], slots=3)),
    ("CONSUME of q, which is PERSISTENT", lambda h, p, q, go: h.rule([h.atom(q, V(1), mode=Mode.CONSUME)], [])),
    ("READ of p, which is TEMPORARY", lambda h, p, q, go: h.rule([h.atom(p, V(1), mode=Mode.READ)], [])),
    ("KEEP of s, which is SENSED", lambda h, p, q, go: h.rule([h.atom(S, V(1), mode=Mode.KEEP)], [])),
    ("binds slot 9 of 3", lambda h, p, q, go: h.rule([Bind(9, code(1))], [], slots=3)),
    ("binds slot 9 of 8", lambda h, p, q, go: h.rule([], [Comprehension((9,), (), ())])),
    ("slot 1 is bound twice", lambda h, p, q, go: h.rule([h.atom(p, V(1)), Bind(1, code(1))], [])),
    ("slot 1 is bound twice", lambda h, p, q, go: h.rule([h.atom(p, V(1))], [Comprehension((1,), (), ())])),
    ("slot 1 is bound twice", lambda h, p, q, go: h.rule([], [Comprehension((1, 1), (), ())])),
    ("slot 2 is used before", lambda h, p, q, go: h.rule([h.atom(p, V(1))], [h.head(p, V(2))])),
    ("slot 1 is used before", lambda h, p, q, go: h.rule([h.absent(p, V(1))], [h.head(p, V(1))])),
    ("slot 1 is used before", lambda h, p, q, go: h.rule([guard(V(1)), h.atom(p, V(1))], [])),
    (
        "slot 1 is used before",
        lambda h, p, q, go: h.rule([], [h.each([V(1)], [h.atom(p, V(1))], []), h.head(p, V(1))]),
    ),
    ("slot 1 is used before", lambda h, p, q, go: h.rule([], [Steps((h.head(p, V(1)), h.head(p, "a")))])),
    ("now() in a body", lambda h, p, q, go: h.rule([guard("call:now", 1, Op.LT)], [])),
    ("now() in a body", lambda h, p, q, go: aggregate(h, p, body=(h.atom(p, V(1)), guard("call:now", 1, Op.LT)))),
    ("s is sensed, so no rule may derive it", lambda h, p, q, go: h.rule([], [DeriveFact(S, HERE, (code("a"),))])),
    ("an owner or executor that is not a robot", lambda h, p, q, go: h.rule([], [h.head(p, "a", to="b")])),
    ("is not a robot", lambda h, p, q, go: h.rule([h.atom(p, V(1))], [h.head(p, "a", to=V(1))])),
    ("is not a robot", lambda h, p, q, go: h.rule([], [DeriveFact(p, code((Robot(1),)), (code("a"),))])),
    ("binds a variable that is not listed", lambda h, p, q, go: h.rule([], [h.each([], [h.atom(p, V(1))], [])])),
    ("binds a variable that is not listed", lambda h, p, q, go: aggregate(h, p, slots=())),
    ("slot 1 is the result and a variable of the matches", lambda h, p, q, go: aggregate(h, p, result=1)),
    ("slot 0 is bound twice", lambda h, p, q, go: aggregate(h, p, result=0)),
    ("binds slot 3 of 3", lambda h, p, q, go: aggregate(h, p, result=3)),
    ("MIN with a wrong number of terms", lambda h, p, q, go: aggregate(h, p, term=None)),
    ("COUNT with a wrong number of terms", lambda h, p, q, go: aggregate(h, p, operator=Operator.COUNT)),
    (
        "slot 1 is used before",
        lambda h, p, q, go: aggregate(h, p, operator=Operator.SUM, head=(h.head(p, V(1)),)),
    ),
    ("slot 2 is used before", lambda h, p, q, go: aggregate(h, p, term=code(V(2)))),
    ("a predicate that is not there", lambda h, p, q, go: hidden(h, HiddenPredicate(99, Duty.NOTE))),
    ("a predicate that is not there", lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.RETURN, 99))),
    (
        "the predicates are not in order",
        lambda h, p, q, go: hidden(h, HiddenPredicate(q, Duty.NOTE), HiddenPredicate(p, Duty.NOTE)),
    ),
    (
        "a robot has one life only",
        lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.LIFE), HiddenPredicate(q, Duty.LIFE)),
    ),
    ("s is neither temporary nor persistent", lambda h, p, q, go: hidden(h, HiddenPredicate(S, Duty.NOTE))),
    ("p is not sensed", lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.HEARD, p))),
    ("s has another predicate, or lacks one", lambda h, p, q, go: hidden(h, HiddenPredicate(S, Duty.HEARD))),
    (
        "p is not temporary with the types that s needs",
        lambda h, p, q, go: hidden(h, HiddenPredicate(S, Duty.HEARD, p)),
    ),
    ("p has another predicate, or lacks one", lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.ASIDE))),
    ("p has another predicate, or lacks one", lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.NOTE, p))),
    ("p is not persistent with one int", lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.LIFE))),
    ("p is not temporary with one robot", lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.RESTARTED))),
    (
        "r is not temporary with the types that p needs",
        lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.RETURN, R)),
    ),
    (
        "p is not temporary with the types that p needs",
        lambda h, p, q, go: hidden(h, HiddenPredicate(p, Duty.DECISION, p)),
    ),
    ("fewer than two steps", lambda h, p, q, go: h.rule([], [Steps((h.head(p, "a"),))])),
    ("the name is not an identifier", lambda h, p, q, go: asserted(h, go, name="No")),
    ("owner 70000 is not a robot id", lambda h, p, q, go: asserted(h, go, robot=70000)),
    ("start and finish must keep or read their facts", lambda h, p, q, go: asserted(h, go, start=h.atom(R, V(1)))),
    ("start and finish must keep or read their facts", lambda h, p, q, go: asserted(h, go, finish=h.absent(R, V(1)))),
    ("the finisher is not a robot", lambda h, p, q, go: asserted(h, go, finisher=Constant(3))),
    (
        "the finisher is not a robot variable of the start",
        lambda h, p, q, go: asserted(h, go, start=h.keep(R, _), finisher=Slot(1)),
    ),
    (
        "the finisher is not a robot variable of the start",
        lambda h, p, q, go: asserted(h, go, start=h.keep(p, V(1)), finisher=Slot(1)),
    ),
    ("slot 1 is used before", lambda h, p, q, go: asserted(h, go, start=h.keep(R, _), deadline=code(V(1)))),
    ("2 source positions for 5 entries", lambda h, p, q, go: placed(h, *[Place("a", 1, 1)] * 2)),
    ("a line or column outside 1 to 4294967295", lambda h, p, q, go: placed(h, *[Place("a", 0, 1)] * 5)),
    ("the expression leaves 0 values", expression()),
    ("the expression leaves 2 values", expression(i(Op.INT, 1), i(Op.INT, 1))),
    ("instruction 1 (ADD) with 1 values on the stack", expression(i(Op.INT, 1), i(Op.ADD))),
    ("instruction 256 (INT) with 256 values on the stack", expression(*[i(Op.INT, 1)] * 300)),
    ("instruction 1 jumps out", expression(i(Op.INT, 1), i(Op.AND, 5))),
    ("JUMP with the negative operand -1", expression(i(Op.INT, 1), i(Op.JUMP, -1))),
    ("instruction 2 is never reached", expression(i(Op.INT, 1), i(Op.JUMP, 1), i(Op.INT, 2))),
    (
        "the ways to instruction 3 leave different numbers of values",
        expression(i(Op.INT, 1), i(Op.JUMP_IF_FALSE, 1), i(Op.INT, 2), i(Op.INT, 3)),
    ),
    ("there is no function 99", expression(i(Op.CALL, 99))),
    (f"there is no slot {SLOTS_MAX}", expression(i(Op.LOAD, SLOTS_MAX))),
    ("LOAD without a proper operand", expression(i(Op.LOAD))),
    ("INT without a proper operand", expression(i(Op.INT, True))),
    ("NEG takes no operand", expression(i(Op.INT, 1), i(Op.NEG, 1))),
    ("CONST with a value out of range", expression(i(Op.CONST, 2**63))),
    ("CONST with a value out of range", expression(i(Op.CONST, float("inf")))),
    ("CONST with a value out of range", expression(i(Op.CONST, "\ud800"))),
    ("CONST with a value out of range", expression(i(Op.CONST, (Symbol("Upper"),)))),
]


@pytest.mark.parametrize(("reason", "change"), UNSOUND, ids=[f"{n}-{case[0]}" for n, case in enumerate(UNSOUND)])
def test_an_unsound_program_is_refused_with_the_reason(reason, change):
    assert reason in reasons(change)


def template(node: ast.AST | None) -> str | None:
    """Return a reason in the code as a regular expression."""
    if isinstance(node, ast.IfExp):
        return template(node.orelse)
    if isinstance(node, ast.JoinedStr):
        return "".join(re.escape(p.value) if isinstance(p, ast.Constant) else ".*" for p in node.values)  # type: ignore[arg-type]
    return re.escape(node.value) if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def test_every_reason_of_the_verifier_has_its_unsound_program():
    told = [text for _, change in UNSOUND for text in reasons(change).split("; ")]
    known = [
        text
        for module, kind in ((verifier, ast.Yield), (part_checks, ast.Yield | ast.Return))
        for node in ast.walk(ast.parse(inspect.getsource(module)))
        if isinstance(node, kind) and (text := template(node.value))
    ]
    assert len(known) > 40
    assert [text for text in known if not any(re.search(f": {text}$", each) for each in told)] == []


SOUND: list[Callable[[Hand, int, int, int], object]] = [
    lambda h, p, q, go: h.rule([h.atom(p, V(1)), h.absent(q, V(3))], [h.head(go, V(1)), h.head(q, code(1))]),
    lambda h, p, q, go: h.rules.append(Rule(1, (), (DeriveFact(p, HERE, (code(Symbol("a")),)),))),
    lambda h, p, q, go: h.rule([h.atom(R, V(1))], [h.head(p, "a", to=V(1)), h.want(S, "a", to=V(1))]),
    lambda h, p, q, go: h.rule([h.atom(p, V(1))], [Steps((h.head(p, V(1)), h.head(go, V(1)), h.want(p, "a")))]),
    lambda h, p, q, go: aggregate(h, p, head=(h.head(p, V(1)),)),
    lambda h, p, q, go: aggregate(h, p, operator=Operator.MAX, head=(h.head(q, V(2)),)),
    lambda h, p, q, go: aggregate(h, p, operator=Operator.COLLECT, head=(h.head(q, V(2)),)),
    lambda h, p, q, go: aggregate(h, p, operator=Operator.COUNT, term=None, head=(h.head(q, V(2)),)),
    lambda h, p, q, go: aggregate(h, p, term=code("call:now")),
    lambda h, p, q, go: h.rule([], [h.each([V(1)], [h.atom(p, V(1))], []), h.each([V(1)], [h.atom(q, V(1))], [])]),
    lambda h, p, q, go: h.facts.append(InitialFact(R, 65533, (Slot(0),))),
    lambda h, p, q, go: h.goals.append(InitialGoal(R, None, (Slot(0),), ())),
    lambda h, p, q, go: h.goals.append(InitialGoal(q, None, (Slot(1),))),
    lambda h, p, q, go: (h.rule([], []), h.goals.append(InitialGoal(q, None, (_,), (Lead(0, None),)))),
    lambda h, p, q, go: asserted(h, go, robot=0, finisher=Slot(1)),
    lambda h, p, q, go: asserted(h, go, finisher=Constant(Robot(9)), finish=h.keep(R, V(0))),
    lambda h, p, q, go: h.action("act", ROBOT, effects=(Effect(p, (code("a"),), code(V(1))), Effect(S, (code("a"),)))),
    lambda h, p, q, go: h.action("act", OPEN, effects=(Effect(p, (code("a"),), code(V(1))),)),
    lambda h, p, q, go: predicate(h, INT, name="own", provided=False),
    lambda h, p, q, go: h.sensed("range", ROBOT, FLOAT, provided=True),
    lambda h, p, q, go: predicate(h, nested(NESTING_MAX)),
    lambda h, p, q, go: placed(h, *[Place("a", 1, 1)] * 5),
]


@pytest.mark.parametrize("change", SOUND, ids=range(len(SOUND)))
def test_a_sound_program_is_accepted(change):
    assert reasons(change) == ""


def test_both_ways_through_a_condition_are_followed():
    both = (i(Op.LOAD, 0), i(Op.JUMP_IF_FALSE, 2), i(Op.INT, 1), i(Op.JUMP, 1), i(Op.INT, 2))
    assert reasons(expression(*both)) == ""


def test_every_opcode_has_a_form_and_every_function_a_name_of_its_own():
    assert set(FORMS) == set(Op)
    assert len({function.name for function in FUNCTIONS}) == len(FUNCTIONS)


def test_number_of_reasons_of_the_verifier_is_bounded():
    hand, p, *_rest = base()
    for _number in range(3 * REASONS_MAX):
        hand.rule([hand.atom(p, V(9))], [], slots=3)
    assert len(verify(hand.program())) == REASONS_MAX


def counted(monkeypatch: pytest.MonkeyPatch, module: object, name: str) -> list[object]:
    """Count the calls of a function of `module`."""
    original = getattr(module, name)
    calls: list[object] = []

    def count(*args: object) -> object:
        calls.append(args[0])
        return original(*args)

    monkeypatch.setattr(module, name, count)
    return calls


def test_an_expression_that_many_entries_share_is_looked_at_once(monkeypatch):
    calls = counted(monkeypatch, part_checks, "examine")
    hand, _p, q, _go = base()
    shared: Code = code(1, 2, Op.ADD)
    hand.rules.extend(Rule(1, (), (DeriveFact(q, HERE, (shared,)),)) for _ in range(50))
    assert verify(hand.program()) == []
    assert len(calls) == 2


def test_a_list_that_many_entries_share_is_looked_at_once(monkeypatch):
    calls = counted(monkeypatch, part_checks, "sound")
    hand = Hand()
    p = hand.temporary("p", Type(Base.LIST, element=INT))
    shared = tuple(range(30))
    hand.facts.extend(InitialFact(p, None, (shared,)) for _ in range(50))
    assert verify(hand.program()) == []
    assert [call for call in calls if call is shared] == [shared]
