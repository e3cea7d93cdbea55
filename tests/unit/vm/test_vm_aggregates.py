"""Aggregates, and what they share with comprehensions: which matches count, and which facts they take."""

import pytest
from vm_hand import AREA, FLOAT, INT, OPEN, ROBOT, Hand, V, _, actions, code, fired, guard, sent

from rmr.base.time import seconds
from rmr.base.values import INT_MAX, Robot, Symbol, Value
from rmr.bytecode.conform import LENGTH_MAX
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Operator, Type
from rmr.vm.evaluate import same
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ExpressionFailed

pytestmark = pytest.mark.usefixtures("each_engine")

GO = "go"


def folding(operator: Operator, values: list[Value], kind: Type = OPEN, *, keep: bool = False) -> Machine:
    """``go(R), -o [op X => V | n(R, X) | out(R, V)]`` with facts n(R, ...), run."""
    hand = Hand()
    go, n, out = hand.temporary(GO), hand.temporary("n", kind), hand.temporary("out", OPEN)
    body = [hand.keep(n, V(1)) if keep else hand.atom(n, V(1))]
    term = None if operator is Operator.COUNT else V(1)
    hand.rule([hand.atom(go)], [hand.fold(operator, term, V(2), body, hand.head(out, V(2)), V(1))])
    machine = hand.machine()
    for value in values:
        machine.insert(0, n, (value,))
    machine.insert(0, go, ())
    machine.run(0)
    return machine


def result(operator: Operator, values: list[Value]) -> Value | None:
    """What the aggregate of `values` is; None if it derives nothing."""
    machine = folding(operator, values)
    assert machine.program.predicates[2].name == "out"
    facts = machine.held(2)  # the value itself, of which `facts()` shows only the text
    return facts[0][0] if facts else None


@pytest.mark.parametrize(
    ("operator", "values", "expected"),
    [
        (Operator.COUNT, [4, 4, 5], 3),
        (Operator.SUM, [4, 4, 5], 13),
        (Operator.SUM, [1, 0.5], 1.5),
        (Operator.SUM, [1.0, 2.0], 3.0),
        (Operator.SUM, [INT_MAX, 1, -1], INT_MAX),
        (Operator.MIN, [4, 3, 5], 3),
        (Operator.MAX, [4, 3, 5], 5),
        (Operator.MIN, ["b", "a"], "a"),
        (Operator.MIN, [2, 1.5], 1.5),
        (Operator.MAX, [2, 1.5], 2),
        (Operator.MAX, [1.0, 1], 1.0),
        (Operator.COLLECT, [4, 3, 4], (4, 3, 4)),
        (Operator.COLLECT, [Symbol("b"), Robot(1)], (Symbol("b"), Robot(1))),
    ],
)
def test_an_aggregate_makes_one_value_of_all_matches(operator: Operator, values: list[Value], expected: Value) -> None:
    value = result(operator, values)
    assert value is not None
    assert same(value, expected)
    assert type(value) is type(expected)


@pytest.mark.parametrize(
    ("operator", "expected"),
    [
        (Operator.COUNT, 0),
        (Operator.SUM, 0),
        (Operator.COLLECT, ()),
        (Operator.MIN, None),
        (Operator.MAX, None),
    ],
)
def test_aggregate_of_no_match_counts_zero_and_has_no_minimum_or_maximum(operator: Operator, expected: Value) -> None:
    machine = folding(operator, [])
    assert machine.firings == 1
    assert result(operator, []) == expected


@pytest.mark.parametrize(
    ("operator", "values"),
    [
        (Operator.SUM, [INT_MAX, 1]),
        (Operator.SUM, [1e308, 1e308]),
        (Operator.SUM, [1, "a"]),
        (Operator.MIN, [1, "a"]),
        (Operator.MAX, [Symbol("a")]),
        (Operator.MIN, [True, False]),
    ],
)
def test_without_a_value_the_firing_as_a_whole_does_not_happen(operator: Operator, values: list[Value]) -> None:
    machine = folding(operator, values)
    assert machine.firings == 0
    assert machine.expression_failures == 1
    assert len(machine.facts()) == len(values) + 1


