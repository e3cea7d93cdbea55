"""Intervals cut at instants, and parts of them given to other owners."""

from rmr.base.time import NEVER, Instant
from rmr.why.delay_owner import Interval, TimeOwner
from rmr.why.robot_history import RobotHistory, overlaps


def deaths(history: RobotHistory) -> list[tuple[Instant, Instant]]:
    """Return from when to when a robot was dead after it had lived."""
    lives = history.lives
    begins = [begin for begin, _ in lives[1:]]
    return [(end, begin) for (_, end), begin in zip(lives, [*begins, NEVER], strict=True) if end < begin]


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
