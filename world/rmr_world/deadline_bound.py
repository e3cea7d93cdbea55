"""Upper bound of the number of deadlines that any schedule could have met, to compare a run's misses with.

A job that ends with the lab's finish fact takes at least the robot's free-flow trip. At a bottleneck, robots also enter
at least one body length apart and, when the direction changes, a whole passage apart. This is scheduling on a single
machine with equal processing times and set-up times between two job families (one for each entrance), with release
times relaxed to the earliest of the family. Within a family earliest deadline first is then optimal, by an exchange
argument. It is enough to search all merges of the two sequences, leaving out jobs that come too late (dynamic
programming). All other jobs are taken as possible; if there are only such jobs, no bound is known.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rmr_world.bound import FreeTimes, Stream, free_times
from rmr_world.fact_syntax import TermError, parse_fact
from rmr_world.lab import Lab
from rmr_world.quorum import DIED, STOPPED

PAIRS_MAX = 2500
"""Bound of the product of two families' sizes; beyond it each family is bounded by itself, which is weaker."""

_Job = tuple[float, float]
"""Earliest and latest entry of a job that meets its deadline, seconds."""
_Reached = dict[tuple[int, int], float]
"""Earliest instant of the last entry, by the family that entered last and the number of entries."""


def best_possible(lab: Lab, robots: Mapping[int, Mapping[str, Any]]) -> int | None:
    """Return an upper bound of the deadlines that any schedule could meet, without jobs whose process ended.

    None if no bound is known: some deadline was missed, and the lab gives no job a least time.
    `robots` holds each robot's part of the report; its assertions' `deadline_s` and `start_s` are lab time.
    """
    told = [(at, job) for at in sorted(robots) for job in robots[at].get("assertions", ())]
    jobs = [(at, job) for at, job in told if job.get("cause") not in (DIED, STOPPED)]
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
    """Return the earliest time at which `robot` could finish `job`: its free-flow trip, seconds; None if not known.

    A deadline before it could not be met.
    """
    if not _is_trip(lab, job):
        return None
    for stream in free_times(lab).streams:
        if robot in stream.robots and stream.trips:
            return min(stream.trips[stream.robots.index(robot)], default=None)
    return None


def _in_time(stream: Stream, trips: Sequence[tuple[int, Mapping[str, Any]]]) -> list[float]:
    """Return the deadlines of the stream's robots that a free-flow trip can meet, in order."""
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
    """Return how many of the jobs can pass the bottleneck in time."""
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

    `reached[i, j]` is the state after the first i and j jobs have been taken or dropped.
    """
    reached: dict[tuple[int, int], _Reached] = {(0, 0): {(0, 0): -math.inf}}
    here: _Reached = {}
    for i in range(len(one) + 1):
        for j in range(len(other) + 1):
            here = reached.pop((i, j))
            if i < len(one):
                _extend(here, reached.setdefault((i + 1, j), {}), 0, one[i], times)
            if j < len(other):
                _extend(here, reached.setdefault((i, j + 1), {}), 1, other[j], times)
    return max(count for _, count in here)


def _extend(before: _Reached, after: _Reached, family: int, job: _Job, times: FreeTimes) -> None:
    """Extend the states `before` to `after`: `job` of `family` enters next if it is in time, or is dropped."""
    earliest, latest = job
    for (last, count), at in before.items():
        dropped = (last, count)
        taken = (family, count + 1)
        after[dropped] = min(at, after.get(dropped, math.inf))
        entry = max(earliest, at + (times.spacing if family == last else times.turnaround))
        if entry <= latest:
            after[taken] = min(entry, after.get(taken, math.inf))
