"""Steps of jobs: the actions of a robot that serve a job, and what the job's time went into, action by action.

A step lasts from the end of the step before it, or the start of the job, to the end of its action. Its time is
divided: until the action was derived (`RULE`: rules, deliveries, other robots), until it had its turn (`TURN`), until
the wheels were free (`WHEELS`), and until it ended (`DRIVE` with wheels, else `ACTION`). What comes after the last
action is a step without one. The steps have neither gap nor overlap.

An action serves a job if it can follow from the job's start fact, or from what the same firing derives, and the finish
fact can follow from it or from a later step of its chain (``then``); by predicates alone, without values. The robot
keeps instants only, and adds them up for the report. What the wheels did meanwhile, and what happened on other robots,
is worked out from the recording by `rmr why RUN --missed`.
"""

from collections.abc import Iterator, Sequence
from typing import Any, Final

from rmr.base.identity import ByIdentity
from rmr.base.time import Duration, Instant
from rmr.bytecode.program import Program, Steps, When
from rmr.node.actions.dispatcher import RunningAction
from rmr.vm.job import TimedJob
from rmr.vm.predicate_reach import reach_of

ACTIONS_MAX: Final = 100
"""Actions kept of one job, the first ones; the time of later ones is that of the step after the last action."""
JOBS_MAX: Final = 256
"""Jobs whose actions are kept; the oldest are forgotten first."""

RULE: Final = "rule"
TURN: Final = "turn"
WHEELS: Final = "wheels"
DRIVE: Final = "drive"
ACTION: Final = "action"


class Chained:
    """By predicate: those of the later steps of the chains in which it is a step."""

    def __init__(self, program: Program) -> None:
        self.later: dict[int, tuple[int, ...]] = {}
        for rule in program.rules:
            for head in rule.head:
                part = head.item if isinstance(head, When) else head
                if isinstance(part, Steps):
                    self._add([step.predicate for step in part.steps])

    def _add(self, chain: Sequence[int]) -> None:
        for place, predicate in enumerate(chain):
            known = self.later.get(predicate, ())
            self.later[predicate] = tuple(dict.fromkeys([*known, *chain[place + 1 :]]))


_chained: ByIdentity[Program, Chained] = ByIdentity(Chained)


class JobSteps:
    """The actions of one robot's newest jobs."""

    def __init__(self) -> None:
        self._actions: dict[TimedJob, list[RunningAction]] = {}

    def derived(self, program: Program, running: RunningAction, action: int, live: Sequence[TimedJob]) -> None:
        """Note an action that has been derived for the robot, while these jobs have no finish."""
        for job in live:
            if not serves(program, job, action, beside=True):
                continue
            actions = self._actions.get(job)
            if actions is None:
                actions = self._actions[job] = []
                while len(self._actions) > JOBS_MAX:
                    del self._actions[next(iter(self._actions))]
            if len(actions) < ACTIONS_MAX:
                actions.append(running)

    def entries(self, robot: int, job: TimedJob, now: Instant) -> list[dict[str, Any]]:
        """Return the steps of a job as the report lists them; empty if no action has served it.

        They reach to the finish, else to the deadline, or to `now` if that came first.
        """
        end = job.finish if job.finish is not None else min(now, job.deadline)
        actions = [each for each in self._actions.get(job, ()) if each.derived < end]
        if not actions:
            return []
        entries: list[dict[str, Any]] = []
        at = job.start
        for running in sorted(actions, key=lambda each: _until(each, end)):
            until = _until(running, end)
            if until > at:
                entries.append(_entry(robot, job, running, at, until))
                at = until
        if at < end:
            late = None if job.finish is None else end - job.deadline
            step = {"action": None, "begin_ns": at, "begun_ns": None, "end_ns": end, "due_ns": job.deadline}
            entries.append({**step, "late_ns": late, "behind": [], "time_ns": {RULE: end - at}})
        return entries


def serves(program: Program, job: TimedJob, action: int, *, beside: bool = False) -> bool:
    """Return whether `action` can follow from the start of `job`, and its finish from that or a later step.

    `beside`: also from what the firing derives that starts the job. Drives of that kind have no turn by its deadline:
    with one, drawn labs met more deadlines and took longer.
    """
    if job.assertion < 0:
        return False
    assertion = program.assertions[job.assertion]
    reach = reach_of(program)
    if not (reach.begun if beside else reach.leads)(assertion.start.predicate, action):
        return False
    finish = assertion.finish.predicate
    return any(reach.leads(each, finish) for each in (action, *_chained(program).later.get(action, ())))


def led_to(program: Program, live: Sequence[TimedJob], action: int, *, scheduled: bool = True) -> list[TimedJob]:
    """Return those of the `live` jobs that `action` serves if later ones are counted, first due first.

    With `scheduled` only those of assertions that are scheduled, not those that are watched.
    """
    jobs = [job for job in live if not scheduled or program.assertions[job.assertion].scheduled]
    found = [job for job in jobs if serves(program, job, action)]
    return sorted(found, key=lambda job: (job.deadline, job.serial))


def _until(running: RunningAction, end: Instant) -> Instant:
    return end if running.ended is None else min(running.ended, end)


def _times(running: RunningAction, at: Instant, until: Instant) -> Iterator[tuple[str, Duration]]:
    """Yield what the time from `at` to `until`, at which the action ended, went into; nothing is 0."""
    admitted = until if running.admitted is None else running.admitted
    started = until if running.started is None else running.started
    runs = DRIVE if running.uses_wheels else ACTION
    for word, stage in ((RULE, running.derived), (TURN, admitted), (WHEELS, started), (runs, until)):
        reached = min(max(stage, at), until)
        if reached > at:
            yield word, reached - at
            at = reached


def _entry(robot: int, job: TimedJob, running: RunningAction, at: Instant, until: Instant) -> dict[str, Any]:
    due = running.due if running.job is job else None
    ended = running.ended is not None and running.ended <= until
    times = dict(_times(running, at, until))
    return {
        "action": running.text(robot),
        "begin_ns": at,
        "begun_ns": running.started if running.started is not None and running.started <= until else None,
        "end_ns": until,
        "due_ns": due,
        "late_ns": until - due if due is not None and ended else None,
        "behind": list(running.behind) if TURN in times else [],
        "time_ns": times,
    }
