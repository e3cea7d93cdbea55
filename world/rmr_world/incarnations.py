"""One part of the report for all incarnations of a robot that was restarted.

Counters are summed and lists of actions and jobs are concatenated; facts and the time of finishing are those of the
last incarnation. A job that was undecided when its process ended stays undecided, with the fate of its robot as cause.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rmr_world.quorum import DIED, Fate

COUNTED: Final = (
    "actions_failed", "actions_unhandled", "actions_omitted", "assertions_omitted", "expression_failures",
    "undelivered", "unsendable", "ticks", "ticks_late", "tasks_skipped", "late_samples", "estimates_dropped",
    "samples_refused",
)  # fmt: skip
"""Fields of a robot's part of the report that are summed over its incarnations."""
LISTED: Final = ("assertions", "actions")
"""Fields that are concatenated."""
FIRST: Final = ("first_failure", "first_undelivered")
"""Fields that take the value of the first incarnation that has one."""

RESUMED: Final = "resumed"
"""Field of a durable robot that was brought back: all but the radio's counters covers its earlier incarnations."""

UNSAVED: Final = "unsaved"
"""Field of an incarnation: what its end loses (`rmr.node.report.unsaved`)."""
LOST: Final = "lost_in_restart"
"""Field of the whole: what the ends of the earlier incarnations have lost."""


def with_lost_jobs(part: Mapping[str, Any], fate: Fate = DIED) -> dict[str, Any]:
    """Return the `part` of a robot whose process has ended, with its `fate` as the cause in each undecided job."""
    jobs = [job | {"cause": fate} if job["met"] is None else job for job in part.get("assertions", ())]
    return {**part, "assertions": jobs}


def merged_report(past: Sequence[Mapping[str, Any]], part: Mapping[str, Any]) -> dict[str, Any]:
    """Return `part` of the newest incarnation, merged with the parts of the earlier ones (`past`, oldest first)."""
    whole = dict(part)
    whole.pop(UNSAVED, None)
    if not past:
        return whole
    if not part.get(RESUMED):
        for name in COUNTED:
            whole[name] = sum(each.get(name, 0) for each in (*past, part))
        for name in LISTED:
            whole[name] = [item for each in (*past, part) for item in each.get(name, ())]
        whole[LOST] = sum(each.get(UNSAVED, 0) for each in past)
        for name in FIRST:
            whole[name] = next((each[name] for each in (*past, part) if each.get(name) is not None), None)
    frames = [each.get("frames", {}) for each in (*past, part)]
    names = dict.fromkeys(name for each in frames for name in each)
    whole["frames"] = {name: sum(each.get(name, 0) for each in frames) for name in names}
    return whole
