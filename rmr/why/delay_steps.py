"""The steps of a job: the actions on the critical path of its time, each with what its time went into.

A step reaches from the end of the step before it, or the start of the job, to the end of its action: what has led to
the action (rules, deliveries, turns) belongs to it. What comes after the last action is a step without one. So the
steps have neither gap nor overlap, and their sum is the job's time, to the nanosecond.
"""

from typing import NamedTuple

from rmr.base.time import Duration, Instant
from rmr.why.critical_path import Delay, PathAction
from rmr.why.delay_owner import TimeOwner
from rmr.why.interval_parts import cut_at


class DelayStep(NamedTuple):
    """A part of a job's time, up to the end of an action."""

    begin: Instant
    end: Instant
    robot: int
    """Which carries the action out; of the rest the robot of the job."""
    text: str
    """The action; of the rest, words."""
    is_action: bool
    owners: tuple[tuple[TimeOwner, Duration], ...]
    """What the job waited for meanwhile, the largest first."""

    @property
    def duration(self) -> Duration:
        """Nanoseconds."""
        return self.end - self.begin


def steps_of(delay: Delay) -> tuple[DelayStep, ...]:
    """Return the steps of a job's time, in the order of time; none is empty."""
    ends = [each for each in delay.actions if each.end > delay.job.start]
    if not ends or ends[-1].end < delay.end:
        ends.append(PathAction(delay.end, delay.robot, "" if not ends else "after the last action"))
    steps: list[DelayStep] = []
    begin = delay.job.start
    for action in ends:
        if action.end > begin:
            steps.append(_step(delay, begin, action, is_action=action in delay.actions))
            begin = action.end
    return tuple(steps)


def _step(delay: Delay, begin: Instant, action: PathAction, *, is_action: bool) -> DelayStep:
    owners: dict[TimeOwner, Duration] = {}
    for interval in cut_at(cut_at(delay.intervals, begin), action.end):
        if begin <= interval.begin < action.end:
            owners[interval.owner] = owners.get(interval.owner, 0) + interval.duration
    largest = sorted(owners.items(), key=lambda each: -each[1])
    text = action.text or "no action"
    return DelayStep(begin, action.end, action.robot, text, is_action, tuple(largest))
