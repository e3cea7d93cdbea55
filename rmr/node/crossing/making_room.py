"""A robot that waits for its turn where the one whose turn it is wants to go: it makes room.

It would leave with its own turn, but that comes only when the other one has arrived. So it drives to free floor, off
the way of the other one, and waits there. Who has no turn to wait for stays: its place is taken, and the drive of the
other one fails with that reason.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from rmr.base.geometry import Point, distance
from rmr.base.time import Duration, Instant, milliseconds, seconds
from rmr.node.crossing.crossing import Crossing
from rmr.node.motion.grid import TIGHT_MARGIN_M
from rmr.node.motion.route import leader_route
from rmr.node.motion.standoff.refuge import retreat_route
from rmr.node.parts import CrossingHost

STANDS: Final[Duration] = seconds(2)
"""The other one has found no way for so long."""
MOVED_M: Final = 0.03
"""Positions that differ by less are one: hellos tell centimetres of an estimate."""
LOOK_EVERY: Final[Duration] = milliseconds(500)


class Trip(NamedTuple):
    """Where another robot is and where it wants to go."""

    start: Point
    goal: Point


class MakingRoom:
    """Looks whether one robot that waits for its turn is in the way of the one whose turn it is."""

    def __init__(self, robot: CrossingHost) -> None:
        self._robot = robot
        self._look_at: Instant = 0
        self._trip: Trip | None = None
        """That of the other one, since it stands where it is."""
        self._since: Instant = 0
        self._tries = 0

    def step(self, now: Instant, crossing: Crossing, inside: Sequence[int]) -> None:
        """Drive off the goal of a robot that is `inside` the resource of `crossing` and stands, if this one waits."""
        robot = self._robot
        driver = robot.driver
        pose = robot.pose
        held = crossing.action
        if now < self._look_at or driver is None or pose is None or held is None or held.started is not None:
            return
        self._look_at = now + LOOK_EVERY
        here = Point(pose.x, pose.y)
        trip = self._trip_here(now, here, inside)
        if trip is None or robot.driving is not None or driver.navigator.status == "moving":
            self._trip = None
            return
        if self._trip is None or distance(*self._trip.start, *trip.start) > MOVED_M:
            self._trip = trip
            self._since = now
        if now - self._since < STANDS:
            return
        self._tries += 1
        others = robot.peers.parked(now)
        goal = here if crossing.goal is None else crossing.goal.places[0]
        way = leader_route(driver.arena, *trip, [at for at in others if at != trip.start], through_gate=False)
        paths = () if way is None else (way,)
        route = retreat_route(driver.arena, here, goal, others, robot.config.robot, self._tries, paths)
        if route is not None:
            driver.depart(now, route.points[-1], robot.peers, heading=None, gated=False, shared=None)

    def _trip_here(self, now: Instant, here: Point, inside: Sequence[int]) -> Trip | None:
        """Return the trip of a robot `inside` that wants to go where this one stands; None if there is none."""
        reach = 2.0 * self._robot.config.arena.shape.radius + TIGHT_MARGIN_M
        for other, hello in self._robot.peers.claims(now):
            if other in inside and hello.goal is not None:
                trip = Trip(Point(hello.x, hello.y), Point(*hello.goal))
                if distance(*trip.goal, *here) < reach <= distance(*trip.goal, *trip.start):
                    return trip
        return None
