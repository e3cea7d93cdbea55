"""The generated way in lets through what the gate lets through, as the gate does, and refuses the same in its words."""

from itertools import product
from math import inf, nan

import pytest
from vm_hand import Hand

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.conform import LENGTH_MAX
from rmr.bytecode.program import Base, Type
from rmr.vm.outside import Gate
from rmr.vm.store import Args

TYPES = [
    *(Type(base) for base in Base if base is not Base.LIST),
    Type(Base.LIST),
    Type(Base.LIST, element=Type(Base.INT)),
]

VALUES: list[Value] = [
    *(0, 1, INT_MAX, INT_MAX + 1, INT_MIN, INT_MIN - 1, 10**400),
    *(True, False, 1.0, -0.0, inf, -inf, nan),
    *(Robot(0), Robot(ROBOT_ID_MAX), Robot(ROBOT_ID_MAX + 1), Robot(-1)),
    *("", "a", "\u00fc", "\ud800", "a" * LENGTH_MAX, "a" * (LENGTH_MAX + 1)),
    *(Symbol("a"), Symbol("\u00fc"), Symbol("\ud800"), Symbol("a" * (LENGTH_MAX + 1))),
    *((), (1, 2), (1, 2.0), ("a",), ((1,),), (nan,)),
]


def came_in(hand: Hand, predicate: int, args: Args) -> object:
    """What is held after an insertion, or why it was refused."""
    machine = hand.machine()
    try:
        machine.insert(0, predicate, args)
    except ValueError as reason:
        return str(reason)
    return [[(type(value), repr(value)) for value in fact] for fact in machine.held(predicate)]


def let_through(gate: Gate, predicate: int, args: Args) -> object:
    try:
        fact = gate.fact(predicate, args)
    except ValueError as reason:
        return str(reason)
    return [[(type(value), repr(value)) for value in fact]]


@pytest.mark.parametrize("kind", TYPES, ids=repr)
def test_each_value_comes_in_as_the_gate_lets_it_through(kind: Type) -> None:
    hand = Hand()
    one, two = hand.temporary("one", kind), hand.persistent("two", Type(Base.INT), kind)
    gate = Gate(hand.program().predicates)
    refused = 0
    for value in VALUES:
        for predicate, args in ((one, (value,)), (two, (5, value)), (two, (5.5, value))):
            expected = let_through(gate, predicate, args)
            assert came_in(hand, predicate, args) == expected
            refused += isinstance(expected, str)
    assert len(VALUES) <= refused < 3 * len(VALUES)


def test_the_wrong_number_of_arguments_is_refused_as_the_gate_refuses_it() -> None:
    hand = Hand()
    for arity in range(4):
        hand.temporary(f"p{arity}", *[Type(Base.INT)] * arity)
    gate = Gate(hand.program().predicates)
    for predicate, count in product(range(4), range(5)):
        args = tuple(range(count))
        assert came_in(hand, predicate, args) == let_through(gate, predicate, args)


def test_there_are_no_facts_of_actions_and_of_predicates_that_are_not_there() -> None:
    hand = Hand()
    hand.action("go", Type(Base.INT))
    hand.temporary("p")
    for predicate in (0, -1, 2, 10**30):
        with pytest.raises(ValueError, match=r"go is an action|there is no predicate"):
            hand.machine().insert(0, predicate, ())


def test_unknown_predicate_numbers_are_not_cached() -> None:
    hand = Hand()
    hand.temporary("p")
    machine = hand.machine()
    ways: dict[int, object] = machine.module.names["ARRIVE"]
    for number in range(100):
        with pytest.raises(ValueError, match="there is no predicate"):
            machine.insert(0, 1 + number, ())
    machine.insert(0, 0, ())
    assert list(ways) == [0]
