"""Violations that are facts: when they are inserted, for whom, and what they start and finish."""

import pytest
from vm_hand import FLOAT, INT, Hand, V, actions

from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionDerived, FactSent, JobMissed, JobStarted

pytestmark = pytest.mark.usefixtures("each_engine")


class Late:
    """``asked(R, N), answered(R, N) within N seconds, else late(R, N)``, and what reads `late`."""

    def __init__(self, to: object = V(0)) -> None:
        hand = self.hand = Hand()
        self.asked = hand.temporary("asked", INT)
        self.answered = hand.temporary("answered", INT)
        self.late = hand.temporary("late", INT)
        self.told = hand.temporary("told", INT)
        hand.asserts(
            hand.keep(self.asked, V(1)), hand.keep(self.answered, V(1)), V(1), hand.head(self.late, V(1), to=to)
        )
        hand.rule([hand.atom(self.late, V(1))], [hand.head(self.told, V(1))])

    def machine(self) -> Machine:
        return self.hand.machine(robot=1)


def test_the_fact_is_inserted_at_the_deadline_and_rules_fire_at_that_instant():
    late = Late()
    machine = late.machine()
    machine.insert(0, late.asked, (2,))
    machine.run(0)
    machine.run(seconds(2) - 1)
    assert machine.facts() == ["asked(@1, 2)"]
    machine.run(seconds(2))
    assert machine.facts() == ["asked(@1, 2)", "told(@1, 2)"]
    assert machine.quiescent
    machine.run(seconds(9))
    assert machine.facts() == ["asked(@1, 2)", "told(@1, 2)"], "once"


def test_in_time_there_is_none():
    late = Late()
    machine = late.machine()
    machine.insert(0, late.asked, (2,))
    machine.insert(seconds(2), late.answered, (2,))
    machine.run(seconds(3))
    assert "told(@1, 2)" not in machine.facts()


def test_another_robots_fact_is_sent_to_it():
    late = Late(to=Robot(7))
    machine = late.machine()
    machine.insert(0, late.asked, (2,))
    machine.run(seconds(2))
    (sent,) = [event for event in machine.drain() if isinstance(event, FactSent)]
    assert (sent.destination, sent.predicate, sent.args) == (7, late.late, (2,))
    assert machine.facts() == ["asked(@1, 2)"]


def test_after_a_call_that_is_late_it_starts_jobs_as_of_its_deadline():
    late = Late()
    hand = late.hand
    alarm = hand.action("alarm")
    done = hand.temporary("done")
    hand.asserts(hand.keep(late.late, V(1)), hand.keep(done), 3, hand.head(alarm), name="second")
    machine = late.machine()
    machine.insert(0, late.asked, (2,))
    machine.run(seconds(4))
    started = [event.job for event in machine.drain() if isinstance(event, JobStarted)]
    assert [job.deadline for job in started] == [seconds(2), seconds(5)]
    machine.run(seconds(5))
    assert [event.predicate for event in actions(machine.drain())] == [alarm]


def test_of_deadlines_at_one_instant_all_are_missed_before_a_fact_of_them_is_inserted():
    hand = Hand()
    begun, first, second = (hand.temporary(name) for name in ("begun", "first", "second"))
    hand.asserts(hand.keep(begun), hand.keep(first), 1, hand.head(second), name="one")
    hand.asserts(hand.keep(begun), hand.keep(second), 1, hand.head(first), name="two")
    machine = hand.machine(robot=1)
    machine.insert(0, begun, ())
    machine.run(seconds(1))
    assert sum(isinstance(event, JobMissed) for event in machine.drain()) == 2
    assert sorted(machine.facts()) == ["begun(@1)", "first(@1)", "second(@1)"]


def test_one_that_starts_its_own_job_anew_at_the_same_instant_ends_each_run():
    hand = Hand()
    again, never = hand.temporary("again"), hand.temporary("never")
    hand.asserts(hand.keep(again), hand.keep(never), 0, hand.head(again), name="loop")
    machine = hand.machine(robot=1)
    machine.insert(0, again, ())
    for count in range(2, 6):
        machine.run(0)
        assert machine.facts() == ["again(@1)"] * count
        assert machine.due == 0


def test_one_without_a_value_is_reported_and_the_others_derived():
    hand = Hand()
    begun = hand.temporary("begun", FLOAT)
    done, late = hand.temporary("done"), hand.temporary("late", INT)
    hand.asserts(hand.atom(begun, V(1)), hand.keep(done), 1, hand.head(late, V(1)), name="one")
    hand.asserts(hand.atom(begun, V(1)), hand.keep(done), 1, hand.head(late, 4), name="two")
    machine = hand.machine(robot=1)
    machine.insert(0, begun, (2.5,))
    machine.run(seconds(1))
    assert machine.facts() == ["begun(@1, 2.5)", "late(@1, 4)"]
    assert not [event for event in machine.drain() if isinstance(event, ActionDerived)]
