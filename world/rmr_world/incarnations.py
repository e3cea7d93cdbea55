"""A robot that was started again: one entry of the report for all of its lives.

What was counted is added up and what was done stands in order; what the robot holds, and when it finished, is told by
its last life. A job that was undecided when its robot's process died stays so, with the cause `DIED`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rmr_world.deadline_bound import DIED

COUNTED: Final = (
    "actions_failed", "actions_omitted", "assertions_omitted", "expression_failures", "undelivered", "ticks",
    "ticks_late", "tasks_skipped",
)  # fmt: skip
LISTED: Final = ("assertions", "actions")
FIRST: Final = ("first_failure", "first_undelivered")
"""Fields of a robot's part of the report of which all lives have a sum, one list, and the first one there is."""


def with_lost_jobs(part: Mapping[str, Any]) -> dict[str, Any]:
    """Return the `part` of a robot whose process has died, with the jobs marked that this has left undecided."""
    jobs = [job | {"cause": DIED} if job["met"] is None else job for job in part.get("assertions", ())]
    return {**part, "assertions": jobs}


def merged_report(past: Sequence[Mapping[str, Any]], part: Mapping[str, Any]) -> dict[str, Any]:
    """Return `part`, which is of the newest life, with what the lives before it (`past`, oldest first) add to it."""
    if not past:
        return dict(part)
    whole = dict(part)
    for name in COUNTED:
        whole[name] = sum(each.get(name, 0) for each in (*past, part))
    for name in LISTED:
        whole[name] = [item for each in (*past, part) for item in each.get(name, ())]
    for name in FIRST:
        whole[name] = next((each[name] for each in (*past, part) if each.get(name) is not None), None)
    frames = [each.get("frames", {}) for each in (*past, part)]
    names = dict.fromkeys(name for each in frames for name in each)
    whole["frames"] = {name: sum(each.get(name, 0) for each in frames) for name in names}
    return whole
