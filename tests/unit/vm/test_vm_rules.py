"""Matching, firing and selection, through the machine."""

import pytest
from vm_hand import AREA, FLOAT, INT, OPEN, ROBOT, Hand, V, _, actions, bind, code, fired, guard, sent

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Effect
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ExpressionFailed, FactInserted, FactRemoved, GoalSent
from rmr.vm.store import INDEX_FROM

pytestmark = pytest.mark.usefixtures("each_engine")


def tell(machine: Machine, predicate: int, *args: Value) -> list[int]:
    """Insert a fact, run, return the rules that fired."""
    machine.insert(1, predicate, args)
    machine.run(1)
    return fired(machine.drain())


def test_a_linear_fact_is_consumed_once() -> None:
    hand = Hand()
    token, left, right = (hand.temporary(name) for name in ("token", "left", "right"))
    hand.fact(token)
    hand.rule([hand.atom(token)], [hand.head(left)])
    hand.rule([hand.atom(token)], [hand.head(right)])
    for seed in range(20):
        assert hand.machine(seed=seed).facts() in (["left(@1)"], ["right(@1)"])


def test_two_conjuncts_never_match_the_same_temporary_fact() -> None:
    hand = Hand()
    coin, kept, prize = hand.temporary("coin"), hand.temporary("kept"), hand.temporary("prize")
    hand.rule([hand.atom(coin), hand.atom(coin)], [hand.head(prize)])
    hand.rule([hand.keep(kept), hand.atom(kept)], [hand.head(prize)])
    machine = hand.machine()
    assert tell(machine, coin) == []
    assert tell(machine, kept) == []
    assert tell(machine, coin) == [0]
    assert tell(machine, kept) == [1]
    assert machine.facts() == ["kept(@1)", "prize(@1)", "prize(@1)"]


def test_two_conjuncts_may_match_the_same_persistent_fact() -> None:
    hand = Hand()
    number, pair = hand.persistent("number", INT), hand.temporary("pair", INT, INT)
    hand.fact(number, 1)
    hand.rule([hand.atom(number, V(1)), hand.atom(number, V(2))], [hand.head(pair, V(1), V(2))])
    assert hand.machine().facts() == ["!number(@1, 1)", "pair(@1, 1, 1)"]


@pytest.mark.parametrize("count", [3, 2 * INDEX_FROM])
def test_the_oldest_facts_go_first_conjunct_by_conjunct(count: int) -> None:
    hand = Hand(textual=True)
    a, b, out = hand.temporary("a", INT), hand.temporary("b", INT, INT), hand.action("out", INT, INT)
    for number in range(count):
        hand.fact(a, number)
    for number in reversed(range(count)):
        hand.fact(b, number % 2, number)
    hand.rule([hand.atom(a, V(1)), guard(V(1), 2, Op.LT), hand.atom(b, V(1), V(2))], [hand.head(out, V(1), V(2))])
    evens = [n for n in reversed(range(count)) if n % 2 == 0]
    odds = [n for n in reversed(range(count)) if n % 2]
    assert [action.args for action in actions(hand.machine().drain())] == [(0, evens[0]), (1, odds[0])]


def test_a_rule_that_consumes_nothing_fires_once_for_each_match() -> None:
    hand = Hand()
    at, seen = hand.sensed("at", AREA), hand.temporary("seen", AREA)
    hand.rule([hand.atom(at, V(1))], [hand.head(seen, V(1))])
    machine = hand.machine()
    area = Symbol("exit")
    assert tell(machine, at, area) == [0]
    assert tell(machine, at, area) == []
    machine.withdraw(2, at, (area,))
    machine.run(2)
    assert tell(machine, at, area) == [0]


def test_a_match_that_an_absent_fact_made_fires_again_when_it_has_come_back() -> None:
    hand = Hand()
    busy, on, idle = hand.sensed("busy", AREA), hand.sensed("on"), hand.temporary("idle")
    hand.rule([hand.atom(on), hand.absent(busy, _)], [hand.head(idle)])
    machine = hand.machine()
    assert tell(machine, on) == [0]
    assert tell(machine, busy, Symbol("a")) == []
    machine.withdraw(2, busy, (Symbol("a"),))
    machine.run(2)
    assert fired(machine.drain()) == [0]


def test_absent_holds_whatever_its_otherwise_unbound_variables() -> None:
    hand = Hand()
    ask, pair, none = hand.temporary("ask"), hand.persistent("pair", INT, INT), hand.temporary("none")
    hand.rule([hand.atom(ask), hand.absent(pair, V(1), V(1))], [hand.head(none)])
    machine = hand.machine()
    tell(machine, pair, 1, 2)
    assert tell(machine, ask) == [0]
    tell(machine, pair, 2, 2)
    assert tell(machine, ask) == []


