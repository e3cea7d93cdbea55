"""What a robot keeps is bounded: what comes beyond is dropped, counted and told once; and where failures stand."""

from dataclasses import replace

import pytest
from vm_hand import INT, Hand, V, actions, code, fired, guard, machine_of, started

from rmr.bytecode.limits import CONJUNCTS_MAX
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Debug, Operator, Place, Type
from rmr.vm import derive, failures, goals, machine, match, once
from rmr.vm.failures import rule_place
from rmr.vm.machine_events import BoundReached, ExpressionFailed, VmEvent

pytestmark = pytest.mark.usefixtures("each_engine")


def reached(events: list[VmEvent]) -> list[tuple[str, int]]:
    return [(event.what, event.bound) for event in events if isinstance(event, BoundReached)]


def multiplying() -> Hand:
    """``a(R) -o a(R), a(R).``"""
    hand = Hand()
    a = hand.temporary("a")
    hand.fact(a)
    hand.rule([hand.atom(a)], [hand.head(a), hand.head(a)])
    return hand


def test_fact_limit_bounds_a_multiplying_program_and_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "FACTS_MAX", 20)
    robot = multiplying().machine(firing_budget=50)
    assert len(robot.facts()) == 20
    assert reached(robot.drain()) == [("facts", 20)]
    assert robot.dropped == {"facts": 50 - 19}
    robot.run(1)
    assert (len(robot.facts()), reached(robot.drain())) == (20, [])
    assert robot.dropped == {"facts": 100 - 19}


def test_fact_dropped_by_the_limit_neither_achieves_a_goal_nor_starts_a_job(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "FACTS_MAX", 1)
    hand = Hand()
    a, alarm = hand.temporary("a", INT), hand.action("alarm")
    hand.fact(a, 1)
    hand.goal(a, 2)
    hand.asserts(hand.atom(a, 2), hand.atom(a, 3), 1, hand.head(alarm))
    robot = hand.machine()
    robot.insert(0, a, (2,))
    assert (robot.facts(), robot.goals()["open"], robot.jobs) == (["a(@1, 1)"], ["a(@1, 2)"], [])


def test_a_fact_of_a_set_that_holds_already_is_not_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "FACTS_MAX", 1)
    hand = Hand()
    p = hand.persistent("p", INT)
    hand.fact(p, 1)
    robot = hand.machine()
    robot.insert(0, p, (1,))
    assert robot.dropped == {}


def test_there_is_room_again_when_facts_are_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "FACTS_MAX", 2)
    hand = Hand()
    s = hand.sensed("s", INT)
    robot = hand.machine()
    for number in range(3):
        robot.insert(0, s, (number,))
    robot.withdraw(0, s, (0,))
    robot.insert(0, s, (3,))
    assert robot.held(s) == [(1,), (3,)]


NUMBERS = Type(Base.LIST, element=INT)


def test_facts_that_grow_are_dropped_once_all_together_are_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "FACTS_LENGTH_MAX", 100)
    hand = Hand()
    a, b = hand.temporary("a", NUMBERS), hand.temporary("b", NUMBERS)
    hand.fact(a, ())
    hand.rule([hand.atom(a, V(1))], [hand.head(a, code(V(1), (1,), Op.ADD)), hand.head(b, V(1))])
    robot = hand.machine(firing_budget=50)
    assert reached(robot.drain()) == [("lengths", 100)]
    assert robot.dropped["lengths"] > 0
    assert 100 <= sum(len(args[0]) for table in (a, b) for args in robot.held(table)) <= 2 * 100


def test_consumed_facts_make_room_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "FACTS_LENGTH_MAX", 10)
    hand = Hand()
    a = hand.temporary("a", NUMBERS)
    hand.fact(a, (1,) * 10)
    hand.rule([hand.atom(a, V(1))], [hand.head(a, V(1))])
    robot = hand.machine(firing_budget=50)
    assert robot.firings == 50
    assert robot.dropped == {}


