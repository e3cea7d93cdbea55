"""Time assertions at work: jobs and the queue of their deadlines (paper III.E, V.B.3).

A fact that matches S starts a job that waits for F under S's bindings. A later S for the same F starts that
job anew, with its own D: the paper measures "since the last time". Once its deadline has passed a job is
missed for ever; a late F still fills in its finish, but an S after the miss opens a new job, to which that F
then belongs. The queue is sorted by deadline, then serial; entries of jobs that have ended or started anew are
recognised and dropped when they come up.

If F is another robot's, that robot is asked to report it (its side is watches.py), and the job ends by the news,
as of the instant at which F was inserted there. News that comes after the deadline does not undo the miss.
"""

from collections.abc import Iterator
from heapq import heapify, heappop, heappush

from rmr.base.time import NEVER, NS_PER_S, Instant
from rmr.base.values import Robot, format_value
from rmr.bytecode.program import Assertion, Constant, Kind, Pattern, Program
from rmr.vm.bounds import Dropped, remember
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.failures import Failures
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import FinishAwaited, JobFinished, JobStarted, VmEvent
from rmr.vm.match import pattern_agrees
from rmr.vm.patterns import Bindings, bind, instantiate, key_of, robot_of
from rmr.vm.shared import Mine
from rmr.vm.store import Args, Holdings

JOBS_MAX = 1024
"""Jobs remembered for the report; beyond that the oldest are forgotten."""

LIVE_MAX = 256
"""Jobs that wait for their finish fact; beyond that the oldest is given up and counted."""

Key = tuple[int, Robot, object]
"""An assertion, its finish fact's robot and arguments."""

Entry = tuple[Instant, int, int, TimedJob]
"""Of the queue: deadline, the job's serial, the number of the entry, the job."""


