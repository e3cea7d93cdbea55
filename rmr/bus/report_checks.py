"""The check of the part of a run's report that a robot or the world sends in a `Status`.

What the launcher reads has its type; fields that it does not know are plain data and pass. Texts are those of the
program's facts and stay as they are: who shows them makes them printable.
"""

from typing import Final

from rmr.bus.checks import Check, by_name, count, each, fields, flag, group, number, optional, people, robot, text

_JOB: Final = fields(
    {
        "name": text,
        "job": text,
        "start_s": number,
        "finish_s": optional(number),
        "deadline_s": number,
        "met": optional(flag),
    },
    {"cause": optional(text)},
)
_SCHEDULE: Final = fields(
    {"event": text, "leader": robot, "term": count, "order": each(robot), "formed_s": number},
)
_COUNTERS: Final = fields({}, {"lost": count, "malformed": count})

PART: Final[dict[str, Check]] = {
    "finish_s": optional(number),
    "distance_m": number,
    "assertions": each(_JOB),
    "facts": each(text),
    "goals": fields({"achieved": each(group(text, number)), "open": each(text)}),
    "actions": each(group(number, text)),
    "restarts": count,
    "unsaved": count,
    "resumed": flag,
    "expression_failures": count,
    "undelivered": count,
    "unsendable": count,
    "frames": by_name(count),
    "ticks": count,
    "ticks_late": count,
    "tasks_skipped": count,
    "schedules": each(_SCHEDULE),
    "bus": _COUNTERS,
    "left_out": each(text),
    "log_cut_short": people,
    "late_samples": count,
    "off_m": optional(number),
    "estimates_dropped": count,
    "samples_refused": count,
    "late_commands": each(group(robot, count, number)),
    "faults": each(fields({"from": number}, {"to": number})),
}
"""Checks of the fields of a part, by name; other fields may be any plain data."""

report: Final = fields({}, PART)
"""Accepts a part of the report."""
