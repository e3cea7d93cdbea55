"""Rule: a deadline that passes without the finish fact derives its violation action, once and on time (paper III.E).

On time is within the tick of the deadline. A robot that was stopped or slow then has until the first tick after. Jobs
that were lost with a robot's process are excused. A durable robot loses none.
"""

import heapq
from collections import OrderedDict

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.bytecode.program import DeriveAction, DeriveFact
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import ActionDerived, ExpressionFailed, JobFinished, JobMissed, JobStarted, RuleFired
from rmr_sim.checkers.run_view import TICK, RunView

CHECK = "deadline"
MISSED_MAX = 10_000
"""Bound of the missed jobs that are kept to detect a second miss; the oldest are dropped."""


class DeadlineChecker:
    """Checks deadlines against a queue of its own."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._due: list[tuple[Instant, int, int, int, TimedJob]] = []
        """Heap of jobs: instant at which a miss must be known, sequence number, robot, incarnation, job."""
        self._number = 0
        self._missed: OrderedDict[int, TimedJob] = OrderedDict()
        """Missed jobs by identity, which is unique as long as the job is kept here."""
        self._owed: dict[int, TimedJob] = {}
        """By robot, the missed job whose violation action must come next."""
        self._paid: dict[int, ActionDerived] = {}
        """By robot, the violation action just derived, if nothing has happened since."""
        view.subscribe(JobStarted, self._started)
        view.subscribe(JobFinished, self._other_event)
        view.subscribe(RuleFired, self._other_event)
        view.subscribe(ExpressionFailed, self._other_event)
        view.subscribe(JobMissed, self._miss)
        view.subscribe(ActionDerived, self._derived)

    def _started(self, robot: int, _now: Instant, started: JobStarted) -> None:
        self._other_event(robot, 0, started)
        if started.job.deadline < NEVER - TICK:
            self._await(started.job.deadline + TICK, robot, self._view.life(robot), started.job)

    def _await(self, at: Instant, robot: int, life: int, job: TimedJob) -> None:
        self._number += 1
        heapq.heappush(self._due, (at, self._number, robot, life, job))

    def _other_event(self, robot: int, _now: Instant, event: object) -> None:
        self._paid.pop(robot, None)
        if isinstance(event, ExpressionFailed):  # the arguments have no value: the action is left out, and reported
            self._owed.pop(robot, None)

    def _miss(self, robot: int, now: Instant, missed: JobMissed) -> None:
        job = missed.job
        violate = self._view.violate
        if id(job) in self._missed:
            violate(now, CHECK, (robot,), f"robot {robot} missed the deadline of {job.text} a second time")
        if now < job.deadline:
            violate(now, CHECK, (robot,), f"robot {robot} missed the deadline of {job.text} before it was due")
        held_up = self._view.held_up(robot, job.deadline, job.deadline)
        if now > max(job.deadline, held_up) + TICK:
            late_s = in_seconds(now - job.deadline)
            violate(now, CHECK, (robot,), f"robot {robot} noticed {late_s:.3f} s late that {job.text} was overdue")
        self._missed[id(job)] = job
        if len(self._missed) > MISSED_MAX:
            self._missed.popitem(last=False)
        if isinstance(self._violation(robot, job), DeriveAction):  # of a fact there is no event where it is inserted
            self._owed[robot] = job
        self._paid.pop(robot, None)

    def _violation(self, robot: int, job: TimedJob) -> DeriveAction | DeriveFact:
        return self._view.node(robot).program.assertions[job.assertion].violation

    def _derived(self, robot: int, now: Instant, action: ActionDerived) -> None:
        job = self._owed.pop(robot, None)
        paid = self._paid.pop(robot, None)
        if job is not None:
            if action.predicate == self._violation(robot, job).predicate:
                self._paid[robot] = action
                return
            self._view.violate(now, CHECK, (robot,), f"robot {robot} derived another action than that of {job.text}")
        elif paid is not None and (paid.predicate, paid.args) == (action.predicate, action.args):
            self._view.violate(now, CHECK, (robot,), f"robot {robot} derived the action of a missed deadline twice")

    def __call__(self, now: Instant) -> None:
        """Check the deadlines that have passed, and the misses of this tick."""
        if self._owed:
            for robot, job in self._owed.items():
                self._view.violate(now, CHECK, (robot,), f"robot {robot} derived no action when {job.text} was overdue")
            self._owed.clear()
        self._paid.clear()
        while self._due and self._due[0][0] < now:
            _, _, robot, life, job = heapq.heappop(self._due)
            self._check(now, robot, life, job)

    def _check(self, now: Instant, robot: int, life: int, job: TimedJob) -> None:
        """Report a violation if `job` is overdue and its robot, though called, has not noticed."""
        view = self._view
        present = view.present(robot, job)
        if present is None:
            return
        job = present
        if job.ended or job.missed or job.finish is not None or job.deadline + TICK >= now:
            return  # noticed, done, or started again with a later deadline, which has its own entry
        if not view.alive(robot) or view.life(robot) != life:
            return
        held_up = view.held_up(robot, job.deadline, now)
        if held_up + TICK >= now:
            self._await(max(held_up, now) + TICK, robot, life, job)
            return
        view.violate(now, CHECK, (robot,), f"robot {robot} has not noticed that {job.text} is overdue")
