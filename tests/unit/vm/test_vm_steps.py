"""Ordered steps (``a(R) then b(R)``): when each is derived, what a failure costs, and steps on other robots."""

import pytest
from vm_hand import AREA, INT, ROBOT, Hand, V, actions, code, guard, sent

from rmr.base.time import seconds
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Derived, Effect
from rmr.vm import underway
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionDerived, BoundReached, GoalSent

pytestmark = pytest.mark.usefixtures("each_engine")


class Shop:
    """A robot that knows how to fetch and bring; ``order(R, X)`` starts the steps that a test gives."""

    def __init__(self) -> None:
        self.hand = Hand()
        self.order = self.hand.temporary("order", AREA)
        self.has = self.hand.temporary("has", AREA)
        self.dropped = self.hand.temporary("dropped", AREA)
        self.note = self.hand.temporary("note", AREA)
        effect, failed = Effect(self.has, (code(V(1)),)), Effect(self.dropped, (code(V(1)),))
        self.fetch = self.hand.action("fetch", AREA, effects=(effect,), failed=(failed,))
        self.bring = self.hand.action("bring", AREA)

    def steps(self, *steps: Derived) -> Machine:
        self.hand.rule([self.hand.atom(self.order, V(1))], [self.hand.then(*steps)])
        machine = self.hand.machine()
        machine.insert(0, self.order, (Symbol("x"),))
        machine.run(0)
        return machine


def derived(machine: Machine) -> list[tuple[int, Value]]:
    return [(action.predicate, action.args[0]) for action in actions(machine.drain())]


def one(machine: Machine) -> ActionDerived:
    (action,) = actions(machine.drain())
    return action


def test_an_action_is_derived_when_the_one_before_it_is_complete() -> None:
    shop = Shop()
    machine = shop.steps(shop.hand.head(shop.fetch, V(1)), shop.hand.head(shop.bring, V(1)))
    fetch = one(machine)
    assert fetch.predicate == shop.fetch
    machine.run(seconds(5))
    assert actions(machine.drain()) == []
    assert machine.complete(seconds(6), fetch.serial, True)
    assert machine.facts() == ["has(@1, x)"], "the effect comes before the next step"
    bring = one(machine)
    assert (bring.predicate, bring.args) == (shop.bring, (Symbol("x"),))
    machine.complete(seconds(7), bring.serial, True)
    assert machine.drain() == []


def test_facts_and_goals_are_complete_at_once() -> None:
    shop = Shop()
    head, want = shop.hand.head, shop.hand.want
    machine = shop.steps(
        head(shop.note, "first"),
        want(shop.note, "wanted"),
        head(shop.fetch, V(1)),
        head(shop.note, "second"),
        head(shop.note, "third"),
        head(shop.bring, V(1)),
    )
    assert machine.facts() == ["note(@1, first)"]
    assert machine.goals()["open"] == ["note(@1, wanted)"]
    machine.complete(1, one(machine).serial, True)
    assert machine.facts() == ["has(@1, x)", "note(@1, first)", "note(@1, second)", "note(@1, third)"]
    assert one(machine).predicate == shop.bring


def test_a_fact_or_goal_sent_to_another_robot_is_complete_at_once() -> None:
    shop = Shop()
    head, want = shop.hand.head, shop.hand.want
    machine = shop.steps(head(shop.note, V(1), to=Robot(4)), want(shop.note, V(1), to=Robot(5)), head(shop.bring, V(1)))
    events = machine.drain()
    assert sent(events) == [(4, shop.note, (Symbol("x"),))]
    assert GoalSent(5, shop.note, (Symbol("x"),)) in events
    assert [action.predicate for action in actions(events)] == [shop.bring]


def test_if_a_step_fails_its_else_effect_stands_and_the_rest_is_dropped() -> None:
    shop = Shop()
    machine = shop.steps(shop.hand.head(shop.fetch, V(1)), shop.hand.head(shop.bring, V(1)))
    assert machine.complete(1, one(machine).serial, False)
    machine.run(2)
    assert actions(machine.drain()) == []
    assert machine.facts() == ["dropped(@1, x)"]
    assert machine.dropped == {}, "a failure is no shortage of room"


def test_all_arguments_are_worked_out_when_the_rule_fires() -> None:
    hand = Hand()
    n, out, wait = hand.temporary("n", INT), hand.temporary("out", INT), hand.action("wait", INT)
    hand.fact(n, 0)
    hand.fact(n, 2)
    last = hand.head(out, code(6, V(1), Op.DIV, "call:floor"))
    hand.rule([hand.atom(n, V(1))], [hand.then(hand.head(wait, V(1)), last)])
    machine = hand.machine()
    assert machine.expression_failures == 1
    assert machine.facts() == ["n(@1, 0)"]
    machine.complete(0, one(machine).serial, True)
    assert machine.facts() == ["n(@1, 0)", "out(@1, 3)"]


