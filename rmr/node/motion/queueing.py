"""Waiting behind others in the gate's queue: those that stand before this robot there go first, for a bounded time."""

from collections.abc import Sequence
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance
from rmr.base.time import Duration, Instant, seconds
from rmr.node.motion.route import off_queue

REACH_M: Final = 0.3
"""A waiting robot keeps the one behind it waiting if it is this near."""
OVERTAKE: Final[Duration] = seconds(4)
"""A robot that goes first and still stands there so long after this one's slot began has failed."""


class Queueing:
    """What one robot has seen of its queue during one drive."""

    __slots__ = ("_late_since", "late", "overtakes")

    def __init__(self) -> None:
        self._late_since: Instant | None = None
        self.late = False
        """Whether a robot that goes first has waited for `OVERTAKE` since this one's slot began."""
        self.overtakes = False
        """Whether this robot no longer waits for those that stand before it."""

    def waits(self, now: Instant, arena: Arena, at: Point, parked: Sequence[Point], opens_at: Instant | None) -> bool:
        """Return whether one of `parked` that goes first stands before a robot `at` a place on its way to the gate."""
        x = at.x
        y = at.y
        near = [p for p in parked if abs(p.x - x) < REACH_M and abs(p.y - y) < REACH_M and distance(*p, x, y) < REACH_M]
        if not near or len(off_queue(arena, at, near)) == len(near):
            self._late_since = None
            return False
        if opens_at is not None and now > opens_at and self._late_since is None:
            self._late_since = now
        self.late = self._late_since is not None and now - self._late_since > OVERTAKE
        return True
