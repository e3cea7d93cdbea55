"""Make room: a little way back, and where a robot steps aside to when one that wants to get past it is on its goal.

Two robots that want each other's places are in a stand-off without a way around: each goal is occupied until the other
has left. Each then drives a little to its right, and comes back when the other has had time to pass. On their
right hand both leave the line between them on different sides. One that waits for its turn in a mouth by which others
come out drives out of their way alike.

The last resort is right by construction: in a jam that nothing else has dissolved each robot walks away by chance, ever
farther, off the others' ways where it can, stays there for a time that is another for each, and comes back. As long as
there is free floor around the jam, its outermost robots find some, and those behind them after that.
"""

import math
from collections.abc import Sequence
from enum import Enum
from typing import Final, NamedTuple

from rmr.base.arena import Arena
from rmr.base.geometry import STILL, Point, Pose, Twist, distance, hypot
from rmr.base.streams import uniform
from rmr.base.time import Duration, Instant, seconds
from rmr.node.motion.avoid import BACK_MPS
from rmr.node.motion.grid import MARGIN_M, segment_clearance
from rmr.node.motion.priority import Heard
from rmr.node.motion.route import Route, leader_route
from rmr.node.ports import SeenBody

BACK_MARGIN_M: Final = 0.03
"""Gap to other robots that driving back keeps: it is done blind."""
AHEAD_M: Final = 0.03
"""How far it looks."""
ASIDE_S: Final[Duration] = seconds(4)
"""How long a robot stays aside at most, the way there included."""
ASIDE_RADII: Final = 4.0
"""How far aside: two hulls and as much room between them."""
ANGLES: Final = (-90, -135, -45, 90, 135, 45, 180)
"""Degrees from the way to the goal, to the right first."""

FARTHER: Final[tuple[float, ...]] = (1.0, 1.5, 2.0, 3.0)
"""Times as far, where there is no room nearer, or nothing has helped so often."""
DIRECTIONS: Final = 12
"""Directions in which a walk away from a jam is tried."""
WALK_LONGER_M: Final = 0.3
"""So much longer than straight the way of such a walk may be."""
WAYS_M: Final = 1.0
"""Whoever walks away keeps off the ways of others that are no farther ..."""
WAYS_MAX: Final = 8
"""... of the nearest in a crowd: each way is planned, some 10 ms in a hall."""
STAY_MAX_S: Final = 6.0
"""How much longer a robot stays away from a jam at most, by chance."""
WALK_S: Final = 6.0
"""How long a walk away from a jam takes at least until the robot comes back, the way there included."""
RETREAT_S: Final = 1.6
"""Length of the way back of one that is in the bottleneck, times how often it was tried, ..."""
RETREAT_TRIES_MAX: Final = 4
"""... at most so many."""


class Side(Enum):
    """Where a robot is on its way through the bottleneck."""

    BEFORE = "before"
    WITHIN = "within"
    BEYOND = "beyond"
    """Or its way does not lead through the bottleneck."""


class Aside(NamedTuple):
    """How a robot makes room."""

    until: Instant
    stays: bool
    """Whether it waits where it has arrived."""

    def over(self, now: Instant, arrived: bool) -> bool:
        """Return whether it is time to come back."""
        return now >= self.until or (arrived and not self.stays)


def aside(
    arena: Arena, start: Point, goal: Point, others: Sequence[Point], mouth: Pose | None = None, off_m: float = 0.0
) -> Point | None:
    """Return where to step aside from `start` on the way to `goal`, clear of `others`; None where there is no room.

    If the pose of a `mouth` is given, as one who enters by it has it, the place is before it, at least `off_m` away.
    """
    radius = arena.shape.radius
    ahead = math.atan2(goal.y - start.y, goal.x - start.x)
    for times in FARTHER[: 1 if mouth is None else None]:
        away = times * ASIDE_RADII * radius
        for degrees in ANGLES:
            turn = ahead + math.radians(degrees)
            spot = Point(start.x + away * math.cos(turn), start.y + away * math.sin(turn))
            free = all(distance(*spot, *other) > 2.0 * radius + MARGIN_M for other in others)
            free = free and (mouth is None or _before(mouth, spot, off_m))
            if free and segment_clearance(arena, start, spot) > radius:
                return spot
    return None


def way_aside(
    arena: Arena,
    start: Point,
    goal: Point,
    parked: Sequence[Point],
    others: Sequence[Point],
    mouth: Pose | None = None,
    off_m: float = 0.0,
) -> Route | None:
    """Return the way around those `parked` to where `aside` says, clear of the `others` too; None if there is none."""
    spot = aside(arena, start, goal, (*parked, *others), mouth, off_m)
    return None if spot is None else leader_route(arena, start, spot, parked, through_gate=False)


