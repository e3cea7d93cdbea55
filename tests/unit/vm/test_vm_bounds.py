"""A program that makes ever more of anything costs its robot some of the program, and never its memory."""

import pytest
from vm_hand import INT, Hand, V, code

from rmr.bytecode.limits import CONJUNCTS_MAX
from rmr.bytecode.opcodes import Op
from rmr.vm import goals, machine
from rmr.vm.events import BoundReached


def test_facts_that_multiply_are_dropped_beyond_the_bound_and_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "FACTS_MAX", 50)
    hand = Hand()
    a = hand.temporary("a")
    hand.fact(a)
    hand.rule([hand.atom(a)], [hand.head(a), hand.head(a)])
    robot = hand.machine(firing_budget=200)
    assert len(robot.facts()) == 50
    assert robot.dropped == {"facts": 200 - 49}
    assert [event for event in robot.drain() if isinstance(event, BoundReached)] == [BoundReached("facts", 50, 0)]


def test_goals_that_multiply_are_dropped_beyond_the_bound_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "GOALS_MAX", 5)
    hand = Hand()
    a, g = hand.temporary("a", INT), hand.temporary("g", INT)
    hand.fact(a, 0)
    hand.rule([hand.atom(a, V(1))], [hand.head(a, code(V(1), 1, Op.ADD)), hand.want(g, V(1))])
    robot = hand.machine(firing_budget=20)
    assert robot.goals()["open"] == [f"g(@1, {number})" for number in range(5)]
    assert robot.dropped == {"goals": 15}
    robot.insert(0, g, (3,))
    robot.want(0, g, (99,))
    assert "g(@1, 99)" in robot.goals()["open"]


def test_a_body_of_as_many_conjuncts_as_are_possible_is_matched() -> None:
    hand = Hand()
    a, b = hand.temporary("a"), hand.temporary("b")
    for _ in range(CONJUNCTS_MAX):
        hand.fact(a)
    hand.rule([hand.atom(a)] * CONJUNCTS_MAX, [hand.head(b)])
    assert hand.machine().facts() == ["b(@1)"]


def test_a_body_of_as_many_kept_facts_as_are_possible_is_matched_once() -> None:
    hand = Hand()
    a, b = hand.persistent("a"), hand.temporary("b")
    hand.fact(a)
    hand.rule([hand.atom(a)] * CONJUNCTS_MAX, [hand.head(b)])
    assert hand.machine().facts() == ["!a(@1)", "b(@1)"]
