"""How urgent a firing is: when the job that it serves is due (``order deadline.``).

A firing serves a job of its robot if the job's finish fact can follow from what the firing derives. For a finish fact
of this robot that is found by backward chaining over values, under the assumption that all else holds, as estimates of
ranks are (`rmr.analysis.goal_levels`). If another robot is involved, predicates alone decide, as with the deadlines of
deliveries: what the firing derives for other robots, or whatever it derives if another robot has the finish fact.

Only jobs count that are neither finished nor missed. Of several jobs a firing serves the nearest: the one whose finish
is the fewest firings away, and of equally near ones the one that is due first. So what takes a resource for one job,
and gives it back for all others, serves that one. Of two firings that serve jobs due at the same time the nearer one is
the more urgent.
"""

from collections.abc import Iterable, Sequence

from rmr.analysis.goal_levels import Levels
from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot
from rmr.bytecode.heads import items
from rmr.bytecode.program import Program
from rmr.vm.assertions import instantiate, key_of
from rmr.vm.derive import Chain
from rmr.vm.goals import facts_of
from rmr.vm.job import TimedJob
from rmr.vm.predicate_reach import reach_of
from rmr.vm.ranks import reading

LEVEL_BITS = 21
"""Lower bits of an urgency: the number of firings to the finish; the bits above them are the deadline."""

BEYOND = 1 << LEVEL_BITS - 1
"""Level of a finish fact to which the way leads over another robot: farther than any that is known."""

UNURGENT = NEVER << LEVEL_BITS
"""Urgency of a firing that serves no job. The smaller the number, the more urgent."""

LEVELS_MAX = 512
"""Finish facts whose levels are kept, twice as many as there may be live jobs; beyond that all are computed anew."""


def due_of(urgency: int) -> Instant:
    """Return when the job is due that a firing of this urgency serves; NEVER if it serves none."""
    return urgency >> LEVEL_BITS


class Urgency:
    """The urgency of one robot's firings."""

    __slots__ = ("_first", "_jobs", "_levels", "_program", "_reach", "_reading", "_robot", "version")

    def __init__(self, program: Program, robot: Robot) -> None:
        self._program = program
        self._robot = robot
        self._reading = reading(program)
        self._reach = reach_of(program)
        self._jobs: list[TimedJob] = []
        self._first: dict[int, int] = {}
        """By rule, a lower bound on the urgency of its firings."""
        self._levels: dict[tuple[int, object], Levels] = {}
        """By predicate and arguments of a finish fact."""
        self.version = 0
        """Grows with each change of the jobs."""

    @property
    def has_jobs(self) -> bool:
        """Whether there are jobs that are neither finished nor missed."""
        return bool(self._jobs)

    def renew(self, jobs: Iterable[TimedJob]) -> None:
        """Note that jobs have started, restarted, finished or missed their deadlines; `jobs` are those undecided."""
        self._jobs = sorted(jobs, key=lambda job: (job.deadline, job.serial))
        self._first.clear()
        self.version += 1

    def first(self, rule: int) -> int:
        """Return a lower bound on the urgency of the firings of `rule`; UNURGENT if they serve no job."""
        first = self._first.get(rule)
        if first is None:
            derived = {item.predicate: None for item in items(self._program.rules[rule].head)}
            may = (job.deadline for job in self._jobs if any(self._leads(each, job) for each in derived))
            first = self._first[rule] = next(may, NEVER) << LEVEL_BITS
        return first

    def of(self, derived: Sequence[Chain], now: Instant) -> int:
        """Return the urgency of a firing with these results."""
        steps = [item for chain in derived for item in chain]
        own = [fact for item in steps for fact in facts_of(self._program, self._robot, item, now)]
        sent = [item.predicate for item in steps if item.owner != self._robot]
        every = [item.predicate for item in steps]
        nearest = BEYOND + 1
        due = NEVER
        for job in self._jobs:
            level = self._levels_of(job).lowest(own) if own and not job.remote else None
            if level is None and any(self._leads(each, job) for each in (every if job.remote else sent)):
                level = BEYOND
            if level is not None and level < nearest:
                nearest = level
                due = job.deadline
                if not level:
                    break
        return UNURGENT if due == NEVER else due << LEVEL_BITS | nearest

    def _leads(self, predicate: int, job: TimedJob) -> bool:
        return self._reach.leads(predicate, self._program.assertions[job.assertion].finish.predicate)

    def _levels_of(self, job: TimedJob) -> Levels:
        """Return the levels of what is wanted for a job's finish fact; they depend on no facts, so they stay valid."""
        finish = self._program.assertions[job.assertion].finish
        args = tuple([instantiate(pattern, job.bindings) for pattern in finish.args])
        key = finish.predicate, key_of(args)
        levels = self._levels.get(key)
        if levels is None:
            if len(self._levels) >= LEVELS_MAX:
                self._levels.clear()
            levels = self._levels[key] = Levels(self._reading.backwards, [(finish.predicate, args)], self._robot)
        return levels
