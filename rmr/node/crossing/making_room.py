"""A robot that waits for its turn where another one wants to go, or in the only way of the one whose turn it is.

It makes room: it would leave with its own turn, but that may come only when the other one has arrived. So it drives to
free floor, off the way of the other one, and waits there. Who has no turn to wait for stays: its place is taken, and
the drive of the other one fails with that reason.

So too a robot that has a station for which others wait, while it waits for another one itself. To hold one and to wait
for the next is how two robots that change places would wait for ever (Coffman's second condition).
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from rmr.base.arena import Area
from rmr.base.geometry import Point, distance
from rmr.base.time import Duration, Instant, milliseconds, seconds
from rmr.node.crossing.crossing import Crossing
from rmr.node.driver import Driver
from rmr.node.motion.astar import plan
from rmr.node.motion.grid import PATH_MARGIN_M
from rmr.node.motion.route import Route, leader_route
from rmr.node.motion.standoff.refuge import retreat_route
from rmr.node.parts import CrossingHost

NOWHERE: Final[Duration] = seconds(2)
"""The other one has got nowhere for so long: no farther than a hull is wide."""
LOOK_EVERY: Final[Duration] = milliseconds(500)


class Trip(NamedTuple):
    """Where another robot is and where it wants to go."""

    start: Point
    goal: Point


class MakingRoom:
    """Looks whether one robot that waits for its turn is in the way of another one."""

    def __init__(self, robot: CrossingHost) -> None:
        self._robot = robot
        self._look_at: Instant = 0
        self._tries = 0
        self._seen: dict[int, tuple[Point, Instant]] = {}
        """Where each robot that drives is that has got nowhere since, and since when."""

    def step(
        self, now: Instant, crossing: Crossing, inside: Sequence[int], listed: Sequence[int], station: Area | None
    ) -> None:
        """Drive out of the way of a robot that gets nowhere, if this one waits for `crossing`.

        One that is `inside` may want to pass; any other one that drives may want to come here. Before a gate those that
        are `listed` for a turn there follow up in the queue, and do not count. Others need the place of this robot in
        the `station`; None: it is in none, or nobody does.
        """
        robot = self._robot
        driver = robot.driver
        pose = robot.pose
        held = crossing.action
        if now < self._look_at or driver is None or pose is None or held is None:
            return
        waits = held.started is not None and driver.navigator.waits(now)
        if held.started is not None and not waits:
            return
        self._look_at = now + LOOK_EVERY
        here = Point(pose.x, pose.y)
        stands = waits or (robot.driving is None and driver.navigator.status != "moving")
        goal = here if crossing.goal is None else crossing.goal.places[0]
        if station is not None and stands and not robot.acts:
            self._make_room(now, driver, here, goal)
            return
        reach = 2.0 * driver.arena.shape.radius + PATH_MARGIN_M
        for other, hello in robot.peers.claims(now):
            comes = hello.goal is not None and distance(*hello.goal, *here) < reach
            follows = waits and other in listed
            if hello.goal is None or (other not in inside and (hello.parked or follows or not comes)):
                self._seen.pop(other, None)
                continue
            trip = Trip(Point(hello.x, hello.y), Point(*hello.goal))
            if not self._gets_nowhere(now, other, trip.start):
                continue
            way = self._way_barred(now, driver, here, trip) if stands else None
            if way is not None:
                self._make_room(now, driver, here, goal, way)
                return

    def _gets_nowhere(self, now: Instant, other: int, place: Point) -> bool:
        """Return whether `other`, which is at `place`, has been no farther than a hull is wide from there for long."""
        first, since = self._seen.setdefault(other, (place, now))
        if distance(*first, *place) > 2.0 * self._robot.config.arena.shape.radius:
            self._seen[other] = (place, now)
            return False
        return now - since >= NOWHERE

    def _way_barred(self, now: Instant, driver: Driver, here: Point, trip: Trip) -> Route | None:
        """Return the way that another robot would have on its `trip` if this one, which stands `here`, had left.

        None if it has one anyway, or none even then.
        """
        arena = driver.arena
        reach = 2.0 * arena.shape.radius + PATH_MARGIN_M
        if distance(*trip.start, *trip.goal) < reach:
            return None
        others = [at for at in self._robot.peers.parked(now) if at != trip.start]
        if distance(*trip.goal, *here) >= reach and plan(arena, *trip, (*others, here)) is not None:
            return None
        return leader_route(arena, *trip, others, through_gate=False)

    def _make_room(self, now: Instant, driver: Driver, here: Point, goal: Point, *ways: Route) -> None:
        """Drive to free floor off `ways` and stations, on this side of the way to the own `goal`."""
        if driver.navigator.status == "moving":  # its drive has begun, and waits before the gate
            driver.navigator.leave_place(now)
            return
        peers = self._robot.peers
        self._tries += 1
        robot = self._robot.config.robot
        arena = driver.arena
        stations = [place for name, _ in arena.stations if (area := arena.area(name)) for place in area.places]
        route = retreat_route(arena, here, goal, peers.parked(now), robot, self._tries, ways, off=stations)
        if route is not None:
            driver.depart(now, route.points[-1], peers, heading=None, gated=False, shared=None)
