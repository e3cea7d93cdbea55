"""The claims of the paper's section III about what programs do, on programs made by hand."""

from collections import Counter
from collections.abc import Callable

import pytest
from vm_hand import AREA, ROBOT, Hand, V, actions, bind, code, fired, guard, sent, started

from rmr.base.time import seconds
from rmr.base.values import Robot, Symbol
from rmr.bytecode import codec
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Effect, Program
from rmr.vm.machine import Machine
from rmr.vm.machine_events import GoalAchieved, JobFinished, JobMissed

SEEDS = 1000


def figure_3(goal: bool = True) -> Program:
    hand = Hand()
    location = hand.temporary("location", AREA)
    hand.fact(location, "s")
    if goal:
        hand.goal(location, "middle")
    for here, there in (("s", "middle"), ("s", "t"), ("middle", "t")):
        hand.rule([hand.atom(location, V(1)), guard(V(1), here, Op.EQ)], [hand.head(location, there)], slots=2)
    return hand.program()


def figure_4() -> Program:
    hand = Hand()
    location = hand.temporary("location", AREA)
    moveto = hand.action("moveto", AREA, effects=(Effect(location, (code(V(1)),)),))
    hand.fact(location, "s")
    hand.goal(location, "middle")
    for here, there in (("s", "middle"), ("s", "t"), ("middle", "t")):
        hand.rule([hand.atom(location, V(1)), guard(V(1), here, Op.EQ)], [hand.head(moveto, there)], slots=2)
    return hand.program()


def ran(program: Program, seed: int, robot: int = 1) -> Machine:
    return started(program, robot, seed)


def drive(machine: Machine) -> list[str]:
    """Carry out every action; return where the robot went."""
    went: list[str] = []
    while todo := actions(machine.drain()):
        for action in todo:
            went.append(str(action.args[0]))
            machine.complete(0, action.serial, True)
        machine.run(0)
    return went


def test_iii_b_figure_3_always_passes_by_middle() -> None:
    program = figure_3()
    for seed in range(SEEDS):
        machine = ran(program, seed)
        assert fired(machine.drain()) == [0, 2]
        assert machine.facts() == ["location(@1, t)"]
        assert machine.goals() == {"achieved": [["location(@1, middle)", 0.0]], "open": []}


def test_iii_b_without_the_goal_figure_3_passes_by_middle_only_sometimes() -> None:
    program = figure_3(goal=False)
    ways = Counter(tuple(fired(ran(program, seed).drain())) for seed in range(SEEDS))
    assert set(ways) == {(0, 2), (1,)}
    assert 400 < ways[(1,)] < 600


def test_iii_c_figure_4_always_passes_by_middle_with_actions() -> None:
    program = figure_4()
    for seed in range(SEEDS):
        assert drive(ran(program, seed)) == ["middle", "t"]


def test_iii_c_a_derived_action_is_not_stored_and_takes_the_location_with_it() -> None:
    machine = ran(figure_4(), 1)
    (action,) = actions(machine.drain())
    assert machine.facts() == []
    machine.complete(0, action.serial, True)
    assert machine.facts() == ["location(@1, middle)"]


@pytest.mark.parametrize("program", [figure_3, figure_4])
def test_iv_a_the_figures_take_at_most_256_octets(program: Callable[[], Program]) -> None:
    assert len(codec.encode(program(), debug=False)) <= 256


def test_iii_b_temporary_facts_are_consumed_persistent_ones_never() -> None:
    hand = Hand()
    number, token, seen = hand.persistent("number", AREA), hand.temporary("token"), hand.temporary("seen", AREA)
    hand.fact(number, "one")
    for _ in range(3):
        hand.fact(token)
    hand.rule([hand.atom(number, V(1)), hand.atom(token)], [hand.head(seen, V(1))])
    machine = hand.machine()
    assert machine.facts() == ["!number(@1, one)", *["seen(@1, one)"] * 3]


def test_iii_d_all_of_the_head_is_derived_if_all_of_the_body_is_satisfied() -> None:
    hand = Hand()
    p, q, r, s = (hand.temporary(name) for name in "pqrs")
    hand.fact(p)
    hand.rule([hand.atom(p), hand.atom(q)], [hand.head(r), hand.head(s)])
    machine = hand.machine()
    assert machine.facts() == ["p(@1)"]
    machine.insert(0, q, ())
    machine.run(0)
    assert machine.facts() == ["r(@1)", "s(@1)"]


