"""Each deadline that passes without the finish fact derives its violation action, once and on time (paper III.E).

On time is within the tick of the deadline. A robot that was stopped or slow then may take until the first tick after;
what was lost with a robot's process is nobody's fault.
"""

import heapq
from collections import OrderedDict

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import ActionDerived, ExpressionFailed, JobFinished, JobMissed, JobStarted, RuleFired
from rmr_sim.checkers.scene import TICK, Scene

CHECK = "deadline"
MISSED_MAX = 10_000
"""Missed jobs remembered, to notice a second miss of one; the oldest go first."""


class Deadlines:
    """Keeps a queue of its own of all deadlines."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._due: list[tuple[Instant, int, int, int, TimedJob]] = []
        """When the miss of a deadline must be known, a number, the robot, its life, the job."""
        self._number = 0
        self._missed: OrderedDict[int, TimedJob] = OrderedDict()
        """By identity; while a job is remembered no other one has its."""
        self._owed: dict[int, TimedJob] = {}
        """By robot, the job whose violation action comes next."""
        self._paid: dict[int, ActionDerived] = {}
        """By robot, the violation action that was the last thing that happened."""
        scene.hear(JobStarted, self._started)
        scene.hear(JobFinished, self._something)
        scene.hear(RuleFired, self._something)
        scene.hear(ExpressionFailed, self._something)
        scene.hear(JobMissed, self._miss)
        scene.hear(ActionDerived, self._derived)

    def _started(self, robot: int, _now: Instant, started: JobStarted) -> None:
        self._something(robot, 0, started)
        if started.job.deadline < NEVER - TICK:
            self._await(started.job.deadline + TICK, robot, self._scene.life(robot), started.job)

    def _await(self, at: Instant, robot: int, life: int, job: TimedJob) -> None:
        self._number += 1
        heapq.heappush(self._due, (at, self._number, robot, life, job))

    def _something(self, robot: int, _now: Instant, event: object) -> None:
        self._paid.pop(robot, None)
        if isinstance(event, ExpressionFailed):  # the action's arguments have no value: it is left out, and told
            self._owed.pop(robot, None)

    def _miss(self, robot: int, now: Instant, missed: JobMissed) -> None:
        job, complain = missed.job, self._scene.violate
        if id(job) in self._missed:
            complain(now, CHECK, (robot,), f"robot {robot} missed the deadline of {job.text} a second time")
        if now < job.deadline:
            complain(now, CHECK, (robot,), f"robot {robot} missed the deadline of {job.text} before it was due")
        held_up = self._scene.held_up(robot, job.deadline, job.deadline)
        if now > max(job.deadline, held_up) + TICK:
            late_s = in_seconds(now - job.deadline)
            complain(now, CHECK, (robot,), f"robot {robot} noticed {late_s:.3f} s late that {job.text} was overdue")
        self._missed[id(job)] = job
        if len(self._missed) > MISSED_MAX:
            self._missed.popitem(last=False)
        self._owed[robot] = job
        self._paid.pop(robot, None)

    def _derived(self, robot: int, now: Instant, action: ActionDerived) -> None:
        job = self._owed.pop(robot, None)
        paid = self._paid.pop(robot, None)
        if job is not None:
            wanted = self._scene.node(robot).program.assertions[job.assertion].violation.predicate
            if action.predicate == wanted:
                self._paid[robot] = action
                return
            self._scene.violate(now, CHECK, (robot,), f"robot {robot} derived another action than that of {job.text}")
        elif paid is not None and (paid.predicate, paid.args) == (action.predicate, action.args):
            self._scene.violate(now, CHECK, (robot,), f"robot {robot} derived the action of a missed deadline twice")

    def __call__(self, now: Instant) -> None:
        """Look at the deadlines whose time is over, and at the misses of this tick."""
        if self._owed:
            for robot, job in self._owed.items():
                self._scene.violate(
                    now, CHECK, (robot,), f"robot {robot} derived no action when {job.text} was overdue"
                )
            self._owed.clear()
        self._paid.clear()
        while self._due and self._due[0][0] < now:
            _, _, robot, life, job = heapq.heappop(self._due)
            self._judge(now, robot, life, job)

    def _judge(self, now: Instant, robot: int, life: int, job: TimedJob) -> None:
        """Complain if `job` is overdue and its robot, though awake, has not noticed."""
        scene = self._scene
        if job.missed or job.finish is not None or job.deadline + TICK >= now:
            return  # noticed, done or started anew, with a later deadline of its own entry
        if not scene.alive(robot) or scene.life(robot) != life:
            return
        held_up = scene.held_up(robot, job.deadline, now)
        if held_up + TICK >= now:
            self._await(max(held_up, now) + TICK, robot, life, job)
            return
        scene.violate(now, CHECK, (robot,), f"robot {robot} has not noticed that {job.text} is overdue")
