"""The report of a run: the same document from processes and from the simulator.

`assemble` combines the robots' own reports, the world's observations and the figures that follow from the lab; `write`
stores it in the run's folder. Keys are sorted and floats rounded, so that equal runs give equal bytes. Numbers that
JSON lacks (the gap of a lone robot, the bound of an impossible lab) are null.
"""

import json
import math
import os
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from rmr.base.file_errors import naming
from rmr.entry import JSON_VERSION
from rmr_world.bound import bound_s
from rmr_world.deadline_bound import best_possible, least_s
from rmr_world.lab import Lab
from rmr_world.quorum import DIED, NEVER_CAME, STOPPED, Fate, absence

REPORT_FILE = "report.json"
SECONDS_DECIMALS = 3
"""Decimals of values whose key ends in ``_s``."""
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
    schedule: Iterable[Mapping[str, Any]] | None = None,
    bus_lost: int = 0,
    dead: Collection[int] = (),
) -> dict[str, Any]:
    """Return the report of a run of `lab`.

    `mode` is ``processes`` or ``simulated``; `time_s` is lab time up to the last robot's finish. `wall_s` is None
    if wall time would make equal runs differ. `robots` holds the last report of each robot; robots of the lab without
    one are added. `schedule` is by default the newest schedule of each event in the robots' reports. `truth` comes from
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
        "schedule": newest_schedules(robots) if schedule is None else [dict(item) for item in schedule],
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
        return round(value, SECONDS_DECIMALS if key.endswith("_s") else DECIMALS) + 0.0  # no negative zero
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
            found.append(JobRow(robot, deadline, finish, lateness, job["met"], job["job"], fates.get(robot)))
    return sorted(found, key=lambda row: (math.inf if row.deadline_s is None else row.deadline_s, row.robot))


def several_jobs(report: Mapping[str, Any]) -> bool:
    """Return whether a robot had more than one job, so that the table has to say which is which."""
    return any(len(part["assertions"]) > 1 for part in report["robots"].values())


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


def table_text(report: Mapping[str, Any]) -> str:
    """Return the table and the summary as plain text."""
    lines = [COLUMNS, *table_rows(report)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(COLUMNS))]
    table = ["  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in lines]
    if several_jobs(report):
        jobs = ["job", *(row.job for row in rows(report))]
        table = [f"{line}  {job}".rstrip() for line, job in zip(table, jobs, strict=True)]
    return "\n".join([*table, summary(report)])
