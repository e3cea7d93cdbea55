"""One plan of a leader: slots for all jobs whose slots do not stand.

The jobs are placed behind the slots that stand, in four tiers:

1. jobs that as many others have overtaken as may (`is_due`), in order of joining;
2. jobs under way: their robots have set out, and the others would have to pass them. The nearest goes first. Of more
   than `EXACT_MAX` jobs all that have set out are in this tier;
3. the others, in the order of `rmr.coord.schedule`;
4. jobs whose robots were not ready for their last slots (`is_behind`), in order of their back-off.

A job of the second or third tier goes before one of a tier above that it does not hold up: not beyond the slot for
which that one's robot set out. Where turns do not exclude each other (`capacity` above 1) tiers are strict.

A plan is computed in one call and keeps nothing. It writes `start` and `until` of the bookings.
"""

from collections.abc import Iterable

from rmr.base.time import Duration, Instant
from rmr.coord.booking import Booking, task_of
from rmr.coord.schedule import EXACT_MAX, Placed, Rules, Task, merge, on_time, order_jobs, place
from rmr.coord.timing import Order, Timing


class Planner:
    """The plan of one leader at one instant."""

    def __init__(
        self, robot: int, timing: Timing, now: Instant, *, reorder: bool, eager: bool, capacity: int = 1
    ) -> None:
        """`reorder`: compute a new order; `eager`: the job of the leader itself, `robot`, may start at once;
        `capacity`: how many robots may be inside at a time."""
        self._robot = robot
        self._timing = timing
        self._now = now
        self._reorder = reorder
        self._eager = eager
        schedule = timing.schedule
        opposed = schedule.window + 2 * timing.clock_error + schedule.clear
        # Only the leader's own job needs no claim, so that it alone may start before `lead` (`_task`).
        self._rules = Rules(now if eager else now + schedule.lead, opposed, timing.order, capacity)

    def place(self, standing: Iterable[Booking], movable: list[Booking]) -> None:
        """Assign slots to the `movable` jobs, behind the slots of those `standing`."""
        fixed = [
            Placed(job.start, max(job.until - job.start, 0), job.headway, job.direction)
            for job in standing
            if job.start is not None
        ]
        many = len(movable) > EXACT_MAX and self._timing.order is Order.OURS
        last = self._absent(movable)
        movable = [job for job in movable if not job.behind]
        due, underway = self._urgent(movable, many)
        by_robot = {job.robot: job for job in movable}
        first = self._merged(due, [self._task(job) for job in underway], fixed)
        ahead = [by_robot[task.robot] for task in first]
        known = {job.robot for job in ahead}
        slots = [self._slot(job) for job in ahead]
        behind = fixed + self._give(ahead, first, fixed)
        tasks = self._ordered([job for job in movable if job.robot not in known], behind)
        if self._rules.capacity == 1:
            tasks = merge(first, slots, tasks, fixed, self._rules)
            behind = fixed
        behind = behind + self._give([by_robot[task.robot] for task in tasks], tasks, behind)
        self._give(last, [self._task(job) for job in last], behind)

    def _merged(self, due: list[Booking], underway: list[Task], fixed: list[Placed]) -> list[Task]:
        """Return the order of the jobs that go first: those `due`, and before each those that do not hold it up."""
        first = [self._task(job) for job in due]
        if not first or self._rules.capacity > 1:
            return first + underway
        return merge(first, [self._slot(job) for job in due], underway, fixed, self._rules)

    def _absent(self, movable: list[Booking]) -> list[Booking]:
        """Return the jobs that go behind all others, the one with the earliest retry first."""
        for job in movable:
            was = job.behind
            job.behind = job.is_behind(self._timing.schedule)
            if was and not job.behind:
                job.start = None  # it joins the order anew: its old slot was one behind all others
        return sorted((job for job in movable if job.behind), key=lambda job: (job.retry, job.robot))

    def _urgent(self, movable: list[Booking], many: bool) -> tuple[list[Booking], list[Booking]]:
        """Return the jobs that go first: those overtaken by enough others, and those under way, nearest first."""
        due = [job for job in movable if job.is_due(self._timing.schedule)]
        due.sort(key=lambda job: (job.joined, job.robot))
        underway = [
            job for job in movable if job not in due and (job.underway or (many and job.has_set_out(self._now)))
        ]
        underway.sort(key=lambda job: (self._distance(job), job.robot))
        return due, underway

    def _slot(self, job: Booking) -> Instant:
        """Return the slot for which the robot of a job set out; now, if it shall go as soon as it can.

        So shall one that stands where others must pass, and one that enough others have overtaken.
        """
        if job.start is None or job.underway or job.is_due(self._timing.schedule):
            return self._now
        return job.start

    def _distance(self, job: Booking) -> Duration:
        """Return how long the robot of a job under way needs to its entrance."""
        return job.approach if job.underway else (job.start or self._now) - self._now

    def _ordered(self, jobs: list[Booking], fixed: list[Placed]) -> list[Task]:
        """Return the order of `jobs` behind those `fixed`."""
        tasks = {job.robot: self._task(job) for job in jobs}
        slotted = [(job.start, job.robot) for job in jobs if job.start is not None]
        old = [robot for _, robot in sorted(slotted)]
        # No job has come, gone or changed: the slots are only shifted.
        if not self._reorder and len(old) == len(jobs):
            return [tasks[robot] for robot in old]
        order = order_jobs(list(tasks.values()), fixed, self._rules, old)
        return self._own_first(order, fixed) if self._eager else order

    def _own_first(self, order: list[Task], fixed: list[Placed]) -> list[Task]:
        """Return `order` with the leader's own job, which may start at once, first if that makes no other job late.

        Not before a job that is due sooner by more than the time that the others need to claim.
        """
        own = [task for task in order if task.robot == self._robot]
        if not own or own[0].deadline > order[0].deadline + self._timing.schedule.lead:
            return order
        moved = own + [task for task in order if task.robot != self._robot]
        met = on_time(order, place(order, fixed, self._rules))
        return moved if on_time(moved, place(moved, fixed, self._rules)) >= met else order

    def _task(self, job: Booking) -> Task:
        """Return the task of `job`: only the leader's own one may start before it could be claimed."""
        task = task_of(job, self._now, self._timing.schedule.grace)
        if not self._eager or job.robot == self._robot:
            return task
        return task._replace(release=max(task.release, self._now + self._timing.schedule.lead))

    def _give(self, jobs: list[Booking], tasks: list[Task], fixed: list[Placed]) -> list[Placed]:
        """Assign slots behind those `fixed` to `jobs`, whose `tasks` are in the same order; return the slots."""
        starts = place(tasks, fixed, self._rules)
        for job, start in zip(jobs, starts, strict=True):
            job.start = start
            job.until = start + job.duration
        return [
            Placed(start, task.duration, task.headway, task.direction)
            for task, start in zip(tasks, starts, strict=True)
        ]
