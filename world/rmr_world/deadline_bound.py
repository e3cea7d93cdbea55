"""How many deadlines could have been met at all: what a run's misses are to be measured against.

An upper bound, not a schedule. A robot's job that ends with the lab's finish fact takes at least its free-flow
trip; where the lab has a bottleneck, robots also enter it at least one body's length apart and, where they come
from both sides, a whole passage apart when the direction changes. That is a single machine with equal processing
times and setup times between two entrances; release times are relaxed to each group's earliest one. Within a
group the order of deadlines is then optimal (of two that are both on time the earlier due may go first), so it is
enough to look at all ways of merging the two, dropping what comes too late. Beside such jobs all others are taken as
possible; of those alone no bound is known.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rmr_world.bound import FreeTimes, Stream, free_times
from rmr_world.fact_syntax import TermError, parse_fact
from rmr_world.lab import Lab

DIED = "died"
"""Cause of a job that is undecided for good: its robot's process died, and with it the job."""
PAIRS_MAX = 2500
"""Merging takes the product of two entrances' sizes, and their sum; beyond this each is looked at by itself."""

_Job = tuple[float, float]
"""When it can enter at the earliest, and at the latest."""
_Reached = dict[tuple[int, int], float]
"""By the group that entered last and by how many have entered: the instant of the last entry."""


def best_possible(lab: Lab, robots: Mapping[int, Mapping[str, Any]]) -> int | None:
    """Return an upper bound of the deadlines that any schedule could meet, of jobs that lived to see them.

    None where nothing is known: some job was not met in time, and no job's least time follows from the lab.
    `robots` holds each robot's part of the report; its assertions' `deadline_s` and `start_s` are lab time.
    """
    jobs = [(at, job) for at in sorted(robots) for job in robots[at].get("assertions", ()) if job.get("cause") != DIED]
    trips = [(robot, job) for robot, job in jobs if _is_trip(lab, job)]
    met = sum(job.get("met") is True for _, job in jobs)
    if met == len(jobs):
        return met
    if not trips:
        return None
    times = free_times(lab)
    if not any(stream.trips for stream in times.streams):
        return None  # the finish fact is no place to drive to
    in_time = [_in_time(stream, trips) for stream in times.streams]
    possible = sum(len(due) for stream, due in zip(times.streams, in_time, strict=True) if not stream.approaches)
    possible += _through_bottleneck(times, in_time)
    strangers = sum(all(robot not in stream.robots for stream in times.streams) for robot, _ in trips)
    return max(met, len(jobs) - len(trips) + possible + strangers)


def least_s(lab: Lab, robot: int, job: Mapping[str, Any]) -> float | None:
    """Return when `robot` could finish `job` at the earliest: after its free trip; None where that is not known.

    A deadline before it was impossible from the beginning.
    """
    if not _is_trip(lab, job):
        return None
    for stream in free_times(lab).streams:
        if robot in stream.robots and stream.trips:
            return min(stream.trips[stream.robots.index(robot)], default=None)
    return None


def _in_time(stream: Stream, trips: Sequence[tuple[int, Mapping[str, Any]]]) -> list[float]:
    """Return the deadlines of the stream's robots that a free trip can meet, in order."""
    least = dict(zip(stream.robots, (min(row, default=0.0) for row in stream.trips), strict=False))
    due = [(robot, float(job["deadline_s"])) for robot, job in trips if robot in stream.robots]
    return sorted(deadline for robot, deadline in due if deadline >= least.get(robot, 0.0))


def _is_trip(lab: Lab, job: Mapping[str, Any]) -> bool:
    """Return whether the job's finish fact is the lab's."""
    pattern = lab.finish_pattern
    if pattern is None:
        return False
    try:
        return parse_fact(job["job"]).name == pattern.name
    except TermError:
        return False


def _through_bottleneck(times: FreeTimes, in_time: Sequence[list[float]]) -> int:
    """Return how many of the jobs can be through in time one behind the other."""
    entrances = times.entrances
    due: dict[int, list[float]] = {mouth: [] for mouth in entrances}
    for stream, deadlines in zip(times.streams, in_time, strict=True):
        if stream.mouth in due:
            due[stream.mouth] += deadlines
    jobs: list[list[_Job]] = [[], []]
    for mouth, group in entrances.items():
        jobs[mouth] = [(group.approach, deadline - group.departure) for deadline in sorted(due[mouth])]
    if len(jobs[0]) * len(jobs[1]) > PAIRS_MAX:
        return _merged(times, jobs[0], []) + _merged(times, [], jobs[1])
    return _merged(times, *jobs)


def _merged(times: FreeTimes, one: Sequence[_Job], other: Sequence[_Job]) -> int:
    """Return how many jobs of two entrances can enter in time, each group in order of deadline.

    `reached[i, j]` tells, where the first i and j of them have been looked at, for each group that entered last and
    each number that have, the earliest instant of that last entry.
    """
    reached: dict[tuple[int, int], _Reached] = {(0, 0): {(0, 0): -math.inf}}
    here: _Reached = {}
    for i in range(len(one) + 1):
        for j in range(len(other) + 1):
            here = reached.pop((i, j))
            if i < len(one):
                _look(here, reached.setdefault((i + 1, j), {}), 0, one[i], times)
            if j < len(other):
                _look(here, reached.setdefault((i, j + 1), {}), 1, other[j], times)
    return max(count for _, count in here)


def _look(before: _Reached, after: _Reached, group: int, job: _Job, times: FreeTimes) -> None:
    """Let `job` of `group` enter next where it is in time, or drop it."""
    earliest, latest = job
    for (last, count), at in before.items():
        dropped = (last, count)
        taken = (group, count + 1)
        after[dropped] = min(at, after.get(dropped, math.inf))
        entry = max(earliest, at + (times.spacing if group == last else times.turnaround))
        if entry <= latest:
            after[taken] = min(entry, after.get(taken, math.inf))