def test_open_goals_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "GOALS_MAX", 2)
    hand = Hand()
    n, g = hand.temporary("n", INT), hand.temporary("g", INT)
    for number in range(5):
        hand.fact(n, number)
    hand.rule([hand.atom(n, V(1))], [hand.want(g, V(1))])
    robot = hand.machine()
    assert robot.goals()["open"] == ["g(@1, 0)", "g(@1, 1)"]
    assert robot.dropped == {"goals": 3}
    robot.insert(0, g, (0,))
    robot.want(0, g, (4,))
    assert robot.goals()["open"] == ["g(@1, 1)", "g(@1, 4)"]


def test_a_body_of_as_many_conjuncts_as_are_possible_is_matched() -> None:
    hand = Hand()
    a, b = hand.temporary("a"), hand.temporary("b")
    for _ in range(CONJUNCTS_MAX):
        hand.fact(a)
    hand.rule([hand.atom(a)] * CONJUNCTS_MAX, [hand.head(b)])
    assert hand.machine().facts() == ["b(@1)"]


def test_a_body_of_as_many_persistent_facts_as_are_possible_is_matched_once_whenever_they_come() -> None:
    hand = Hand()
    a, b = hand.persistent("a", INT), hand.temporary("b")
    hand.fact(a, 0)
    hand.rule([hand.atom(a, V(1))] * CONJUNCTS_MAX, [hand.head(b)])
    robot = hand.machine()
    assert robot.facts() == ["!a(@1, 0)", "b(@1)"]
    robot.insert(0, a, (1,))
    robot.run(0)
    assert robot.facts() == ["!a(@1, 0)", "!a(@1, 1)", "b(@1)", "b(@1)"]


def dividing() -> tuple[Hand, int, int]:
    """``n(R, X), tick(R), 1 / X > 0 -o hit(R, X).``"""
    hand = Hand()
    n, tick, hit = hand.temporary("n", INT), hand.sensed("tick"), hand.action("hit", INT)
    hand.rule([hand.atom(n, V(1)), hand.atom(tick), guard(code(1)[0], V(1), Op.DIV, 0, Op.GT)], [hand.head(hit, V(1))])
    return hand, n, tick


def test_rule_failure_is_reported_once_though_its_match_is_tried_again() -> None:
    hand, n, tick = dividing()
    robot = hand.machine()
    robot.insert(0, n, (0,))
    for now in range(5):
        robot.insert(now, tick, ())
        robot.insert(now, n, (0,))
        robot.run(now)
    assert robot.expression_failures == 6


def test_memory_of_reported_failures_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(failures, "FAILURES_MAX", 3)
    hand, n, tick = dividing()
    robot = hand.machine()
    robot.insert(0, tick, ())
    for _ in range(5):
        robot.insert(0, n, (0,))
    robot.run(0)
    events = robot.drain()
    assert len([event for event in events if isinstance(event, ExpressionFailed)]) == 3
    assert (robot.expression_failures, robot.dropped, reached(events)) == (3, {"failures": 2}, [("failures", 3)])


def test_failures_are_reported_again_after_eviction_of_earlier_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(failures, "FAILURES_MAX", 3)
    hand = Hand()
    s, out = hand.sensed("s", INT), hand.action("out", INT)
    hand.rule([hand.atom(s, V(1))], [hand.head(out, code(1, V(1), Op.MOD))])
    robot = hand.machine()
    for now in range(10):
        robot.insert(now, s, (0,))
        robot.run(now)
        robot.withdraw(now, s, (0,))
        robot.run(now)
    assert robot.expression_failures == 10


def test_matches_that_wait_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(once, "MATCHES_MAX", 3)
    hand = Hand()
    p, q, out = hand.persistent("p", INT), hand.persistent("q", INT), hand.action("out", INT, INT)
    hand.rule([hand.atom(p, V(1)), hand.atom(q, V(2))], [hand.head(out, V(1), V(2))])
    robot = machine_of(hand.program())
    for number in range(5):
        robot.insert(0, p, (number,))
    robot.insert(0, q, (0,))
    robot.run(0)
    assert len(actions(robot.drain())) == 5, "looked for as they are needed, none is lost"
    robot.insert(0, q, (1,))
    robot.run(0)
    events = robot.drain()
    assert [action.args for action in actions(events)] == [(number, 1) for number in range(3)]
    assert (reached(events), set(robot.dropped)) == ([("matches", 3)], {"matches"})


