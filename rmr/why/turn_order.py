"""Behind whom a robot waits for its turn: its wait, cut into one interval for each robot ahead.

At each instant it waits for the robot that has entered last and is still inside; while nobody is inside, for the next
of the schedule that is still to come; and where none is ahead, for the schedule itself or for its own slot.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from rmr.base.time import Instant
from rmr.why.robot_history import KnownOrder, PassageSpan, RobotHistory

NO_SCHEDULE = "no schedule named the robot yet"
OWN_SLOT = "first in the schedule; its slot had not begun"


class Wait(NamedTuple):
    """A part of a wait."""

    begin: Instant
    end: Instant
    whom: tuple[int, ...]
    """The robot ahead; none where nobody is."""
    detail: str


def waits_behind(
    histories: Mapping[int, RobotHistory], robot: int, group: str | None, begin: Instant, end: Instant
) -> list[Wait]:
    """Return the parts of the wait of `robot` for its turn in `group`, in the order of time, without gap."""
    passages = [
        (history.robot, passage)
        for history in histories.values()
        if history.robot != robot
        for passage in history.passages
        if group in (None, passage.group)
    ]
    orders = [order for order in histories[robot].orders if group in (None, order.group)]
    edges = {begin, end}
    edges.update(order.at for order in orders)
    for _, passage in passages:
        edges.update((passage.entered, passage.left))
    inside = sorted(edge for edge in edges if begin <= edge <= end)
    parts: list[Wait] = []
    for since, until in pairwise(inside):
        whom, detail = _behind(robot, since, passages, orders)
        if parts and parts[-1][2:] == (whom, detail):
            parts[-1] = parts[-1]._replace(end=until)
        else:
            parts.append(Wait(since, until, whom, detail))
    return parts


def _behind(
    robot: int, at: Instant, passages: list[tuple[int, PassageSpan]], orders: list[KnownOrder]
) -> tuple[tuple[int, ...], str]:
    """Return behind whom `robot` waits at an instant, and what that one does."""
    inside = [(passage.entered, other) for other, passage in passages if passage.entered <= at < passage.left]
    if inside:
        return (max(inside)[1],), "inside"
    known = [order for order in orders if order.at <= at]
    order = known[-1] if known else None
    if order is None or robot not in order.robots:
        return (), NO_SCHEDULE
    passed = {other for other, passage in passages if order.at <= passage.left <= at}
    ahead = [other for other in order.robots[: order.robots.index(robot)] if other not in passed]
    return ((ahead[0],), "yet to enter") if ahead else ((), OWN_SLOT)
