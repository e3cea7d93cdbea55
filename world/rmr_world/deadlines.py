"""How many deadlines could have been met at all: what a run's misses are to be measured against.

An upper bound, not a schedule. A robot's job that ends with the lab's finish fact takes at least its free-flow
trip; where the lab has a bottleneck, robots also pass its middle at least one body's length apart. The second
condition is a single machine with equal processing times; release times are relaxed to the earliest one, for
which taking jobs in order of deadline and dropping what comes too late is optimal (Moore 1968; with equal times
every dropped job is as good as any other). All other jobs are taken as possible.
"""

from collections.abc import Mapping
from typing import Any

from rmr_world.bound import FreeTimes, free_times
from rmr_world.lab import Lab
from rmr_world.terms import TermError, parse_fact


def best_possible(lab: Lab, robots: Mapping[int, Mapping[str, Any]]) -> int:
    """Return an upper bound of the deadlines that any schedule could meet.

    `robots` holds each robot's part of the report; its assertions' `deadline_s` and `start_s` are lab time.
    """
    jobs = [(robot, job) for robot in sorted(robots) for job in robots[robot].get("assertions", ())]
    trips = [(robot, job) for robot, job in jobs if _is_trip(lab, job)]
    met = sum(job.get("met") is True for _, job in jobs)
    if not trips:
        return len(jobs)
    times = free_times(lab)
    if not times.trips:
        return len(jobs)  # the finish fact is no place to drive to
    row = {start.id: index for index, start in enumerate(lab.robots)}
    in_time = sorted(
        job["deadline_s"]
        for robot, job in trips
        if robot in row and job["deadline_s"] >= min(times.trips[row[robot]], default=0.0)
    )
    possible = _through_bottleneck(in_time, times) if times.approaches else len(in_time)
    return max(met, len(jobs) - len(trips) + possible)


def _is_trip(lab: Lab, job: Mapping[str, Any]) -> bool:
    """Return whether the job's finish fact is the lab's."""
    pattern = lab.finish_pattern
    if pattern is None:
        return False
    try:
        return parse_fact(job["job"]).name == pattern.name
    except TermError:
        return False


def _through_bottleneck(deadlines: list[float], times: FreeTimes) -> int:
    """Return how many of the jobs, in order of deadline, can be through in time one behind the other."""
    earliest = min(times.approaches) + min(times.departures, default=0.0)
    passed = 0
    for deadline in deadlines:
        if earliest + passed * times.spacing <= deadline:
            passed += 1
    return passed
