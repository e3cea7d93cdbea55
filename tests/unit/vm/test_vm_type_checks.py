"""What is derived has the type that is declared, or is not derived."""

import pytest
from vm_hand import AREA, FLOAT, INT, OPEN, Hand, V, actions, code, fired

from rmr.base.values import Symbol
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Aggregate, Base, Effect, Operator, Type
from rmr.bytecode.scope import Scope
from rmr.vm.machine_events import ExpressionFailed
from rmr.vm.type_checks import type_checks


def reasons(events):
    return [event.reason for event in events if isinstance(event, ExpressionFailed)]


@pytest.mark.parametrize(("stated", "derived"), [(1, ["p(@1, 1)"]), (1.0, []), ("a", []), ((1,), [])])
def test_value_of_open_type_is_derived_only_into_a_matching_declared_type(stated, derived):
    hand = Hand()
    q, p = hand.temporary("q", OPEN), hand.temporary("p", INT)
    hand.fact(q, stated)
    hand.rule([hand.atom(q, V(1))], [hand.head(p, V(1))])
    machine = hand.machine()
    assert [fact for fact in machine.facts() if fact.startswith("p")] == derived
    assert reasons(machine.drain()) == ([] if derived else ["argument 2 of p is no int"])


def test_a_list_is_looked_at_with_all_its_items():
    hand = Hand()
    numbers = Type(Base.LIST, element=INT)
    q, p = hand.temporary("q", OPEN), hand.temporary("p", numbers)
    hand.fact(q, (1, 2))
    hand.fact(q, (1, 2.0))
    hand.rule([hand.atom(q, V(1))], [hand.head(p, V(1))])
    assert [fact for fact in hand.machine().facts() if fact.startswith("p")] == ["p(@1, [1, 2])"]


def test_an_expression_that_yields_another_type_does_not_fire():
    hand = Hand()
    q, p = hand.temporary("q", INT), hand.temporary("p", INT)
    hand.fact(q, 3)
    hand.rule([hand.atom(q, V(1))], [hand.head(p, code(V(1), 2, Op.DIV))])
    machine = hand.machine()
    assert fired(machine.drain()) == []
    assert machine.expression_failures == 1


def test_minimum_of_open_type_is_derived_only_if_it_fits_the_declared_type():
    hand = Hand()
    q, p = hand.temporary("q", FLOAT), hand.temporary("p", INT)
    hand.fact(q, 1.5)
    smallest = Aggregate(Operator.MIN, code(V(1)), 2, (1,), (hand.keep(q, V(1)),), (hand.head(p, V(2)),))
    hand.rule([], [smallest])
    machine = hand.machine()
    assert reasons(machine.drain()) == ["argument 2 of p is no int"]


def test_effect_of_wrong_type_is_dropped_and_reported():
    hand = Hand()
    p = hand.temporary("p", AREA)
    hand.action("go", OPEN, effects=(Effect(p, (code(V(1)),)),))
    hand.rule([], [hand.head(1, 7)])
    machine = hand.machine()
    (action,) = actions(machine.drain())
    assert machine.complete(0, action.serial, True)
    assert machine.facts() == []
    assert reasons(machine.drain()) == ["argument 2 of p is no symbol"]


def test_violation_of_wrong_type_is_dropped_and_reported():
    hand = Hand()
    s, f, act = hand.temporary("s", OPEN), hand.temporary("f"), hand.action("act", INT)
    hand.asserts(hand.keep(s, V(1)), hand.keep(f), 1, hand.head(act, V(1)))
    hand.fact(s, Symbol("a"))
    machine = hand.machine()
    machine.run(2 * 10**9)
    events = machine.drain()
    assert actions(events) == []
    assert reasons(events) == ["argument 2 of act is no int"]


def test_statically_known_types_leave_no_runtime_check():
    hand = Hand()
    q, p = hand.temporary("q", INT), hand.temporary("p", INT, OPEN)
    scope = Scope()
    scope.grow([hand.atom(q, V(1))], hand.predicates)
    assert type_checks(hand.head(p, V(1), code(V(2), 1, Op.ADD)), hand.predicates, scope) == ()
    assert [check.place for check in type_checks(hand.head(p, code(V(1), 1, Op.ADD), 5), hand.predicates, scope)] == [0]