def test_matches_that_an_absent_fact_allows_are_looked_for_again_and_none_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(once, "MATCHES_MAX", 3)
    hand = Hand()
    p, stop, out = hand.persistent("p", INT), hand.sensed("stop"), hand.action("out", INT)
    hand.rule([hand.atom(p, V(1)), hand.absent(stop)], [hand.head(out, V(1))])
    robot = hand.machine()
    for number in range(8):
        robot.insert(0, p, (number,))
    robot.run(0)
    assert [action.args for action in actions(robot.drain())] == [(number,) for number in range(8)]
    assert robot.dropped == {}


@pytest.mark.parametrize("consumes", [False, True])
def test_fruitless_search_ends_at_the_budget_and_is_reported(consumes: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a bound, three conjuncts over 600 facts take minutes within one call."""
    monkeypatch.setattr(match, "LOOKS_MAX", 100)
    hand = Hand()
    p, go, out = hand.persistent("p", INT), hand.temporary("go"), hand.action("out")
    for number in range(10):
        hand.fact(p, number)
    hand.fact(go)
    never = guard(V(1), V(2), Op.ADD, V(3), Op.ADD, -1, Op.EQ)
    atoms = [hand.atom(go) if consumes else hand.keep(go), *(hand.atom(p, V(slot)) for slot in (1, 2, 3))]
    hand.rule([*atoms, never], [hand.head(out)])
    robot = hand.machine()
    told = [each.reason for each in robot.drain() if isinstance(each, ExpressionFailed)]
    assert told == ["the search for matches was given up after 100 facts"]
    assert robot.quiescent


@pytest.mark.medium
def test_many_persistent_facts_cost_no_more_than_their_number() -> None:
    """Each firing of a rule that consumes nothing once looked at all its matches again: 9 s where this takes 0.1 s."""
    hand = Hand(textual=True)
    p, q, r, out = hand.persistent("p", INT), hand.persistent("q", INT), hand.temporary("r", INT), hand.action("o", INT)
    hand.rule([hand.atom(p, V(1))], [hand.head(q, V(1))])
    hand.rule([hand.atom(p, V(1)), hand.atom(q, V(1))], [hand.head(r, V(1))])
    hand.rule([hand.atom(q, V(1)), hand.keep(r, V(1))], [hand.head(out, V(1))])
    robot = machine_of(hand.program(), firing_budget=10**6)
    for number in range(3000):
        robot.insert(0, p, (number,))
    robot.run(0)
    events = robot.drain()
    assert len(fired(events)) == 9000
    assert [action.args[0] for action in actions(events)] == list(range(3000))


def test_a_failure_names_the_rules_place_in_the_source_or_its_number() -> None:
    hand = Hand()
    a, out = hand.temporary("a"), hand.temporary("out", INT)
    hand.fact(a)
    hand.rule([hand.atom(a)], [hand.head(out, code(1, 0, Op.MOD))])
    program = hand.program()
    placed = replace(program, debug=Debug(rules=(Place("corridor.rmr", 12, 3),)))
    for each, where in ((program, "rule 0"), (placed, "rule at corridor.rmr:12")):
        robot = started(each)
        assert [event.where for event in robot.drain() if isinstance(event, ExpressionFailed)] == [where]
        assert rule_place(each, 0) == where


@pytest.mark.parametrize(("facts", "fires"), [(3, True), (4, False)])
def test_a_firing_with_too_many_matches_does_not_happen(
    facts: int, fires: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(derive, "MATCHES_MAX", 2 * 3)
    hand = Hand()
    go, n, out = hand.temporary("go"), hand.temporary("n", INT), hand.temporary("out", INT)
    for number in range(facts):
        hand.fact(n, number)
    hand.fact(go)
    each = hand.each([V(1)], [hand.keep(n, V(1))], [hand.head(out, V(1))])
    count = hand.fold(Operator.COUNT, None, V(2), [hand.keep(n, V(1))], hand.head(out, V(2)), V(1))
    hand.rule([hand.atom(go)], [each, count])
    robot = hand.machine()
    failed = [each.reason for each in robot.drain() if isinstance(each, ExpressionFailed)]
    assert failed == ([] if fires else ["more than 6 matches in one firing"])
    assert len(robot.held(out)) == (facts + 1 if fires else 0)
    assert len(robot.held(go)) == (0 if fires else 1)
