"""Deadlines of deliveries: what serves a time-bounded job inherits its deadline, on every robot that it passes.

A job is at its robot the reason for what can follow from its start fact and lead to its finish fact (`Reach`). What
leaves the robot for that reason bears the job's deadline on the air. At the receiver whatever can follow from it bears
it again. A robot asked to report a finish fact gives the deadline to what can lead to that fact.

`can follow` is read off the rules by predicates alone, without values: facts of one predicate that serve several jobs
all inherit the earliest deadline among them. Too early a deadline costs order, never correctness.
"""

from collections.abc import Iterator
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.bytecode.program import Program
from rmr.node.payloads import Delivery, DeliveryRole
from rmr.vm.job import TimedJob
from rmr.vm.machine import Machine
from rmr.vm.predicate_reach import reach_of

INHERITED_MAX: Final = 256
"""Deadlines that have arrived and are remembered; beyond that the latest one is forgotten."""


class Deadlines:
    """The deadlines that one robot's deliveries inherit."""

    def __init__(self, program: Program, machine: Machine) -> None:
        self._program = program
        self._machine = machine
        self._timed = bool(program.assertions)
        self._inherited: dict[tuple[int, Instant], None] = {}
        """(predicate, deadline) of what has arrived."""
        self._awaited: dict[tuple[int, int], Instant] = {}
        """Deadlines of other robots' jobs that wait for a fact of this one, by robot and assertion."""

    def of(self, now: Instant, destination: int, delivery: Delivery) -> tuple[Instant, list[TimedJob]]:
        """Return the deadline of what leaves the robot (NEVER: none) and the jobs of this robot that it serves."""
        if not self._timed:
            return NEVER, []
        jobs = [job for job in self._machine.undecided_jobs() if self._serves(job, delivery)]
        due = min((job.deadline for job in jobs), default=NEVER)
        if delivery.role is DeliveryRole.FINISH_SEEN:
            due = min(due, self._awaited.get((destination, delivery.index), NEVER))
        elif delivery.role is not DeliveryRole.FINISH_AWAITED:
            due = min(due, min(self._handed_down(now, delivery.index), default=NEVER))
        return (due, jobs) if due >= now else (NEVER, jobs)

    def arrived(self, now: Instant, source: int, delivery: Delivery) -> None:
        """Remember the deadline of what has arrived."""
        if delivery.role is DeliveryRole.FINISH_AWAITED:
            self._awaited.pop((source, delivery.index), None)
        if delivery.due < now or delivery.due == NEVER or delivery.role is DeliveryRole.FINISH_SEEN:
            return
        if delivery.role is DeliveryRole.FINISH_AWAITED:
            self._awaited[source, delivery.index] = delivery.due
            known: dict[tuple[int, Instant], None] | dict[tuple[int, int], Instant] = self._awaited
        else:
            self._inherited[delivery.index, delivery.due] = None
            known = self._inherited
        if len(known) > INHERITED_MAX:
            self._forget(now)

    def _forget(self, now: Instant) -> None:
        """Forget what has passed and, if that is not enough, what is due last."""
        kept = sorted((due, index) for index, due in self._inherited if due >= now)[:INHERITED_MAX]
        self._inherited = {(index, due): None for due, index in kept}
        waits = sorted((due, key) for key, due in self._awaited.items() if due >= now)[:INHERITED_MAX]
        self._awaited = {key: due for due, key in waits}

    def _serves(self, job: TimedJob, delivery: Delivery) -> bool:
        if delivery.role is DeliveryRole.FINISH_AWAITED:
            return job.assertion == delivery.index
        if delivery.role is DeliveryRole.FINISH_SEEN:
            return False
        assertion = self._program.assertions[job.assertion]
        reach = reach_of(self._program)
        follows = reach.leads(assertion.start.predicate, delivery.index)
        return follows and reach.leads(delivery.index, assertion.finish.predicate)

    def _handed_down(self, now: Instant, predicate: int) -> Iterator[Instant]:
        """Yield the deadlines that have come from other robots and concern what is sent of a predicate."""
        reach = reach_of(self._program)
        for cause, due in self._inherited:
            if due >= now and reach.leads(cause, predicate):
                yield due
        for (_, index), due in self._awaited.items():
            if due >= now and reach.leads(predicate, self._program.assertions[index].finish.predicate):
                yield due
