"""Run-time monitoring of time assertions: jobs and the priority queue of their deadlines (paper III.E, V.B.3).

An assertion has a start pattern S, a finish pattern F and a deadline D. A fact that matches S starts a job, which waits
for F under S's bindings. A later S for the same F restarts the job with its own D: the paper measures "since the last
time".

A job whose deadline has passed stays missed. A late F still fills in its finish. An S after the miss opens a new job,
to which a later F belongs.

The queue is a heap sorted by deadline, then serial. Deletion is lazy: an entry of a job that has ended or restarted is
dropped when it comes to the front.

If F belongs to another robot, that robot is asked to report it (`rmr.vm.watches`). The report ends the job as of the
instant at which F was inserted there. A report after the deadline does not undo the miss. Both robots compute the
bindings of S and the instance of F from the same start fact, so the bindings need not be sent.
"""

from collections.abc import Iterator, Sequence
from heapq import heapify, heappop, heappush

from rmr.analysis.servers import EarlierStep, steps_of
from rmr.base.time import NEVER, NS_PER_S, Instant
from rmr.base.values import Robot, Value, format_value
from rmr.bytecode.octets import identity
from rmr.bytecode.program import SELF_SLOT, Assertion, Constant, Kind, Pattern, Program, Slot
from rmr.vm.bounds import Dropped, remember
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.failures import Failures
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import FinishAwaited, JobFinished, JobStarted, VmEvent
from rmr.vm.match import pattern_agrees
from rmr.vm.shared import Mine
from rmr.vm.store import Args, Holdings

JOBS_MAX = 1024
"""Jobs remembered for the report; beyond that the oldest are forgotten."""

LIVE_MAX = 256
"""Jobs that wait for their finish fact; beyond that the oldest one is dropped and counted."""

Key = tuple[int, Robot, object]
"""Identity of a live job: the assertion, its finish fact's robot and arguments."""

Entry = tuple[Instant, int, int, TimedJob]
"""Entry of the deadline queue: deadline, the job's serial, the number of the entry, the job."""

Bindings = tuple[Value | None, ...]
"""Values of an assertion's slots; None: unbound."""


def bind(slots: int, patterns: tuple[Pattern, ...], args: Args, robot: Robot) -> Bindings | None:
    """Return the slots that `args` bind through `patterns`, or None if they do not match; slot 0 is `robot`."""
    bindings: list[Value | None] = [None] * slots
    bindings[SELF_SLOT] = robot
    if not pattern_agrees(patterns, args, tuple(bindings)):
        return None
    for pattern, value in zip(patterns, args, strict=True):
        if isinstance(pattern, Slot):
            bindings[pattern.index] = value
    return tuple(bindings)


def instantiate(pattern: Pattern, bindings: Bindings) -> Pattern:
    """Return `pattern` with a bound variable replaced by its value."""
    if isinstance(pattern, Slot):
        value = bindings[pattern.index]
        return pattern if value is None else Constant(value)
    return pattern


def robot_of(pattern: Pattern, bindings: Bindings) -> Robot | None:
    """Return the robot that `pattern` denotes under `bindings`; None if its value is no robot."""
    named = instantiate(pattern, bindings)
    return named.value if isinstance(named, Constant) and type(named.value) is Robot else None


