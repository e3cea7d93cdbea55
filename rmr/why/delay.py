"""An explained delay as values: owners of time, intervals with one owner each, and the steps of a job.

A step of a job reaches from the end of the step before it, or the start of the job, to the end of its action on the
critical path: what has led to the action (rules, deliveries, turns) belongs to it. What comes after the last action is
a step without one. So the steps have neither gap nor overlap, and their sum is the job's time, to the nanosecond.
"""

from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from typing import Final, NamedTuple

from rmr.base.time import Duration, Instant
from rmr.node.standstill import Motion
from rmr.vm.job import TimedJob
from rmr.why.past_items import PastAction


class TimeOwner(Enum):
    """What a job has waited for, which owns an interval: docs/why-late.md says what each means.

    The values are the words of text and JSON.
    """

    RULE = "rule"
    TURN = "turn"
    DRIVE = "drive"
    STANDING = "standing"
    QUEUE = "queue"
    ACTION = "action"
    LOCALISATION = "localisation"
    OUTSIDE = "outside"
    RADIO_QUEUE = "radio queue"
    CHANNEL_ACCESS = "channel access"
    REPEATS = "repeats"
    LATE_TICK = "late tick"
    DEAD = "dead"
    STOPPED = "stopped"
    UNKNOWN = "unknown"


OWNER_OF: Mapping[Motion, TimeOwner] = {
    Motion.IDLE: TimeOwner.ACTION,
    Motion.LOCATES: TimeOwner.LOCALISATION,
    Motion.DRIVES: TimeOwner.DRIVE,
    Motion.GATED: TimeOwner.TURN,
    Motion.STANDS: TimeOwner.STANDING,
    Motion.UNWATCHED: TimeOwner.LATE_TICK,
}
"""Who owns the time of a drive, by what the wheels do."""


class Interval(NamedTuple):
    """A part of a job's time, with the one owner that the job waited for."""

    begin: Instant
    end: Instant
    owner: TimeOwner
    robot: int
    """Whose time it is."""
    whom: tuple[int, ...] = ()
    """The other robots that are the reason: those ahead, those stood for, the other end of a delivery."""
    detail: str = ""
    """Rule, action, place or delivery, in words."""

    @property
    def duration(self) -> Duration:
        """Nanoseconds."""
        return self.end - self.begin


def merged(intervals: Iterable[Interval]) -> tuple[Interval, ...]:
    """Return `intervals`, which are in the order of time; neighbours with one owner and one reason are one.

    A robot that stands for another one does so by rules that take turns from tick to tick: all of them are its detail.
    """
    found: list[Interval] = []
    for interval in intervals:
        last = found[-1] if found else None
        if last is None or last[2:5] != interval[2:5] or not (last.detail == interval.detail or _by_rules(interval)):
            found.append(interval)
            continue
        rules = dict.fromkeys([*last.detail.split(", "), interval.detail]) if _by_rules(interval) else [last.detail]
        found[-1] = last._replace(end=interval.end, detail=", ".join(rules))
    return tuple(found)


def _by_rules(interval: Interval) -> bool:
    return interval.owner is TimeOwner.STANDING and bool(interval.whom)


def without(
    parts: list[Interval], spans: list[tuple[Instant, Instant]], owner: TimeOwner, robot: int, detail: str
) -> list[Interval]:
    """Return `parts` with the time of `spans` given to `owner`."""
    result: list[Interval] = []
    for part in parts:
        at = part.begin
        for begin, end in overlaps(spans, part.begin, part.end):
            if begin > at:
                result.append(part._replace(begin=at, end=begin))
            result.append(Interval(begin, end, owner, robot, (), detail))
            at = end
        if at < part.end:
            result.append(part._replace(begin=at))
    return result


def cut_at(intervals: tuple[Interval, ...], at: Instant) -> tuple[Interval, ...]:
    """Return `intervals`, the one that reaches across an instant as two."""
    parts: list[Interval] = []
    for interval in intervals:
        if interval.begin < at < interval.end:
            parts += [interval._replace(end=at), interval._replace(begin=at)]
        else:
            parts.append(interval)
    return tuple(parts)