def test_kept_facts_stay() -> None:
    hand = Hand()
    kept, item, out = hand.temporary("kept"), hand.temporary("item"), hand.temporary("out")
    hand.fact(kept)
    hand.rule([hand.keep(kept), hand.atom(item)], [hand.head(out)])
    machine = hand.machine()
    tell(machine, item)
    tell(machine, item)
    assert machine.facts() == ["kept(@1)", "out(@1)", "out(@1)"]


def test_deriving_a_persistent_fact_again_is_no_insertion() -> None:
    hand = Hand()
    token, known, count = hand.temporary("token"), hand.persistent("known"), hand.temporary("count")
    hand.rule([hand.atom(token)], [hand.head(known)])
    hand.rule([hand.atom(known)], [hand.head(count)])
    machine = hand.machine()
    assert tell(machine, token) == [0, 1]
    assert tell(machine, token) == [0]
    assert machine.facts() == ["!known(@1)", "count(@1)"]


def test_a_comprehension_consumes_each_temporary_fact_by_one_match() -> None:
    hand = Hand()
    go, item, slot, pair = (
        hand.temporary("go"),
        hand.temporary("item", INT),
        hand.temporary("slot", AREA),
        hand.action("pair", INT, AREA),
    )
    for number in (1, 2, 3):
        hand.fact(item, number)
    for name in ("a", "b"):
        hand.fact(slot, name)
    body = [hand.atom(item, V(1)), hand.atom(slot, V(2))]
    hand.rule([hand.atom(go)], [hand.each([V(1), V(2)], body, [hand.head(pair, V(1), V(2))])])
    machine = hand.machine()
    machine.insert(0, go, ())
    machine.run(0)
    assert [action.args for action in actions(machine.drain())] == [(1, "a"), (2, "b")]
    assert machine.facts() == ["item(@1, 3)"]


def test_a_comprehension_sees_the_facts_after_the_body_and_before_the_head() -> None:
    hand = Hand()
    item, seen = hand.temporary("item", INT), hand.action("seen", INT)
    hand.fact(item, 1)
    hand.fact(item, 2)
    listed = hand.each([V(2)], [hand.keep(item, V(2))], [hand.head(seen, V(2))])
    rule = [hand.atom(item, V(1)), guard(V(1), 1, Op.EQ)]
    hand.rule(rule, [hand.head(item, 9), listed])
    machine = hand.machine()
    assert [action.args for action in actions(machine.drain())] == [(2,)]
    assert machine.facts() == ["item(@1, 2)", "item(@1, 9)"]


def test_comprehensions_run_left_to_right() -> None:
    hand = Hand()
    go, item, first, second = (
        hand.temporary("go"),
        hand.temporary("item", INT),
        hand.action("first", INT),
        hand.action("second", INT),
    )
    for number in (1, 2):
        hand.fact(item, number)
    small = [hand.atom(item, V(1)), guard(V(1), 2, Op.LT)]
    hand.rule(
        [hand.atom(go)],
        [
            hand.each([V(1)], small, [hand.head(first, V(1))]),
            hand.each([V(2)], [hand.atom(item, V(2))], [hand.head(second, V(2))]),
        ],
    )
    machine = hand.machine()
    machine.insert(0, go, ())
    machine.run(0)
    assert [(a.predicate, a.args) for a in actions(machine.drain())] == [(first, (1,)), (second, (2,))]


def test_derived_fact_of_another_robot_is_sent_to_it() -> None:
    hand = Hand()
    peer, hello, wave = hand.temporary("peer", ROBOT), hand.temporary("hello", INT), hand.action("wave")
    rule = [hand.head(hello, 5, to=V(1)), hand.want(hello, 6, to=V(1)), hand.head(wave, to=V(1))]
    hand.rule([hand.atom(peer, V(1))], rule)
    machine = hand.machine()
    machine.insert(0, peer, (Robot(4),))
    machine.run(0)
    events = machine.drain()
    assert sent(events) == [(4, hello, (5,))]
    assert GoalSent(4, hello, (6,)) in events
    assert [(action.executor, action.serial) for action in actions(events)] == [(4, 0)]
    assert machine.facts() == []


def test_a_match_with_an_expression_without_value_does_not_fire_and_is_counted_once() -> None:
    hand = Hand()
    by, other, out = hand.temporary("by", INT), hand.temporary("other"), hand.temporary("out", FLOAT)
    hand.rule([hand.atom(by, V(1))], [hand.head(out, code(6, V(1), Op.DIV))])
    hand.rule([hand.keep(by, V(1)), hand.atom(other), bind(V(2), 1, V(1), Op.DIV)], [])
    machine = hand.machine()
    assert tell(machine, by, 0) == []
    assert tell(machine, by, 4) == [0]
    assert machine.expression_failures == 1
    machine.insert(1, other, ())
    machine.run(1)
    failed = [event for event in machine.drain() if isinstance(event, ExpressionFailed)]
    assert [(event.where, event.reason) for event in failed] == [("rule 1", "division by zero")]
    assert machine.facts() == ["by(@1, 0)", "other(@1)", "out(@1, 1.5)"]