def test_a_list_that_would_be_too_long_is_not_collected() -> None:
    half = "x" * (LENGTH_MAX // 2)
    assert folding(Operator.COLLECT, [half]).firings == 1
    assert folding(Operator.COLLECT, [half, half]).firings == 0


def test_a_match_whose_term_has_no_value_is_left_out_and_keeps_its_facts() -> None:
    hand = Hand()
    go, n, out = hand.temporary(GO), hand.temporary("n", INT), hand.temporary("out", OPEN)
    term = code(6, V(1), Op.DIV)
    hand.rule([hand.atom(go)], [hand.fold(Operator.SUM, term, V(2), [hand.atom(n, V(1))], hand.head(out, V(2)), V(1))])
    for number in (0, 2, 3):
        hand.fact(n, number)
    machine = hand.machine()
    machine.insert(0, go, ())
    machine.run(0)
    assert machine.facts() == ["n(@1, 0)", "out(@1, 5.0)"]
    assert machine.expression_failures == 1
    (failed,) = [event for event in machine.drain() if isinstance(event, ExpressionFailed)]
    assert failed.reason == "division by zero"


def test_the_facts_of_all_matches_are_consumed_unless_they_are_kept() -> None:
    assert folding(Operator.MIN, [2, 1, 3]).facts() == ["out(@1, 1)"]
    assert folding(Operator.MIN, [2, 1, 3], keep=True).facts() == ["n(@1, 1)", "n(@1, 2)", "n(@1, 3)", "out(@1, 1)"]


def test_no_temporary_fact_serves_two_matches() -> None:
    hand = Hand()
    go, a, b, out = hand.temporary(GO), hand.temporary("a", INT), hand.temporary("b", INT), hand.temporary("out", OPEN)
    for number in (1, 2, 3):
        hand.fact(a, number)
    for number in (10, 20):
        hand.fact(b, number)
    body = [hand.atom(a, V(1)), hand.atom(b, V(2))]
    sums = hand.fold(Operator.COLLECT, code(V(1), V(2), Op.ADD), V(3), body, hand.head(out, V(3)), V(1), V(2))
    hand.rule([hand.atom(go)], [sums])
    machine = hand.machine()
    machine.insert(0, go, ())
    machine.run(0)
    assert machine.facts() == ["a(@1, 3)", "out(@1, [11, 22])"]


def test_what_an_earlier_match_consumed_still_stands_for_not_and_for_kept_facts() -> None:
    hand = Hand()
    go, n, out = hand.temporary(GO), hand.temporary("n", INT), hand.action("out", INT, INT)
    for number in (1, 2):
        hand.fact(n, number)
    blocked = [hand.atom(n, V(1)), hand.absent(n, 1)]
    beside = [hand.atom(n, V(1)), hand.keep(n, V(2))]
    hand.rule(
        [hand.atom(go)],
        [
            hand.each([V(1)], blocked, [hand.head(out, V(1), 0)]),
            hand.each([V(1), V(2)], beside, [hand.head(out, V(1), V(2))]),
        ],
    )
    machine = hand.machine()
    machine.insert(0, go, ())
    machine.run(0)
    assert [action.args for action in actions(machine.drain())] == [(1, 2), (2, 1)]
    assert machine.facts() == []


def test_a_fact_once_kept_may_be_consumed_by_a_later_match() -> None:
    hand = Hand()
    go, n, out = hand.temporary(GO), hand.temporary("n", INT), hand.action("out", INT, INT)
    for number in (1, 2, 3):
        hand.fact(n, number)
    beside = [hand.keep(n, V(1)), hand.atom(n, V(2))]
    hand.rule([hand.atom(go)], [hand.each([V(1), V(2)], beside, [hand.head(out, V(1), V(2))])])
    machine = hand.machine()
    machine.insert(0, go, ())
    machine.run(0)
    assert [action.args for action in actions(machine.drain())] == [(1, 2), (1, 3), (2, 1)]


def roads(operator: Operator) -> tuple[Hand, int]:
    """``go(R, A) -o [op D => V | road(R, A, B, D) | way(R, B, V)]``."""
    hand = Hand()
    go, road, way = hand.temporary(GO, AREA), hand.persistent("road", AREA, AREA, INT), hand.action("way", AREA, INT)
    for there, far in (("x", 7), ("b", 3), ("c", 3), ("d", 9), ("e", 9)):
        hand.fact(road, "a", there, far)
    body = [hand.atom(road, V(1), V(2), V(3))]
    hand.rule([hand.atom(go, V(1))], [hand.fold(operator, V(3), V(4), body, hand.head(way, V(2), V(4)), V(2), V(3))])
    return hand, go


@pytest.mark.parametrize(("operator", "expected"), [(Operator.MIN, ("b", 3)), (Operator.MAX, ("d", 9))])
def test_the_winning_match_binds_its_variables_and_the_oldest_of_equals_wins(
    operator: Operator, expected: tuple[str, int]
) -> None:
    hand, go = roads(operator)
    machine = hand.machine()
    machine.insert(0, go, (Symbol("a"),))
    machine.run(0)
    assert [action.args for action in actions(machine.drain())] == [expected]


def test_a_choice_among_nothing_derives_nothing_but_the_rest_of_the_head_does() -> None:
    hand, go = roads(Operator.MIN)
    machine = hand.machine()
    machine.insert(0, go, (Symbol("z"),))
    machine.run(0)
    assert fired(machine.drain()) == [0]


def test_aggregates_and_comprehensions_run_left_to_right_and_before_the_head() -> None:
    hand = Hand()
    go, n, out = hand.temporary(GO), hand.temporary("n", INT), hand.action("out", OPEN)
    for number in (1, 2, 3):
        hand.fact(n, number)
    small = [hand.atom(n, V(1)), guard(V(1), 2, Op.LT)]
    count = hand.fold(Operator.COUNT, None, V(2), [hand.keep(n, V(1))], hand.head(out, V(2)), V(1))
    collect = hand.fold(Operator.COLLECT, V(1), V(2), [hand.atom(n, V(1))], hand.head(out, V(2)), V(1))
    taken = hand.each([V(1)], small, [hand.head(out, V(1))])
    hand.rule([hand.atom(go)], [hand.head(n, 9), count, taken, collect, count])
    machine = hand.machine()
    machine.insert(0, go, ())
    machine.run(0)
    assert [action.args[0] for action in actions(machine.drain())] == [3, 1, (2, 3), 0]
    assert machine.facts() == ["n(@1, 9)"]


def test_an_aggregate_sees_the_facts_after_the_body_consumed_its_own() -> None:
    hand = Hand()
    n, out = hand.temporary("n", INT), hand.temporary("out", INT)
    hand.fact(n, 1)
    hand.fact(n, 2)
    count = hand.fold(Operator.COUNT, None, V(2), [hand.atom(n, _)], hand.head(out, V(2)))
    hand.rule([hand.atom(n, V(1)), guard(V(1), 1, Op.EQ)], [count])
    assert hand.machine().facts() == ["out(@1, 1)"]


def test_an_aggregates_head_without_value_stops_the_firing() -> None:
    hand = Hand()
    n, out = hand.temporary("n", INT), hand.temporary("out", FLOAT)
    hand.fact(n, 1)
    count = hand.fold(Operator.COUNT, None, V(2), [hand.absent(n, 1)], hand.head(out, code(1, V(2), Op.DIV)))
    hand.rule([hand.atom(n, V(1))], [count])
    machine = hand.machine()
    assert machine.facts() == ["out(@1, 1.0)"], "the body has consumed n(1) before it is absent"
    machine.insert(0, n, (1,))
    machine.insert(0, n, (1,))
    machine.run(0)
    assert machine.facts() == ["n(@1, 1)", "n(@1, 1)", "out(@1, 1.0)"]
    assert machine.expression_failures == 2, "once for each of the two matches"


def test_an_aggregate_is_worked_out_anew_when_its_facts_have_changed() -> None:
    hand = Hand(textual=True)
    a, b, n, out = hand.temporary("a"), hand.temporary("b"), hand.temporary("n", INT), hand.temporary("out", INT)
    hand.fact(a)
    hand.fact(b)
    hand.rule([hand.atom(a)], [hand.head(n, 5)])
    hand.rule([hand.atom(b)], [hand.fold(Operator.SUM, V(1), V(2), [hand.atom(n, V(1))], hand.head(out, V(2)), V(1))])
    assert hand.machine().facts() == ["out(@1, 5)"]


def test_the_time_may_be_aggregated_and_is_that_of_the_firing() -> None:
    hand = Hand()
    go, n, out = hand.temporary(GO), hand.temporary("n", INT), hand.temporary("out", FLOAT)
    hand.fact(n, 1)
    term = code("call:now", V(1), Op.ADD)
    hand.rule([hand.atom(go)], [hand.fold(Operator.MAX, term, V(2), [hand.keep(n, V(1))], hand.head(out, V(2)), V(1))])
    machine = hand.machine()
    machine.insert(seconds(1), go, ())
    machine.run(seconds(4))
    assert machine.facts() == ["n(@1, 1)", "out(@1, 5.0)"]


def test_an_aggregates_head_may_go_to_another_robot() -> None:
    hand = Hand()
    ask, n, out = hand.temporary("ask", ROBOT), hand.temporary("n", INT), hand.temporary("out", INT)
    hand.fact(n, 4)
    total = hand.fold(Operator.SUM, V(2), V(3), [hand.keep(n, V(2))], hand.head(out, V(3), to=V(1)), V(2))
    hand.rule([hand.atom(ask, V(1))], [total])
    machine = hand.machine()
    machine.insert(0, ask, (Robot(6),))
    machine.run(0)
    assert sent(machine.drain()) == [(6, out, (4,))]


def test_a_rule_that_consumes_nothing_aggregates_once_for_each_match_of_its_body() -> None:
    hand = Hand()
    on, n, out = hand.sensed("on"), hand.temporary("n", INT), hand.temporary("out", INT)
    hand.rule([hand.atom(on)], [hand.fold(Operator.COUNT, None, V(1), [hand.keep(n, _)], hand.head(out, V(1)))])
    machine = hand.machine()
    machine.insert(0, on, ())
    machine.run(0)
    machine.insert(0, n, (1,))
    machine.run(0)
    assert machine.facts() == ["n(@1, 1)", "out(@1, 0)"]


def test_many_facts_are_paired_in_good_time() -> None:
    hand = Hand()
    go, a, b, out = hand.temporary(GO), hand.temporary("a", INT), hand.temporary("b", INT), hand.temporary("out", INT)
    body = [hand.atom(a, V(1)), hand.atom(b, V(2))]
    hand.rule([hand.atom(go)], [hand.fold(Operator.COUNT, None, V(3), body, hand.head(out, V(3)), V(1), V(2))])
    machine = hand.machine()
    for number in range(1000):
        machine.insert(0, a, (number,))
        machine.insert(0, b, (number,))
    machine.insert(0, go, ())
    machine.run(0)
    assert machine.facts() == ["out(@1, 1000)"]
