"""What a machine carries beside its rules and facts is there only if it is used."""

import tracemalloc
from collections.abc import Iterable

import pytest
from vm_hand import INT, Hand, V, actions

from rmr.base.streams import Choices
from rmr.base.time import Instant, seconds
from rmr.base.values import Robot
from rmr.bytecode.program import Program
from rmr.vm import underway
from rmr.vm.machine import Machine
from rmr.vm.store import Args

MACHINES = 100
CHOICES = Choices("parts")


class Bare(Machine):
    """A machine that keeps no facts and fires no rules."""

    __slots__ = ("busy",)

    def __init__(self, program: Program, robot: int) -> None:
        super().__init__(program, robot, CHOICES)
        self.busy = False

    def each(self, predicate: int) -> Iterable[Args]:
        return ()

    def dated(self, predicate: int) -> Iterable[tuple[Args, Instant]]:
        return ()

    def _insert(self, now: Instant, predicate: int, args: Args) -> None:
        self._inserted(now, predicate, args)

    def _withdraw(self, now: Instant, predicate: int, args: Args) -> None:
        return

    def take_out(self, now: Instant, predicate: int) -> list[Args]:
        return []

    def _fire(self, now: Instant) -> None:
        return

    def _goals_changed(self, predicate: int) -> None:
        return


def octets(program: Program) -> float:
    """Return how many octets one of many machines takes before anything has happened to it."""
    machines: list[Machine | None] = [None] * (MACHINES + 1)
    machines[0] = Bare(program, 0)  # what all share
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for number in range(1, MACHINES + 1):
            machines[number] = Bare(program, number)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return (after - before) / MACHINES


def everything() -> tuple[Hand, int, int]:
    """A goal, a time assertion of each robot and one of robot 7, whose finish is another's."""
    hand = Hand()
    begun, done = hand.temporary("begun", INT), hand.temporary("done", INT)
    alarm = hand.head(hand.action("alarm"))
    hand.goal(done, 5)
    hand.asserts(hand.atom(begun, V(1)), hand.atom(done, V(1)), 3, alarm)
    hand.asserts(hand.atom(done, V(1)), hand.atom(begun, V(1)), 3, alarm, robot=7, finisher=Robot(8))
    return hand, begun, done


def test_a_machine_to_which_nothing_has_happened_takes_little() -> None:
    hand, *_ = everything()
    assert octets(hand.program()) < 500


def test_a_machine_has_no_dictionary() -> None:
    hand, begun, done = everything()
    machine = hand.machine()
    machine.insert(1, begun, (5,))
    machine.insert(2, done, (5,))
    for each in (machine, machine._goals, machine._assertions, machine._watches, machine._under_way):
        with pytest.raises(AttributeError):
            each.anything = 1  # type: ignore[union-attr]


def test_queries_of_a_machine_without_jobs_and_goals_are_empty() -> None:
    hand, begun, _ = everything()
    machine = Bare(hand.program(), 3)
    assert (machine.jobs, machine.serves(2, ()), machine.dropped, machine.quiescent) == ([], [], {}, True)
    assert machine.goals() == {"achieved": [], "open": []}
    assert not machine.complete(1, 1, True)
    assert not machine.finish_seen(1, 8, 0, (5,), 1)
    machine.insert(1, begun, (5,))
    assert [job.text for job in machine.jobs] == ["done(@3, 5)"]
    machine.run(seconds(4))
    assert [action.executor for action in actions(machine.drain())] == [3]


@pytest.mark.parametrize(("robot", "jobs"), [(7, 2), (8, 1), (9, 1)])
def test_robots_named_in_an_assertion_get_their_own_job_tables(robot: int, jobs: int) -> None:
    hand, begun, done = everything()
    program = hand.program()
    affairs, others = Bare(program, robot)._affairs, Bare(program, 10)._affairs
    assert len(affairs.mine) == jobs
    assert affairs.concerned == {begun, done}
    assert affairs.asked == ({begun} if robot == 8 else set())
    assert (affairs is others) is (robot == 9)


def test_the_oldest_action_is_forgotten_in_whichever_order_others_have_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(underway, "ACTIONS_MAX", 2)
    hand = Hand()
    go = hand.action("go")
    machine = hand.machine()
    for _ in range(3):
        machine.derive_action(1, go, ())
    assert [machine.complete(2, serial, True) for serial in (1, 2)] == [False, True]
    for _ in range(2):
        machine.derive_action(3, go, ())
    assert [machine.complete(4, serial, True) for serial in (3, 4, 5)] == [False, True, True]
    assert machine.dropped == {"actions": 2}