def test_where_no_type_is_fixed_values_of_different_kinds_do_not_meet() -> None:
    hand = Hand()
    a, b, out = hand.temporary("a", OPEN), hand.persistent("b", OPEN), hand.temporary("out")
    hand.rule([hand.atom(a, V(1)), hand.atom(b, V(1))], [hand.head(out)])
    machine = hand.machine()
    for value in (True, Robot(1), 1):
        assert tell(machine, b, value) == []
    assert len(machine.facts()) == 3
    assert tell(machine, a, "1") == []
    assert tell(machine, a, Robot(1)) == [0]


def test_only_the_match_that_derives_the_goal_has_the_rank() -> None:
    hand = Hand(textual=True)
    near, place, at = hand.temporary("near", AREA), hand.temporary("place", AREA), hand.temporary("at", AREA)
    for name in ("a", "b", "c"):
        hand.fact(near, name)
    hand.goal(at, "b")
    hand.rule([hand.atom(near, V(1))], [hand.head(place, V(1))])
    hand.rule([hand.atom(near, V(1))], [hand.head(at, V(1))])
    assert hand.machine().facts() == ["at(@1, b)", "place(@1, a)", "place(@1, c)"]


def test_an_action_whose_effect_is_the_goal_has_the_rank_even_if_the_goal_is_sensed() -> None:
    hand = Hand()
    token, at = hand.temporary("token"), hand.sensed("at", AREA)
    go = hand.action("go", AREA, effects=(Effect(at, (code(V(1)),)),))
    hand.fact(token)
    hand.goal(at, "x")
    for name in ("w", "x", "y"):
        hand.rule([hand.atom(token)], [hand.head(go, name)])
    for seed in range(20):
        assert fired(hand.machine(seed=seed).drain()) == [1]


def test_a_goal_without_a_choice_is_achieved_at_once_when_it_holds() -> None:
    hand = Hand()
    at, other = hand.temporary("at", AREA), hand.temporary("other", AREA)
    hand.fact(at, "x")
    hand.goal(at, _)
    hand.goal(other, _)
    machine = hand.machine()
    assert machine.goals() == {"achieved": [["at(@1, _)", 0.0]], "open": ["other(@1, _)"]}
    machine.want(3_000_000_000, other, (Symbol("y"),))
    machine.insert(4_000_000_000, other, (Symbol("y"),))
    assert machine.goals()["achieved"][1:] == [["other(@1, _)", 4.0], ["other(@1, y)", 4.0]]


def test_the_budget_bounds_a_run_and_the_rest_goes_on_at_the_next() -> None:
    hand = Hand()
    a = hand.temporary("a")
    hand.fact(a)
    hand.rule([hand.atom(a)], [hand.head(a)])
    machine = hand.machine(firing_budget=10)
    assert machine.firings == 10
    assert not machine.quiescent
    assert machine.next_wake == 0
    machine.run(7)
    assert (machine.firings, machine.next_wake) == (20, 7)


def test_trace_shows_inserted_and_removed_facts() -> None:
    hand = Hand()
    a, b = hand.temporary("a"), hand.temporary("b")
    hand.fact(a)
    hand.rule([hand.atom(a)], [hand.head(b)])
    events = [event for event in hand.machine(trace=True).drain() if isinstance(event, FactInserted | FactRemoved)]
    assert events == [FactInserted(a, (), 0), FactRemoved(a, (), 0), FactInserted(b, (), 0)]


def test_stated_facts_of_other_robots_are_not_inserted() -> None:
    hand = Hand()
    a = hand.temporary("a", INT)
    hand.fact(a, 1)
    hand.fact(a, 2, owner=1)
    hand.fact(a, 3, owner=2)
    assert hand.machine(robot=2).facts() == ["a(@2, 1)", "a(@2, 3)"]


@pytest.mark.parametrize("computed", [True, False])
def test_a_variable_has_the_value_of_the_first_conjunct_whichever_fact_is_new(computed: bool) -> None:
    hand = Hand()
    given, other, out = hand.persistent("given", INT), hand.persistent("other", OPEN), hand.action("out", OPEN)
    first = [hand.atom(given, V(1)), bind(V(2), V(1), 0, Op.ADD)] if computed else [hand.atom(given, V(2))]
    odd = 2**53 + 1  # a float it is not
    exact = guard(V(2), odd, Op.MUL, odd, Op.EQ)
    hand.rule([*first, hand.atom(other, V(2)), exact], [hand.head(out, V(2))])
    machine = hand.machine()
    assert tell(machine, given, 1) == []
    machine.insert(2, other, (1.0,))
    machine.run(2)
    (action,) = actions(machine.drain())
    assert repr(action.args) == "(1,)"