class Assertions:
    """The jobs of one robot."""

    __slots__ = (
        "_dropped",
        "_failures",
        "_holdings",
        "_live",
        "_mine",
        "_program",
        "_pushed",
        "_queue",
        "_robot",
        "_serial",
        "_undecided",
        "due",
        "jobs",
    )

    def __init__(
        self,
        program: Program,
        robot: Robot,
        mine: Mine,
        holdings: Holdings,
        failures: Failures,
        dropped: Dropped,
    ) -> None:
        self.jobs: list[TimedJob] = []
        self.due: Instant = NEVER
        """The next deadline."""
        self._program = program
        self._robot = robot
        self._holdings = holdings
        self._failures = failures
        self._dropped = dropped
        self._live: dict[Key, TimedJob] = {}
        self._queue: list[Entry] = []
        self._serial = 0
        self._pushed = 0
        self._undecided: dict[int, int] = {}
        """By serial, the jobs whose deadline may come: the number of the entry that holds it."""
        self._mine = mine

    def inserted(self, now: Instant, predicate: int, args: Args) -> list[VmEvent]:
        """Return what a fact's insertion brought about: it ends jobs before it starts one."""
        ended = [key for key, job in self._live.items() if not job.remote and self._ends(job, predicate, args)]
        events: list[VmEvent] = [self._finish(now, key) for key in ended]
        for index, assertion in self._mine:
            start = assertion.start
            if start.predicate == predicate:
                bindings = bind(assertion.slots, start.args, args, self._robot)
                if bindings is not None:
                    events.extend(self._start(now, index, assertion, bindings, args))
        return events

    def seen(self, source: int, index: int, args: Args, at: Instant) -> list[VmEvent]:
        """Return what the news of another robot's finish fact, inserted at `at`, brought about.

        It belongs to the job that ran at the time; none may have, or it has started anew since.
        """
        predicate = self._program.assertions[index].finish.predicate

        def waited(job: TimedJob) -> bool:
            wanted = job.assertion == index and job.finisher == source and job.finish is None and job.start <= at
            return wanted and self._ends(job, predicate, args)

        ended = [key for key, job in self._live.items() if waited(job)]
        if ended:
            return [self._finish(at, key) for key in ended]
        missed = next((job for job in reversed(self.jobs) if waited(job)), None)
        if missed is None:
            return []
        missed.finish = at
        return [JobFinished(missed)]

    def overdue(self, until: Instant) -> list[TimedJob]:
        """Return the jobs that miss a deadline at or before `until`, first due first, each once."""
        missed = []
        while self.due <= until:
            job = heappop(self._queue)[-1]
            del self._undecided[job.serial]
            job.missed = True
            missed.append(job)
            self._settle()
        return missed

    def serving(self, action: int, args: Args) -> list[TimedJob]:
        """Return the scheduled jobs that wait for their finish fact and that this action serves, first due first."""
        served = [job for job in self._live.values() if self._serves(job, action, args)]
        return sorted(served, key=lambda job: (job.deadline, job.serial))

    def _serves(self, job: TimedJob, action: int, args: Args) -> bool:
        assertion = self._program.assertions[job.assertion]
        return assertion.scheduled and any(
            serving.action == action and pattern_agrees(serving.args, args, job.bindings)
            for serving in assertion.serving
        )

    def _ends(self, job: TimedJob, predicate: int, args: Args) -> bool:
        """Tell whether a fact of the right robot is the one for which a job waits."""
        finish = self._program.assertions[job.assertion].finish
        return finish.predicate == predicate and pattern_agrees(finish.args, args, job.bindings)

    def _start(
        self, now: Instant, index: int, assertion: Assertion, bindings: Bindings, args: Args
    ) -> Iterator[VmEvent]:
        """Start a job, or start anew the one that waits for the same fact."""
        try:
            deadline = due_at(now, assertion, bindings)
            finisher = robot_of(assertion.finisher, bindings)
            if finisher is None:
                raise NoValue("a finish fact of something that is no robot")
        except NoValue as reason:
            self._failures.tell(now, f"start of assertion {assertion.name}", str(reason))
            return
        finish = tuple([instantiate(pattern, bindings) for pattern in assertion.finish.args])
        key = (index, finisher, key_of(finish))
        job = self._live.get(key)
        if job is None or job.missed:
            job = self._open(now, key, finish, bindings)
        job.start = now
        job.deadline = deadline
        job.bindings = bindings
        self._pushed += 1
        self._undecided[job.serial] = self._pushed
        heappush(self._queue, (deadline, job.serial, self._pushed, job))
        self._settle()
        yield JobStarted(job)
        if job.remote:
            yield FinishAwaited(finisher, index, args, now)
        elif self._holds(assertion, bindings):
            yield self._finish(now, key)

    def _open(self, now: Instant, key: Key, finish: tuple[Pattern, ...], bindings: Bindings) -> TimedJob:
        index, finisher, _ = key
        assertion = self._program.assertions[index]
        predicate = self._program.predicates[assertion.finish.predicate]
        mark = "!" if predicate.kind is Kind.PERSISTENT else ""
        texts = [pattern_text(pattern) for pattern in finish]
        self._serial += 1
        job = TimedJob(
            serial=self._serial,
            assertion=index,
            name=assertion.name,
            event=f"{assertion.name}({', '.join(texts)})",
            text=f"{mark}{predicate.name}({', '.join([format_value(finisher), *texts])})",
            start=now,
            deadline=now,
            bindings=bindings,
            finisher=finisher,
        )
        self._live.pop(key, None)
        if len(self._live) >= LIVE_MAX:
            self._undecided.pop(self._live.pop(next(iter(self._live))).serial, None)
            self._dropped.add("jobs", LIVE_MAX, now)
        self._live[key] = job
        remember(self.jobs, job, JOBS_MAX)
        return job

    def _finish(self, at: Instant, key: Key) -> VmEvent:
        job = self._live.pop(key)
        self._undecided.pop(job.serial, None)
        job.finish = at
        self._settle()
        return JobFinished(job)

    def _holds(self, assertion: Assertion, bindings: Bindings) -> bool:
        """Tell whether F is persistent or sensed and holds."""
        finish = assertion.finish
        return self._program.predicates[finish.predicate].kind is not Kind.TEMPORARY and any(
            pattern_agrees(finish.args, args, bindings) for args in self._holdings.each(finish.predicate)
        )

    def _settle(self) -> None:
        """Drop outdated entries from the head of the queue, and all of them when they are the most."""
        queue = self._queue
        if len(queue) > 4 * LIVE_MAX:
            queue[:] = [entry for entry in queue if self._counts(entry)]
            heapify(queue)
        while queue and not self._counts(queue[0]):
            heappop(queue)
        self.due = queue[0][0] if queue else NEVER

    def _counts(self, entry: Entry) -> bool:
        """Tell whether a queue entry is the deadline of a job that is still undecided; each such job has one."""
        _, serial, number, _ = entry
        return self._undecided.get(serial) == number


def pattern_text(pattern: Pattern) -> str:
    """Return a pattern in program syntax; what is free is ``_``."""
    return format_value(pattern.value) if isinstance(pattern, Constant) else "_"


def goal_text(name: str, robot: Robot, args: tuple[Pattern, ...]) -> str:
    """Return a fact with free arguments in program syntax."""
    return f"{name}({', '.join([format_value(robot), *map(pattern_text, args)])})"


def due_at(now: Instant, assertion: Assertion, bindings: Bindings) -> Instant:
    """Return the deadline of a job that starts now; a negative D is due at once.

    Raises:
        NoValue: D is no number of seconds.
    """
    value = evaluate(assertion.deadline, bindings, now)  # type: ignore[arg-type]
    if type(value) is not int and type(value) is not float:
        raise NoValue("a deadline that is no number of seconds")
    if value <= 0:
        return now
    if value * NS_PER_S >= NEVER - now:
        return NEVER - 1
    return now + round(value * NS_PER_S)
