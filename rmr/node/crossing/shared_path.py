"""The route that a leader shares with its followers, and the facts that tell who leads (paper IV.C, IV.D.1).

A new leader plans its route and offers the part that all need; robots that hear of it keep it by group and direction.
The program gets a fact for each assertion of which the robot leads a group; the robot may lead one group of an
assertion and follow in another.
"""

from collections.abc import Callable
from typing import Final, TypeVar

from rmr.base.grid_path import GridPath
from rmr.base.time import Instant
from rmr.base.values import Symbol
from rmr.coord.coordination import Coordination
from rmr.node.crossing.crossing import Crossing
from rmr.node.parts import CrossingHost

GROUPS_KEPT: Final = 32
"""Bound of the groups whose finished crossings, schedules and paths are kept; the oldest are dropped first."""

K = TypeVar("K")
V = TypeVar("V")


def keep(table: dict[K, V], key: K, value: V) -> None:
    """Put the newest value last in `table`, which keeps the `GROUPS_KEPT` newest."""
    table.pop(key, None)
    table[key] = value
    while len(table) > GROUPS_KEPT:
        del table[next(iter(table))]


class SharedPaths:
    """The groups that one robot leads, and the paths that leaders share."""

    def __init__(self, robot: CrossingHost, core: Coordination, name_of: Callable[[bytes], Symbol | None]) -> None:
        """`name_of` returns the name of the assertion behind a group."""
        self._robot = robot
        self._core = core
        self._name_of = name_of
        self._led: dict[bytes, None] = {}
        self._paths: dict[tuple[bytes, int], GridPath] = {}

    def path(self, group_id: bytes, direction: int) -> GridPath | None:
        """Return the part of the leader's path that all need who go in that direction."""
        return self._paths.get((group_id, direction))

    def received(self, group_id: bytes, direction: int, path: GridPath) -> None:
        """Keep what the leader of a group shares."""
        keep(self._paths, (group_id, direction), path)

    def leads(self, now: Instant, group_id: bytes, *, does: bool) -> None:
        """Note whether the robot leads a group, and state whether it leads any of the same assertion."""
        if does:
            keep(self._led, group_id, None)
        else:
            self._led.pop(group_id, None)
        name = self._name_of(group_id)
        if name is None:
            return
        if any(self._name_of(led) == name for led in self._led):
            self._robot.senses.add(now, "leads", (name,))
        else:
            self._robot.senses.drop(now, "leads", (name,))

    def offer(self, now: Instant, crossing: Crossing) -> None:
        """Plan the robot's route by `crossing`, whose group it leads, and offer the part that all need."""
        driver = self._robot.driver
        pose = self._robot.pose
        goal = crossing.goal
        if goal is None or driver is None or pose is None:
            return
        place = driver.place_of(now, goal, crossing.rank, crossing.place, self._robot.peers)
        passage = self._robot.config.arena.passage(crossing.plan.passage)
        paths = driver.approach.shared(pose, place, passage, crossing.plan.direction)
        for direction, path in paths.items():
            self.received(crossing.group_id, direction, path)
            self._core.offer_path(now, crossing.group_id, direction, path)