def key_of(patterns: tuple[Pattern, ...]) -> tuple[object, ...]:
    """Return a key that is equal for identical patterns only; it distinguishes 1, 1.0 and True, unlike Python's ==."""
    return tuple([identity(p.value) if isinstance(p, Constant) else repr(p) for p in patterns])


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
        """By job serial, for each job neither finished nor missed: the number of its valid queue entry."""
        self._mine = mine

    def inserted(self, now: Instant, predicate: int, args: Args) -> list[VmEvent]:
        """Return the events of a fact's insertion: it ends jobs before it starts one."""
        # Ended first: where S and F are the same pattern, a fact ends the job of the fact before it and starts its own.
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
        """Return the events of a report that robot `source` inserted a finish fact at `at`.

        The report belongs to the job that was running at `at`. There is none if the job has restarted since.
        """
        predicate = self._program.assertions[index].finish.predicate

        def waited(job: TimedJob) -> bool:
            wanted = job.assertion == index and job.finisher == source and job.finish is None and job.start <= at
            return wanted and self._ends(job, predicate, args)

        ended = [key for key, job in self._live.items() if waited(job)]
        if ended:
            return [self._finish(at, key) for key in ended]
        # A job that is no longer live was missed or displaced: the report completes its record (`TimedJob.cause`).
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
            del self._undecided[job.serial]  # it stays live: a late finish fact is still recorded
            job.missed = True
            missed.append(job)
            self._settle()
        return missed

    def serving(self, action: int, args: Args) -> list[TimedJob]:
        """Return the scheduled jobs that wait for their finish fact and that this action serves, first due first."""
        served = [job for job in self._live.values() if self._serves(job, action, args)]
        return sorted(served, key=lambda job: (job.deadline, job.serial))

    def undecided(self) -> list[TimedJob]:
        """Return the jobs that are neither finished nor missed, in the order of their first start."""
        return [job for job in self._live.values() if job.serial in self._undecided]

    @property
    def live(self) -> list[TimedJob]:
        """The jobs that wait for their finish fact, missed ones included, in the order of their first start."""
        return list(self._live.values())

    def follow(self, old: "Assertions") -> None:
        """Number the jobs from the last one of `old` on."""
        self._serial = old._serial

    def take_over(self, old: "Assertions", numbers: Sequence[int | None]) -> list[TimedJob]:
        """Take over the jobs of another program, whose assertions have the new `numbers`; return those that ended.

        A live job keeps its start and deadline. An undecided one whose assertion has no new number ends: it is
        neither met nor missed. Jobs that are decided stay in the report. Jobs of this program that have started before
        have serials behind those of the old ones (`follow`).
        """
        self.jobs[:0] = old.jobs
        ended = []
        mine = self._live
        self._live = {}
        for (index, finisher, key), job in old._live.items():
            target = numbers[index]
            if target is not None:
                self._live[target, finisher, key] = job
            elif job.serial in old._undecided:
                job.ended = True
                ended.append(job)
        self._live |= mine
        kept = {id(job) for job in self._live.values()}
        for job in old.jobs:
            known = numbers[job.assertion] if job.assertion >= 0 else None
            job.assertion = -1 if known is None else known
            if id(job) in kept and job.serial in old._undecided:
                self._pushed += 1
                self._undecided[job.serial] = self._pushed
                heappush(self._queue, (job.deadline, job.serial, self._pushed, job))
        self._settle()
        return ended

    def _serves(self, job: TimedJob, action: int, args: Args) -> bool:
        assertion = self._program.assertions[job.assertion]
        return assertion.scheduled and any(
            serving.action == action and pattern_agrees(serving.args, args, job.bindings)
            for serving in assertion.serving
        )

    def _ends(self, job: TimedJob, predicate: int, args: Args) -> bool:
        """Return whether a fact of the finish robot matches the job's finish pattern."""
        finish = self._program.assertions[job.assertion].finish
        return finish.predicate == predicate and pattern_agrees(finish.args, args, job.bindings)

    def _start(
        self, now: Instant, index: int, assertion: Assertion, bindings: Bindings, args: Args
    ) -> Iterator[VmEvent]:
        """Start a job, or restart the one that waits for the same fact."""
        try:
            deadline = due_at(now, assertion, bindings)
            finisher = robot_of(assertion.finisher, bindings)
            if finisher is None:
                raise NoValue("a finish fact of something that is no robot")
        except NoValue as reason:
            self._failures.report(now, f"start of assertion {assertion.name}", str(reason))
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
        self._undecided[job.serial] = self._pushed  # which invalidates the entry of an earlier start
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
        self._live.pop(key, None)  # a missed job for the same fact
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
        """Return whether F is persistent or sensed and holds: then the job finishes as it starts."""
        finish = assertion.finish
        return self._program.predicates[finish.predicate].kind is not Kind.TEMPORARY and any(
            pattern_agrees(finish.args, args, bindings) for args in self._holdings.each(finish.predicate)
        )

    def _settle(self) -> None:
        """Drop outdated entries from the head of the queue, and all of them once the queue is long."""
        queue = self._queue
        # At most LIVE_MAX entries are valid, so at least three quarters are outdated: amortised O(1) for each push.
        if len(queue) > 4 * LIVE_MAX:
            queue[:] = [entry for entry in queue if self._counts(entry)]
            heapify(queue)
        while queue and not self._counts(queue[0]):
            heappop(queue)
        self.due = queue[0][0] if queue else NEVER

    def _counts(self, entry: Entry) -> bool:
        """Return whether a queue entry is the valid one of a job that is neither finished nor missed."""
        _, serial, number, _ = entry
        return self._undecided.get(serial) == number


def earlier_steps(program: Program, job: TimedJob) -> tuple[EarlierStep, ...]:
    """Return the steps of `job` with turns of their own, before the actions that serve it; the first ones first."""
    return steps_of(program)[job.assertion] if job.assertion >= 0 else ()


def step_event(program: Program, job: TimedJob, step: EarlierStep) -> str:
    """Return for what robots contend in a step: the action with those arguments that the job determines."""
    args = [pattern_text(instantiate(pattern, job.bindings)) for pattern in step.args]
    return f"{program.predicates[step.action].name}({', '.join(args)})"


def pattern_text(pattern: Pattern) -> str:
    """Return a pattern in program syntax; a free argument is ``_``."""
    return format_value(pattern.value) if isinstance(pattern, Constant) else "_"


def goal_text(name: str, robot: Robot, args: tuple[Pattern, ...]) -> str:
    """Return a fact with free arguments in program syntax."""
    return f"{name}({', '.join([format_value(robot), *map(pattern_text, args)])})"


def due_at(now: Instant, assertion: Assertion, bindings: Bindings) -> Instant:
    """Return the deadline of a job that starts now, in nanoseconds; a D of 0 s or less is due at once.

    Raises:
        NoValue: D is no number of seconds.
    """
    value = evaluate(assertion.deadline, bindings, now)  # type: ignore[arg-type]
    if type(value) is not int and type(value) is not float:
        raise NoValue("a deadline that is no number of seconds")
    if value <= 0:
        return now
    if value * NS_PER_S >= NEVER - now:
        return NEVER - 1  # before NEVER, which means that nothing is due
    return now + round(value * NS_PER_S)
