"""The report of a run: the same document from processes and from the simulator.

`assemble` combines the robots' own reports, the world's observations and the figures that follow from the lab; `write`
stores it in the run's folder. Keys are sorted and floats rounded, so that equal runs give equal bytes. Numbers that
JSON lacks (the gap of a lone robot, the bound of an impossible lab) are null.
"""

import json
import math
import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from rmr.base.file_errors import naming
from rmr.base.printable import Paint, printable
from rmr.entry import JSON_VERSION
from rmr_world.bound import FreeTimes, Stream, bound_s, free_times
from rmr_world.fact_syntax import TermError, parse_fact
from rmr_world.lab import Lab
from rmr_world.quorum import DIED, NEVER_CAME, STOPPED, Fate, absence

REPORT_FILE = "report.json"
DECIMALS = 4
"""Decimals of all other floats."""

COLUMNS = ("robot", "deadline", "finish", "lateness", "met")
"""Columns of the table for people."""

_ROBOT_DEFAULTS: Mapping[str, Any] = {
    "finish_s": None,
    "distance_m": 0.0,
    "assertions": [],
    "facts": [],
    "goals": {"achieved": [], "open": []},
    "restarts": 0,
    "lost_in_restart": 0,
    "late_samples": 0,
    "off_m": None,
    "estimates_dropped": 0,
    "samples_refused": 0,
    "expression_failures": 0,
    "undelivered": 0,
    "frames": {"sent": 0, "received": 0, "collided": 0, "no_ack": 0, "access_failed": 0},
    "ticks": 0,
    "ticks_late": 0,
    "tasks_skipped": 0,
    "left_out": [],
}
"""Fields of a robot that has reported nothing of them."""


def assemble(
    lab: Lab,
    *,
    mode: str,
    seed: int,
    finished: bool,
    time_s: float,
    wall_s: float | None,
    robots: Mapping[int, Mapping[str, Any]],
    truth: Mapping[str, Any],
    bus_lost: int = 0,
    dead: Collection[int] = (),
) -> dict[str, Any]:
    """Return the report of a run of `lab`.

    `mode` is ``processes`` or ``simulated``; `time_s` is lab time up to the last robot's finish. `wall_s` is None
    if wall time would make equal runs differ. `robots` holds the last report of each robot; robots of the lab without
    one are added. `truth` comes from
    the world: ``collisions``, ``min_gap_m`` and ``distance_m`` by robot id. `dead` are the robots whose processes had
    ended at the end of the run.
    """
    parts = {robot: _robot_part(robot, robots.get(robot, {}), truth) for robot in sorted({*lab.roster, *robots})}
    for robot, part in parts.items():
        part["assertions"] = [{**job, "least_s": least_s(lab, robot, job)} for job in part["assertions"]]
    jobs = [job for part in parts.values() for job in part["assertions"]]
    report = {
        "version": JSON_VERSION,
        "lab": lab.name,
        "mode": mode,
        "seed": seed,
        "finished": finished,
        "finish": lab.finish,
        "quorum": lab.quorum,
        "dead": sorted(dead),
        "time_s": time_s,
        "wall_s": wall_s,
        "bound_s": bound_s(lab, dead),
        "robots": {str(robot): part for robot, part in parts.items()},
        "deadlines": {
            "met": sum(job["met"] is True for job in jobs),
            "missed": sum(job["met"] is False for job in jobs),
            "best_possible": best_possible(lab, parts),
        },
        "collisions": truth.get("collisions", 0),
        "min_gap_m": truth.get("min_gap_m"),
        "schedule": newest_schedules(robots),
        "bus": {"lost": bus_lost},
    }
    rounded: dict[str, Any] = _rounded(report)
    return rounded


