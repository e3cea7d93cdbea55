"""The verifier finds each kind of unsound program."""

from collections.abc import Callable

import pytest
from vm_hand import AREA, INT, Hand, V, _, code, guard

from rmr.base.values import Symbol
from rmr.bytecode.limits import SLOTS_MAX
from rmr.bytecode.opcodes import FORMS, FUNCTIONS, Op
from rmr.bytecode.program import (
    Atom,
    Code,
    Comprehension,
    DeriveFact,
    Effect,
    Guard,
    InitialFact,
    InitialGoal,
    Instruction,
    Mode,
    Rule,
    Slot,
)
from rmr.bytecode.verify import verify


def base() -> tuple[Hand, int, int, int]:
    hand = Hand()
    return hand, hand.temporary("p", AREA), hand.persistent("q", INT), hand.action("go", AREA)


def reasons(change: Callable[[Hand, int, int, int], object]) -> str:
    hand, p, q, go = base()
    assert verify(hand.program()) == []
    change(hand, p, q, go)
    return "; ".join(verify(hand.program()))


def expression(*instructions: Instruction) -> str:
    def change(hand: Hand, p: int, q: int, go: int) -> None:
        hand.rules.append(Rule(2, (Guard(instructions),), ()))

    return reasons(change)


def i(op: Op, operand: int | None = None) -> Instruction:
    return Instruction(op, operand)


RULES = {
    f"{SLOTS_MAX + 1} variables": lambda h, p, q, go: h.rules.append(Rule(SLOTS_MAX + 1, (), ())),
    "uses slot": lambda h, p, q, go: h.rule([h.atom(p, V(9))], [], slots=3),
    "before it is bound": lambda h, p, q, go: h.rule([h.atom(p, V(1))], [h.head(p, V(2))]),
    "instead of 1": lambda h, p, q, go: h.rule([Atom(p, (), Mode.CONSUME)], []),
    "no predicate 99": lambda h, p, q, go: h.rule([Atom(99, (), Mode.CONSUME)], []),
    "CONSUME of q": lambda h, p, q, go: h.rule([h.atom(q, V(1), mode=Mode.CONSUME)], []),
    "READ of p": lambda h, p, q, go: h.rule([h.atom(p, V(1), mode=Mode.READ)], []),
    "go is an action": lambda h, p, q, go: h.rule([Atom(go, (Slot(1),), Mode.READ)], []),
    "p is not an action": lambda h, p, q, go: h.asserts(
        h.atom(p, V(1)), h.atom(q, _), 1, type(h.head(go, "a"))(p, code(V(0)), (code("a"),))
    ),
    "wrong type": lambda h, p, q, go: h.rule([h.atom(q, "one")], []),
    "now() in a body": lambda h, p, q, go: h.rule([guard("call:now", 1, Op.LT)], []),
    "bound twice": lambda h, p, q, go: h.rule([h.atom(p, V(1))], [Comprehension((1,), (), ())]),
    "is not listed": lambda h, p, q, go: h.rule([], [h.each([], [h.atom(p, V(1))], [])]),
    "is no robot": lambda h, p, q, go: h.facts.append(InitialFact(q, 65534, (1,))),
    "has the wrong type": lambda h, p, q, go: h.facts.append(InitialFact(q, None, (1.0,))),
    "goal 0": lambda h, p, q, go: h.goals.append(InitialGoal(go, None, (_,))),
    "taken": lambda h, p, q, go: h.temporary("p"),
    "only an action has effects": lambda h, p, q, go: h.predicate(
        "r", h.predicates[p].kind, effects=(Effect(q, (code(1),)),)
    ),
    "slot 2 is used": lambda h, p, q, go: h.action("act", AREA, effects=(Effect(p, (code(V(2)),)),)),
}


@pytest.mark.parametrize("reason", RULES)
def test_an_unsound_program_is_refused_with_the_reason(reason: str) -> None:
    assert reason in reasons(RULES[reason])


def test_what_an_absent_atom_leaves_free_is_not_bound_by_it() -> None:
    text = reasons(lambda h, p, q, go: h.rule([h.absent(p, V(1))], [h.head(p, V(1))]))
    assert "before it is bound" in text


EXPRESSIONS: dict[str, Code] = {
    "leaves 0 values": (),
    "leaves 2 values": (i(Op.INT, 1), i(Op.INT, 1)),
    "with 1 values on the stack": (i(Op.INT, 1), i(Op.ADD)),
    "jumps out": (i(Op.INT, 1), i(Op.AND, 5)),
    "negative operand": (i(Op.INT, 1), i(Op.JUMP, -1)),
    "never reached": (i(Op.INT, 1), i(Op.JUMP, 1), i(Op.INT, 2)),
    "different numbers": (i(Op.INT, 1), i(Op.JUMP_IF_FALSE, 1), i(Op.INT, 2), i(Op.INT, 3)),
    "no function": (i(Op.CALL, 99),),
    "proper operand": (i(Op.LOAD),),
    "takes no operand": (i(Op.INT, 1), i(Op.NEG, 1)),
    "out of range": (i(Op.CONST, 2**63),),
}


@pytest.mark.parametrize("reason", EXPRESSIONS)
def test_an_unbalanced_expression_is_refused_with_the_reason(reason: str) -> None:
    assert reason in expression(*EXPRESSIONS[reason])


def test_both_ways_through_a_condition_are_followed() -> None:
    both = (i(Op.LOAD, 0), i(Op.JUMP_IF_FALSE, 2), i(Op.INT, 1), i(Op.JUMP, 1), i(Op.INT, 2))
    assert expression(*both) == ""


def test_every_opcode_has_a_form_and_every_function_a_name_of_its_own() -> None:
    assert set(FORMS) == set(Op)
    assert len({function.name for function in FUNCTIONS}) == len(FUNCTIONS)


def test_a_sound_rule_has_no_reasons() -> None:
    def change(hand: Hand, p: int, q: int, go: int) -> None:
        hand.rule([hand.atom(p, V(1)), hand.absent(q, V(3))], [hand.head(go, V(1)), hand.head(q, code(1))])
        hand.rules.append(Rule(1, (), (DeriveFact(p, code(V(0)), (code(Symbol("a")),)),)))

    assert reasons(change) == ""
