"""Aggregates are what Python makes of the same values."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vm_hand import OPEN, Hand, V, actions, machine_of

from rmr.base.values import INT_MAX, INT_MIN, Value
from rmr.bytecode.arithmetic import same
from rmr.bytecode.program import Operator
from rmr.vm.machine import Machine

ints = st.integers(INT_MIN, INT_MAX) | st.integers(-9, 9)
floats = st.floats(allow_nan=False, allow_infinity=False)
lists = st.lists(ints | floats, max_size=30) | st.lists(ints, max_size=30)


def aggregated(operator: Operator, values: list[Value], keep: bool) -> tuple[list[Value], Machine]:
    """What ``go(R) -o [operator X => V | n(R, X) | out(R, V)]`` derives from facts ``n(R, ...)``."""
    hand = Hand()
    go, n, out = hand.temporary("go"), hand.temporary("n", OPEN), hand.action("out", OPEN)
    body = [hand.keep(n, V(1)) if keep else hand.atom(n, V(1))]
    term = None if operator is Operator.COUNT else V(1)
    hand.rule([hand.atom(go)], [hand.fold(operator, term, V(2), body, hand.head(out, V(2)), V(1))])
    machine = machine_of(hand.program())
    for value in values:
        machine.insert(0, n, (value,))
    machine.insert(0, go, ())
    machine.run(0)
    return [action.args[0] for action in actions(machine.drain())], machine


def reference(operator: Operator, values: list[Value]) -> Value | None:
    """The same by Python; None: nothing."""
    match operator:
        case Operator.COUNT:
            return len(values)
        case Operator.SUM:
            return sum(values)  # type: ignore[arg-type]
        case Operator.COLLECT:
            return tuple(values)
        case Operator.MIN:
            return min(values, default=None)  # type: ignore[type-var]
        case _:
            return max(values, default=None)  # type: ignore[type-var]


@pytest.mark.medium
@settings(deadline=None)
@given(st.sampled_from(list(Operator)), lists, st.booleans())
def test_aggregate_equals_the_python_result_or_the_rule_does_not_fire(
    operator: Operator, values: list[Value], keep: bool
) -> None:
    expected = reference(operator, values)
    derived, machine = aggregated(operator, values, keep)
    fits = type(expected) is not int or INT_MIN <= expected <= INT_MAX
    if not fits or (type(expected) is float and not math.isfinite(expected)):
        assert (derived, machine.firings, len(machine.facts())) == ([], 0, len(values) + 1)
        return
    assert machine.firings == 1
    assert len(machine.facts()) == (len(values) if keep else 0)
    if expected is None:
        assert derived == []
        return
    (value,) = derived
    assert same(value, expected)
    assert type(value) is type(expected)
