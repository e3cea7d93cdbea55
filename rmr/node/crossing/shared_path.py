"""What a robot leads: the way that it shares with those that follow it, and the facts that say so (paper IV.C, IV.D.1).

A new leader plans its way and offers the part that all need; whoever hears of it keeps it by event and way. The program
is told of which assertions the robot leads an event: it may lead one event of an assertion and follow in another.
"""

from collections.abc import Callable

from rmr.base.grid_path import GridPath
from rmr.base.time import Instant
from rmr.base.values import Symbol
from rmr.coord.coordination import Coordination
from rmr.node.crossing.turn import Turn, keep
from rmr.node.parts import CrossingHost


class Leading:
    """The events that one robot leads, and the ways that leaders share."""

    def __init__(
        self, node: CrossingHost, coordination: Coordination, name_of: Callable[[bytes], Symbol | None]
    ) -> None:
        """`name_of` returns the name of the assertion behind an event."""
        self._node = node
        self._coordination = coordination
        self._name_of = name_of
        self._led: dict[bytes, None] = {}
        self._shared: dict[tuple[bytes, int], GridPath] = {}

    def shared(self, event: bytes, way: int) -> GridPath | None:
        """Return the part of the leader's path that all need who go that way."""
        return self._shared.get((event, way))

    def heard(self, event: bytes, way: int, path: GridPath) -> None:
        """Keep what the leader of `event` shares."""
        keep(self._shared, (event, way), path)

    def leads(self, now: Instant, event: bytes, *, does: bool) -> None:
        """Take note whether the robot leads `event`, and state whether it leads any of the same assertion."""
        if does:
            keep(self._led, event, None)
        else:
            self._led.pop(event, None)
        name = self._name_of(event)
        if name is not None:
            self._node.leads(now, name, any(self._name_of(led) == name for led in self._led))

    def share(self, now: Instant, turn: Turn) -> None:
        """Plan the robot's way by `turn`, whose event it leads, and offer the part that all need."""
        driver = self._node.driver
        pose = None if driver is None else driver.localiser.pose
        if turn.goal is None or driver is None or pose is None:
            return
        place = driver.place_of(now, turn.goal, turn.rank, turn.place, self._node.peers)
        for way, path in driver.approach.shared(pose, place, turn.way).items():
            keep(self._shared, (turn.event, way), path)
            self._coordination.offer_path(now, turn.event, way, path)
