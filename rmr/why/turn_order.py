"""Behind whom a robot waits for its turn: its wait, cut into one interval for each robot ahead.

At each instant it waits for the robot that has entered last and is still inside; while nobody is inside, for the next
of the schedule that is still to come; and where none is ahead, for its own slot. As long as no schedule that it knows
names it, those hold the resource that have slots by the newest schedule that anybody knows, and are yet to pass.

The resource is that of the group by which the action goes at that instant: a drive asks at one passage after the other.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from rmr.base.time import Instant
from rmr.coord.events import ScheduleChanged
from rmr.why.past_items import TurnGate
from rmr.why.robot_history import RobotHistory

NOT_ASKED = "it had not asked for a turn yet"
NOT_NAMED = "with slots while no schedule named the robot yet"
ONLY_PASSED = "no schedule named the robot yet; all that had slots had passed"
NOT_HEARD = "a schedule named the robot; it had not heard of that yet"
OWN_SLOT = "first in the schedule; its slot had not begun"


class Wait(NamedTuple):
    """A part of a wait."""

    begin: Instant
    end: Instant
    whom: tuple[int, ...]
    """The robots ahead; none where nobody is."""
    detail: str


def waits_behind(
    histories: Mapping[int, RobotHistory], robot: int, gates: Sequence[TurnGate], begin: Instant, end: Instant
) -> list[Wait]:
    """Return the parts of the wait of `robot` for its turn, in the order of time, without gap.

    `gates` are those by which its action went, in the order of time; without any, all groups are one.
    """
    edges = sorted({begin, end, *(gate.at for gate in gates if begin < gate.at < end)})
    parts: list[Wait] = []
    for since, until in pairwise(edges):
        gate = next((gate for gate in reversed(gates) if gate.at <= since), gates[0] if gates else None)
        parts += _Turn(histories, robot, gate).waits(since, until)
    return _joined(parts)


def _joined(parts: Sequence[Wait]) -> list[Wait]:
    joined: list[Wait] = []
    for part in parts:
        if joined and joined[-1][2:] == part[2:]:
            joined[-1] = joined[-1]._replace(end=part.end)
        else:
            joined.append(part)
    return joined


class _Turn:
    """What is known of one resource for which a robot waits."""

    def __init__(self, histories: Mapping[int, RobotHistory], robot: int, gate: TurnGate | None) -> None:
        self._histories = histories
        self._robot = robot
        self._gate = gate
        others = [history for history in histories.values() if history.robot != robot]
        self._passages = [
            (history.robot, span) for history in others for span in history.passages if self._here(span.group)
        ]
        self._orders = self._known_to(histories[robot])

    def _known_to(self, history: RobotHistory) -> list[tuple[Instant, ScheduleChanged]]:
        """Return the schedules of the resource that a robot has known, each from when on."""
        return [each for mind in history.minds for each in mind.schedule_log if self._here(each[1].group_id)]

    def _here(self, group: bytes) -> bool:
        return self._gate is None or self._gate.group == group

    def waits(self, begin: Instant, end: Instant) -> list[Wait]:
        """Return the parts of the wait from `begin` to `end`."""
        edges = {at for at, _ in self._orders}
        for _, passage in self._passages:
            edges.update((passage.entered, passage.left))
        parts: list[Wait] = []
        for since, until in pairwise(_between(edges, begin, end)):
            inside = [(span.entered, other) for other, span in self._passages if span.entered <= since < span.left]
            known, order = _newest(self._orders, since)
            if inside:
                parts.append(Wait(since, until, (max(inside)[1],), "inside"))
            elif self._robot in order:
                ahead = self._ahead(known, order[: order.index(self._robot)], since)
                parts.append(Wait(since, until, ahead[:1], "yet to enter" if ahead else OWN_SLOT))
            elif self._gate is not None and not self._gate.asked:
                parts.append(Wait(since, until, (), NOT_ASKED))
            else:
                parts += self._unnamed(since, until)
        return parts

    def _ahead(self, known: Instant, before: Sequence[int], at: Instant) -> tuple[int, ...]:
        """Return the robots `before` one in a schedule that have not passed since it was `known`."""
        passed = {other for other, passage in self._passages if known <= passage.left <= at}
        return tuple(other for other in before if other not in passed)

    def _unnamed(self, begin: Instant, end: Instant) -> list[Wait]:
        """Return the parts of a wait in which no schedule that the robot knows names it."""
        orders = [each for history in self._histories.values() for each in self._known_to(history)]
        orders.sort(key=lambda each: each[0])
        parts = []
        for since, until in pairwise(_between({at for at, _ in orders}, begin, end)):
            known, order = _newest(orders, since)
            if not orders or since < orders[0][0]:
                made = f"robot {orders[0][1].leader} made the first one" if orders else "none was made"
                parts.append(Wait(since, until, (), "nobody had a schedule yet; " + made))
            elif self._robot in order:
                parts.append(Wait(since, until, (), NOT_HEARD))
            else:
                ahead = self._ahead(known, order, since)
                parts.append(Wait(since, until, ahead, NOT_NAMED if ahead else ONLY_PASSED))
        return parts


def _between(edges: set[Instant], begin: Instant, end: Instant) -> list[Instant]:
    return sorted({begin, end, *(edge for edge in edges if begin < edge < end)})


def _newest(orders: Sequence[tuple[Instant, ScheduleChanged]], at: Instant) -> tuple[Instant, tuple[int, ...]]:
    """Return the order of the newest schedule that was known at an instant, and since when; without one nobody's."""
    return next(((known, each.order) for known, each in reversed(orders) if known <= at), (at, ()))