def for_a_moment(now: Instant) -> Aside:
    """Return how a robot steps aside `now`."""
    return Aside(now + ASIDE_S, stays=False)


def _before(mouth: Pose, spot: Point, off_m: float) -> bool:
    """Return whether `spot` is farther than `off_m` from a mouth, on the side from which the mouth is entered."""
    x, y, theta = mouth.x, mouth.y, mouth.theta
    ahead = (spot.x - x) * math.cos(theta) + (spot.y - y) * math.sin(theta)
    return ahead < 0.0 and distance(*spot, x, y) > off_m


def back(arena: Arena, pose: Pose, around: Sequence[SeenBody]) -> Twist:
    """Return the wheel command that drives straight back, unless something is known to be there."""
    radius, x, y, theta = arena.shape.radius, pose.x, pose.y, pose.theta
    free = arena.clearance(x - math.cos(theta) * AHEAD_M, y - math.sin(theta) * AHEAD_M) > radius and all(
        hypot(body.x + AHEAD_M, body.y) > 2.0 * radius + BACK_MARGIN_M or body.x > 0.0 for body in around
    )
    return Twist(-BACK_MPS, 0.0) if free else STILL


def side_of(arena: Arena, place: Point, goal: Point) -> Side:
    """Return where a robot at `place` is on its way to `goal`."""
    route = leader_route(arena, place, goal, (), through_gate=True)
    if route is None or route.gate_m is None:
        return Side.BEYOND
    return Side.WITHIN if route.within else Side.BEFORE


def walk_away(
    arena: Arena,
    start: Point,
    goal: Point,
    others: Sequence[Point],
    robot: int,
    tries: int,
    ways: Sequence[Route] = (),
) -> Route | None:
    """Return a way from `start` to free floor clear of `others`; None where there is none.

    The direction is drawn from the robot's id and the tries; the more `tries`, the farther. It ends on this side of the
    bottleneck, and on as few as can be of the `ways` that others want to go.
    """
    radius = arena.shape.radius
    side = side_of(arena, start, goal)
    best: Route | None = None
    least = len(ways) + 1
    for spot, away in _around(start, radius, uniform("walk", robot, tries) * math.tau, tries):
        if arena.clearance(*spot) < radius + MARGIN_M or _near(spot, others, radius):
            continue
        hindered = sum(way.meets(0.0, ((spot.x, spot.y, 2.0 * radius + MARGIN_M),)) for way in ways)
        if hindered >= least:
            continue
        route = leader_route(arena, start, spot, others, through_gate=False)
        if route and route.length_m < away + WALK_LONGER_M and side_of(arena, spot, goal) is side:
            best, least = route, hindered
            if not least:
                break
    return best


def _around(start: Point, radius: float, first: float, tries: int) -> list[tuple[Point, float]]:
    """Return the places around `start` that the `tries`-th walk away may end at, each with how far away it is.

    The farthest that so many tries allow come first, then nearer ones, then those that are farther. All directions are
    tried, from that of the angle `first` on.
    """
    ring = min(tries, len(FARTHER))
    spots = []
    for times in (*FARTHER[ring - 1 :: -1], *FARTHER[ring:]):
        away = times * ASIDE_RADII * radius
        for turn in range(DIRECTIONS):
            angle = first + turn * math.tau / DIRECTIONS
            spots.append((Point(start.x + away * math.cos(angle), start.y + away * math.sin(angle)), away))
    return spots


def ways_of(arena: Arena, here: Point, others: Sequence[Heard], parked: Sequence[Point]) -> list[Route]:
    """Return the ways to their goals of those of `others` that drive nearest to `here`, around those `parked`."""
    trips = [(Point(other.pose.x, other.pose.y), other.goal) for other in others if other.goal is not None]
    near = sorted((away, at, goal) for at, goal in trips if (away := distance(*at, *here)) < WAYS_M)
    routes = (leader_route(arena, at, goal, parked, through_gate=False) for _, at, goal in near[:WAYS_MAX])
    return [route for route in routes if route is not None]


def _near(spot: Point, others: Sequence[Point], radius: float) -> bool:
    return any(distance(*spot, *other) < 2.0 * radius + MARGIN_M for other in others)


def stay(now: Instant, robot: int, tries: int) -> Aside:
    """Return for how long the `tries`-th walk away takes the robot off the jam."""
    return Aside(now + seconds(WALK_S + STAY_MAX_S * uniform("stay", robot, tries)), stays=True)


def retreat(robot: int, tries: int) -> Duration:
    """Return how long a robot in the bottleneck drives back at its `tries`-th try; every second time it stays.

    Which, is drawn from its id and the tries, so that of two that are head to head one gives way.
    """
    goes = uniform("retreat", robot, tries) < 0.5
    return seconds(RETREAT_S * min(tries, RETREAT_TRIES_MAX)) if goes else 0