def overlaps(spans: Sequence[tuple[Instant, Instant]], begin: Instant, end: Instant) -> list[tuple[Instant, Instant]]:
    """Return the parts of `spans`, which are in order and apart, within [begin, end)."""
    return [(max(b, begin), min(e, end)) for b, e in spans if b < end and e > begin]


# -- the time of a job ------------------------------------------------------------------------------------------------


class PathAction(NamedTuple):
    """An action on the path."""

    end: Instant
    """When the path has left it: its end, or the end of the job's time."""
    robot: int
    text: str
    action: PastAction | None = None
    """As its robot knew it; None: no action, but what came after the last one."""


class Delay(NamedTuple):
    """The explained time of one job."""

    robot: int
    job: TimedJob
    end: Instant
    """When the path begins: the finish, else the deadline, or the end of the run if that came first."""
    learned: Instant | None
    """When the robot knew of the finish; None: never."""
    intervals: tuple[Interval, ...]
    """From the start to `end`, in the order of time; none reaches across the deadline."""
    actions: tuple[PathAction, ...] = ()
    """The actions on the path, in the order of their ends."""

    @property
    def lateness(self) -> int | None:
        """Nanoseconds from the deadline to the finish, negative if it was early; None: it never finished."""
        return None if self.learned is None else self.end - self.job.deadline


class DelayStep(NamedTuple):
    """A part of a job's time, up to the end of an action."""

    begin: Instant
    end: Instant
    robot: int
    """Which carries the action out; of the rest the robot of the job."""
    text: str
    """The action; of the rest, words."""
    is_action: bool
    owners: tuple[tuple[TimeOwner, tuple[int, ...], Duration], ...]
    """What the job waited for meanwhile, the largest first, with the other robots of turns, standing and queues."""
    begun: Instant | None
    """When the action began; None: it had not, or there is none."""
    due: Instant | None
    """By when the step had to end, so that the later ones had their time; None: its action had no turn of the job."""
    ended: bool
    """Whether the step was over by `end`."""

    @property
    def duration(self) -> Duration:
        """Nanoseconds."""
        return self.end - self.begin

    @property
    def lateness(self) -> int | None:
        """Nanoseconds by which the step ended after it was due, negative if it was early; None: not known."""
        return self.end - self.due if self.ended and self.due is not None else None


BY_ROBOT: Final = frozenset({TimeOwner.TURN, TimeOwner.STANDING, TimeOwner.QUEUE})
"""Owners whose time is added up by the other robot, whatever the rule."""


def steps_of(delay: Delay) -> tuple[DelayStep, ...]:
    """Return the steps of a job's time, in the order of time; none is empty."""
    ends = [each for each in delay.actions if each.end > delay.job.start]
    if not ends or ends[-1].end < delay.end:
        ends.append(PathAction(delay.end, delay.robot, "" if not ends else "after the last action"))
    steps: list[DelayStep] = []
    begin = delay.job.start
    for action in ends:
        if action.end > begin:
            steps.append(_step(delay, begin, action))
            begin = action.end
    return tuple(steps)


def _step(delay: Delay, begin: Instant, path: PathAction) -> DelayStep:
    owners: dict[tuple[TimeOwner, tuple[int, ...]], Duration] = {}
    for interval in cut_at(cut_at(delay.intervals, begin), path.end):
        if begin <= interval.begin < path.end:
            of = interval.owner, interval.whom if interval.owner in BY_ROBOT else ()
            owners[of] = owners.get(of, 0) + interval.duration
    largest = sorted(((*of, time) for of, time in owners.items()), key=lambda each: -each[2])
    text = path.text or "no action"
    action = path.action
    if action is None:
        over = delay.learned is not None
        return DelayStep(begin, path.end, path.robot, text, False, tuple(largest), None, delay.job.deadline, over)
    begun = action.begun if action.begun is not None and action.begun <= path.end else None
    due = action.due if action.job is delay.job else None
    ended = action.ended is not None and action.ended <= path.end
    return DelayStep(begin, path.end, path.robot, text, True, tuple(largest), begun, due, ended)