def test_several_step_chains_run_concurrently() -> None:
    shop = Shop()
    machine = shop.steps(shop.hand.head(shop.fetch, V(1)), shop.hand.head(shop.bring, V(1)))
    machine.insert(1, shop.order, (Symbol("y"),))
    machine.run(1)
    first, second = actions(machine.drain())
    machine.complete(2, second.serial, True)
    assert derived(machine) == [(shop.bring, "y")]
    machine.complete(3, first.serial, True)
    assert derived(machine) == [(shop.bring, "x")]


def test_an_action_without_steps_behind_it_is_reported_by_no_other_robot() -> None:
    shop = Shop()
    machine = shop.steps(shop.hand.head(shop.note, V(1)), shop.hand.head(shop.fetch, V(1), to=Robot(4)))
    assert one(machine).serial == 0
    assert not machine.complete(0, 0, True)


def remote() -> tuple[Shop, Machine, ActionDerived]:
    """Robot 1 has robot 4 fetch and brings then."""
    shop = Shop()
    machine = shop.steps(shop.hand.head(shop.fetch, V(1), to=Robot(4)), shop.hand.head(shop.bring, V(1)))
    return shop, machine, one(machine)


def test_another_robot_reports_the_end_of_its_step() -> None:
    shop, machine, fetch = remote()
    assert (fetch.executor, fetch.origin) == (4, None)
    assert fetch.serial > 0
    executor = shop.hand.machine(robot=4)
    executor.derive_action(1, fetch.predicate, fetch.args, (1, fetch.serial))
    taken = one(executor)
    assert (taken.executor, taken.origin) == (4, (1, fetch.serial))
    assert executor.complete(2, taken.serial, True)
    assert executor.facts() == ["has(@4, x)"]
    assert machine.complete(3, fetch.serial, True, executor=4)
    assert machine.facts() == [], "the effect is the executor's"
    assert derived(machine) == [(shop.bring, "x")]


def test_a_failure_elsewhere_drops_the_rest_here() -> None:
    _shop, machine, fetch = remote()
    assert machine.complete(1, fetch.serial, False)
    assert not machine.complete(1, fetch.serial, True)
    assert (actions(machine.drain()), machine.facts()) == ([], [])


def test_action_end_reported_by_a_robot_that_does_not_execute_it_is_ignored() -> None:
    shop, machine, fetch = remote()
    assert not machine.complete(1, fetch.serial, True, executor=5)
    assert not machine.complete(1, fetch.serial + 1, True, executor=4)
    machine.derive_action(1, shop.fetch, (Symbol("y"),))
    own = one(machine)
    assert not machine.complete(1, own.serial, True, executor=4)
    assert machine.complete(1, own.serial, True)
    assert machine.complete(1, fetch.serial, True, executor=4)


def test_waiting_step_chains_are_bounded_and_dropped_ones_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(underway, "CHAINS_MAX", 2)
    shop = Shop()
    machine = shop.steps(shop.hand.head(shop.fetch, V(1)), shop.hand.head(shop.bring, V(1)))
    for name in ("y", "z", "w"):
        machine.insert(1, shop.order, (Symbol(name),))
    machine.run(1)
    events = machine.drain()
    assert [event for event in events if isinstance(event, BoundReached)] == [BoundReached("chains", 2, 1)]
    assert machine.dropped == {"chains": 2}
    for action in actions(events):
        assert machine.complete(2, action.serial, True)
    assert machine.facts() == [f"has(@1, {name})" for name in "wxyz"], "the actions themselves are still awaited"
    assert derived(machine) == [(shop.bring, "z"), (shop.bring, "w")]


def test_another_robots_action_is_awaited_no_longer_than_its_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(underway, "CHAINS_MAX", 1)
    shop, machine, fetch = remote()
    machine.insert(1, shop.order, (Symbol("y"),))
    machine.run(1)
    assert not machine.complete(1, fetch.serial, True)
    machine.complete(1, one(machine).serial, True)
    assert derived(machine) == [(shop.bring, "y")]


def test_actions_under_way_are_bounded_with_their_chains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(underway, "ACTIONS_MAX", 1)
    shop = Shop()
    machine = shop.steps(shop.hand.head(shop.fetch, V(1)), shop.hand.head(shop.bring, V(1)))
    first = one(machine)
    machine.insert(1, shop.order, (Symbol("y"),))
    machine.run(1)
    second = one(machine)
    assert not machine.complete(1, first.serial, True)
    assert machine.complete(1, second.serial, True)
    assert machine.dropped == {"actions": 1}


def test_the_way_to_a_goal_may_lead_through_a_later_step() -> None:
    hand = Hand()
    token, g, idle = hand.temporary("token"), hand.temporary("g"), hand.temporary("idle")
    go = hand.action("go", ROBOT)
    hand.fact(token)
    hand.goal(g)
    hand.rule([hand.atom(token)], [hand.head(idle)])
    hand.rule([hand.atom(token)], [hand.then(hand.head(go, V(0)), hand.head(g))])
    hand.rule([hand.atom(token), guard(True)], [hand.head(idle)])
    for seed in range(20):
        machine = hand.machine(seed=seed)
        machine.complete(0, one(machine).serial, True)
        assert machine.facts() == ["g(@1)"]
