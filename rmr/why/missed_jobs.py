"""Which jobs of a run are explained: all missed deadlines, or the one that is asked for as ``crossing@3``."""

import re
from collections.abc import Mapping
from typing import Final

from rmr.base.ids import named
from rmr.base.time import Instant, in_seconds
from rmr.vm.job import TimedJob
from rmr.why.critical_path import explained
from rmr.why.delay import Delay
from rmr.why.question import WhyError, robots_text
from rmr.why.replayed_histories import RecordedHistories
from rmr.why.robot_history import LostDelivery, RobotHistory

_JOB: Final = re.compile(r"(?P<name>\w+)@(?P<robot>\d{1,9})", re.ASCII)
FORM: Final = "write the assertion and the robot, such as crossing@3"


def missed_delays(run: RecordedHistories) -> list[Delay]:
    """Return the missed deadlines of all robots, explained, by deadline."""
    found = [
        (job.deadline, robot, job)
        for robot, history in sorted(run.robots.items())
        for job, _ in history.jobs
        if is_missed(history, job)
    ]
    return [_explained(run, robot, job) for _, robot, job in sorted(found, key=lambda each: each[:2])]


def asked_delay(run: RecordedHistories, asked: str, at: Instant | None) -> Delay:
    """Return one job explained: the newest of those meant by `asked`, or the one that ran `at` an instant.

    Raises WhyError if there is none, or it is not decided.
    """
    written = _JOB.fullmatch(asked.strip())
    if written is None:
        raise WhyError(f"{asked!r} names no job: {FORM}")
    name = written["name"]
    robot = int(written["robot"])
    history = run.robots.get(robot)
    if history is None:
        raise WhyError(f"robot {robot} has no log in this recording; {robots_text(sorted(run.robots))} have")
    jobs = [job for job, _ in history.jobs if job.name == name]
    if not jobs:
        raise WhyError(_no_job(run.robots, name, robot))
    if at is not None:
        running = [job for job in jobs if job.start <= at <= _end(history, job)]
        if not running:
            spans = ", ".join(f"{in_seconds(job.start):.3f} to {in_seconds(_end(history, job)):.3f} s" for job in jobs)
            raise WhyError(f"{asked} did not run at {in_seconds(at):.3f} s, but from {spans}")
        jobs = running
    job = jobs[-1]
    if job.finish is None and not job.missed and job.deadline > history.ends:
        until = f"the run is known until {in_seconds(history.ends):.3f} s"
        raise WhyError(f"{asked} is not decided: its deadline is {in_seconds(job.deadline):.3f} s, {until}")
    return _explained(run, robot, job)


def undelivered(run: RecordedHistories, since: Instant = 0) -> list[LostDelivery]:
    """Return the deliveries of all robots that were given up, not before `since`, in order of time."""
    return sorted(each for history in run.robots.values() for each in history.undelivered if each.at >= since)


def is_missed(history: RobotHistory, job: TimedJob) -> bool:
    """Return whether the deadline of `job` has passed without its finish, and no later job of the robot replaces it.

    A robot that dies loses its jobs; the one that its next life starts counts instead.
    """
    lost = job.finish is None and not job.missed and job.deadline <= history.ends
    later = any(other.start > job.start and other.text == job.text for other, _ in history.jobs)
    return job.missed or (lost and not later)


def _explained(run: RecordedHistories, robot: int, job: TimedJob) -> Delay:
    return explained(run.robots, run.program, run.attempts, robot, job)


def _end(history: RobotHistory, job: TimedJob) -> Instant:
    return min(job.deadline, history.ends) if job.finish is None else job.finish


def _no_job(robots: Mapping[int, RobotHistory], name: str, robot: int) -> str:
    """Return why there is no job of that name at a robot, and what there is."""
    holders = sorted({holder for holder, history in robots.items() for job, _ in history.jobs if job.name == name})
    if holders:
        return f"robot {robot} has had no job {name}; {named(holders)} had"
    names = sorted({job.name for history in robots.values() for job, _ in history.jobs})
    if not names:
        return "no time assertion has started a job in this run: there is no deadline to explain"
    return f"no job of this run is called {name}; there are {', '.join(names)}"