def _robot_part(robot: int, said: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
    """Return one robot's part; the distance is the world's if it has measured one."""
    part = {**_ROBOT_DEFAULTS, **said}
    part.pop("schedules", None)
    ways: Mapping[Any, float] = truth.get("distance_m", {})
    way = ways.get(robot, ways.get(str(robot)))
    if way is not None:
        part["distance_m"] = way
    return part


def newest_schedules(robots: Mapping[int, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the newest schedule of each event, term and leader in the robots' reports (``schedules``), in this order.

    Most occur often: each robot reports the newest one that it has received or made.
    """
    newest: dict[tuple[str, int, int], dict[str, Any]] = {}
    for robot in sorted(robots):
        for item in robots[robot].get("schedules", ()):
            key = (item["event"], item["term"], item["leader"])
            if key not in newest or item["formed_s"] > newest[key]["formed_s"]:
                newest[key] = dict(item)
    return [newest[key] for key in sorted(newest)]


def _rounded(value: Any, key: str = "") -> Any:
    """Return `value` with floats rounded, and None for floats that JSON cannot express."""
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return round(value, 3 if key.endswith("_s") else DECIMALS) + 0.0  # no negative zero
    if isinstance(value, Mapping):
        return {str(name): _rounded(item, str(name)) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return value


def to_json(report: Mapping[str, Any]) -> str:
    """Return `report` as JSON text that is the same for equal reports."""
    return json.dumps(report, sort_keys=True, indent=2, allow_nan=False) + "\n"


def write(report: Mapping[str, Any], folder: Path) -> Path:
    """Write `report` into `folder`, which is made if it does not exist; return the file. It is replaced atomically.

    Raises OSError, which names the file, when it cannot be written.
    """
    path = folder / REPORT_FILE
    partial = folder / f".{REPORT_FILE}.{os.getpid()}"
    try:
        with naming(path):
            folder.mkdir(parents=True, exist_ok=True)
            partial.write_text(to_json(report), encoding="utf-8")
            partial.replace(path)
    except OSError:
        with suppress(OSError):
            partial.unlink()
        raise
    return path


class JobRow(NamedTuple):
    """One line of the table: a robot's job, or a robot without one."""

    robot: int
    deadline_s: float | None
    finish_s: float | None
    lateness_s: float | None
    """Finish minus deadline: negative when early."""
    met: bool | None
    """None if undecided, or without a deadline."""
    job: str
    """The finish fact; empty for a robot without a job."""
    fate: Fate | None = None
    """What became of a robot whose process had ended at the end of the run."""
    steps: Sequence[Mapping[str, Any]] = ()
    """Of a missed job with several steps that had turns: these steps."""

    def cells(self) -> tuple[str, str, str, str, str]:
        """Return the line as texts under COLUMNS."""
        lateness = "-" if self.lateness_s is None else f"{self.lateness_s:+.2f} s"
        met = "-" if self.met is None else "yes" if self.met else "no"
        finish = self.fate if self.fate and self.finish_s is None else _seconds(self.finish_s)
        return f"@{self.robot}", _seconds(self.deadline_s), finish, lateness, met


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} s"


def rows(report: Mapping[str, Any]) -> list[JobRow]:
    """Return the table's lines, the earliest deadline first."""
    found: list[JobRow] = []
    fates = _fates(report)
    for name, part in report["robots"].items():
        jobs = part["assertions"] or [{"deadline_s": None, "finish_s": part["finish_s"], "met": None, "job": ""}]
        for job in jobs:
            deadline = job["deadline_s"]
            finish = job["finish_s"]
            lateness = None if deadline is None or finish is None else finish - deadline
            robot = int(name)
            steps = [step for step in job.get("steps", ()) if step["due_ns"] is not None and step["action"] is not None]
            fate = fates.get(robot)
            row = JobRow(robot, deadline, finish, lateness, job["met"], job["job"], fate, steps if steps[1:] else ())
            found.append(row)
    return sorted(found, key=lambda row: (math.inf if row.deadline_s is None else row.deadline_s, row.robot))


def table_rows(report: Mapping[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Return the cells of the table, line by line, under COLUMNS."""
    return [row.cells() for row in rows(report)]


def summary(report: Mapping[str, Any]) -> str:
    """Return the run in one line."""
    state = "finished" if report["finished"] else "not finished"
    bound = f" ({report['time_s'] / report['bound_s']:.2f} x bound)" if report["bound_s"] else ""
    gap = "-" if report["min_gap_m"] is None else f"{report['min_gap_m'] * 1000:.0f} mm"
    deadlines = report["deadlines"]
    judged = deadlines["met"] + deadlines["missed"]
    absent = absence(_fates(report))
    return (
        f"{report['lab']}: {state} after {report['time_s']:.2f} s{bound}, deadlines met {deadlines['met']} of "
        f"{judged}, contacts {report['collisions']}, smallest gap {gap}{'; ' if absent else ''}{absent}"
    )


def _fates(report: Mapping[str, Any]) -> dict[int, Fate]:
    """Return what became of the robots that were not there when the run was over."""
    fates: dict[int, Fate] = dict.fromkeys(report.get("dead", ()), DIED)
    fates |= dict.fromkeys(report.get("stopped", ()), STOPPED)
    return fates | dict.fromkeys(report.get("never_came", ()), NEVER_CAME)


def table_text(report: Mapping[str, Any], who: str = "", *, color: bool = False) -> str:
    """Return the table and, behind `who`, the summary; missed jobs with several contended steps step by step.

    Where a robot had more than one job the table says which is which.
    """
    several = any(len(part["assertions"]) > 1 for part in report["robots"].values())
    lines: list[tuple[tuple[str, str, str, str, str], str]] = [(COLUMNS, "job" if several else "")]
    for row in rows(report):
        lines.append((row.cells(), row.job if several else ""))
        lines += [_step_line(step) for step in row.steps[:8]]
    widths = [max(len(cells[k]) for cells, _ in lines) for k in range(len(COLUMNS))]
    paint = Paint(color)
    styles = {"yes": "green", "no": "bold red"}
    table: list[str] = []
    for cells, words in lines:
        *others, met = map(str.rjust, cells, widths)
        line = "  ".join([*others, paint(styles.get(cells[-1], ""), met), printable(words)]).rstrip()
        table.append(line if table else paint("bold", line))
    return "\n".join([*table, f"{who}{summary(report)}"])


def _step_line(step: Mapping[str, Any]) -> tuple[tuple[str, str, str, str, str], str]:
    """Return a step of a job under COLUMNS, and what it was, with what its time went into."""
    behind = f" behind {_robots(step['behind'])}" if step["behind"] else ""
    largest = sorted(step["time_ns"].items(), key=lambda each: -each[1])
    times = (f"{word}{behind if word == 'turn' else ''} {time / 1e9:.2f} s" for word, time in largest)
    late = step["late_ns"]
    end = _seconds(None if late is None else step["end_ns"] / 1e9)
    cells = "step", _seconds(step["due_ns"] / 1e9), end, "-" if late is None else f"{late / 1e9:+.2f} s", ""
    return cells, f"{step['action']}: {', '.join(times)}"


def _robots(identities: Sequence[int]) -> str:
    return f"robot{'s' if len(identities) > 1 else ''} {', '.join(map(str, identities))}"


# ---- upper bound of the number of deadlines that any schedule could have met, to compare a run's misses with
#
# A job that ends with the lab's finish fact takes at least the robot's free-flow trip. At a bottleneck, robots also
# enter at least one body length apart and, when the direction changes, a whole passage apart. This is scheduling on
# a single machine with equal processing times and set-up times between two job families (one for each entrance),
# with release times relaxed to the earliest of the family. Within a family earliest deadline first is then optimal,
# by an exchange argument. It is enough to search all merges of the two sequences, leaving out jobs that come too
# late (dynamic programming). All other jobs are taken as possible; if there are only such jobs, no bound is known.


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
    # So many pairs take too long: each family is bounded by itself, which is weaker.
    if len(jobs[0]) * len(jobs[1]) > 2500:
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
