"""Intervals cut at instants, and parts of them given to other owners."""

from collections.abc import Iterable

from rmr.base.time import NEVER, Instant
from rmr.why.delay_owner import Interval, TimeOwner
from rmr.why.robot_history import RobotHistory, overlaps


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


def absences(history: RobotHistory, *, stopped: bool) -> list[tuple[Instant, Instant]]:
    """Return from when to when a robot was dead after it had lived, or had been `stopped` in order."""
    lives = history.lives
    begins = [begin for begin, _ in lives[1:]]
    return [
        (end, begin)
        for (_, end), begin in zip(lives, [*begins, NEVER], strict=True)
        if end < begin and (end in history.stops) == stopped
    ]


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