def test_iii_d_the_comprehension_reaches_every_neighbour() -> None:
    hand = Hand()
    online, edge, ready = hand.temporary("online", AREA), hand.persistent("edge", ROBOT), hand.temporary("ready", ROBOT)
    for other in (2, 3, 5):
        hand.fact(edge, Robot(other), owner=1)
    hand.fact(edge, Robot(4), owner=2)
    told = hand.each([V(2)], [hand.atom(edge, V(2))], [hand.head(ready, V(0), to=V(2))])
    hand.rule([hand.atom(online, V(1))], [told])
    machine = hand.machine()
    machine.insert(0, online, (Symbol("l"),))
    machine.run(0)
    assert sent(machine.drain()) == [(other, ready, (Robot(1),)) for other in (2, 3, 5)]
    assert machine.facts() == [f"!edge(@1, @{other})" for other in (2, 3, 5)]


def section_iii_e() -> tuple[Hand, int, int]:
    hand = Hand()
    offline, online = hand.temporary("offline", AREA), hand.temporary("online", AREA)
    broadcast = hand.action("broadcast")
    hand.asserts(hand.atom(offline, V(1)), hand.atom(online, V(1)), 10, hand.head(broadcast))
    return hand, offline, online


def test_iii_e_a_job_that_ends_by_its_deadline_derives_nothing() -> None:
    hand, offline, online = section_iii_e()
    machine = hand.machine()
    machine.insert(seconds(1), offline, (Symbol("l1"),))
    machine.insert(seconds(11), online, (Symbol("l1"),))
    machine.run(seconds(30))
    events = machine.drain()
    assert actions(events) == []
    (job,) = machine.jobs
    assert JobFinished(job) in events
    assert (job.text, job.start, job.finish, job.missed) == ("online(@1, l1)", seconds(1), seconds(11), False)


def test_iii_e_a_job_that_does_not_derives_the_violation_once_and_on_time() -> None:
    hand, offline, online = section_iii_e()
    machine = hand.machine()
    machine.insert(seconds(1), offline, (Symbol("l1"),))
    machine.insert(seconds(2), online, (Symbol("l2"),))
    machine.run(seconds(2))
    assert machine.next_wake == seconds(11)
    machine.drain()
    machine.run(seconds(11))
    (job,) = machine.jobs
    missed, broadcast = machine.drain()
    assert missed == JobMissed(job)
    assert broadcast in actions([broadcast])
    machine.insert(seconds(13), online, (Symbol("l1"),))
    machine.run(seconds(99))
    assert actions(machine.drain()) == []
    assert (job.missed, job.deadline, job.finish) == (True, seconds(11), seconds(13))


def test_iii_e_time_counts_from_the_last_time_that_the_start_held() -> None:
    hand, offline, _online = section_iii_e()
    machine = hand.machine()
    machine.insert(seconds(1), offline, (Symbol("l1"),))
    machine.insert(seconds(8), offline, (Symbol("l1"),))
    machine.run(seconds(17))
    assert actions(machine.drain()) == []
    assert machine.next_wake == seconds(18)
    assert len(machine.jobs) == 1


def test_iii_a_boolean_expressions_decide_whether_a_rule_is_satisfied() -> None:
    hand = Hand()
    area, small = hand.temporary("area", AREA), hand.temporary("other", AREA)
    hand.fact(area, "s")
    hand.rule([hand.atom(area, V(1)), guard(V(1), "t", Op.EQ, Op.NOT), bind(V(2), V(1))], [hand.head(small, V(2))])
    assert hand.machine().facts() == ["other(@1, s)"]


def test_iii_b_a_goal_is_reported_when_it_is_achieved() -> None:
    machine = ran(figure_3(), 5)
    achieved = [event for event in machine.drain() if isinstance(event, GoalAchieved)]
    assert [(event.predicate, event.args, event.at) for event in achieved] == [(0, (Symbol("middle"),), 0)]
