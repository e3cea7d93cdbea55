"""Where a robot goes to make room: a spot beside an entrance, or a retreat on free floor, away from a jam.

Both keep off what is parked and off the other bodies.

A retreat dissolves a jam by construction. In a jam that nothing else has dissolved each robot leaves at random, ever
farther, off the paths of the others where it can, and stays away for a random time. As long as there is free floor
around the jam, its outermost robots find some, and those behind them after that.
"""

import math
from collections.abc import Sequence
from enum import Enum
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point, Pose, distance
from rmr.base.motion_scale import scale_of
from rmr.base.streams import uniform
from rmr.node.motion.grid import PATH_MARGIN_M, segment_clearance
from rmr.node.motion.priority import Heard
from rmr.node.motion.route import Route, leader_route

STEP_RADII: Final = 4.0
"""Distance of the nearest spots: two hulls and as much room between them."""
CLEARING_ANGLES_DEG: Final = (-90, -135, -45, 90, 135, 45, 180)
"""Directions in which an entrance is cleared, from the direction to the goal; the right-hand side first."""
FARTHER: Final[tuple[float, ...]] = (1.0, 1.5, 2.0, 3.0)
"""Multiples of the distance that are tried where there is no room nearer, or nothing has helped so often."""
RETREAT_DIRECTIONS: Final = 12
"""Directions in which a retreat is tried."""
RETREAT_DETOUR_M: Final = 0.3
"""A retreat whose path is longer than straight by more than this, times the size of the robots, is not taken."""
OTHERS_PATHS_M: Final = 1.0
"""A retreat keeps off the paths of other robots that are no farther away than this, times the size."""
OTHERS_PATHS_MAX: Final = 8
"""Paths of others that a retreat keeps off, of the nearest: planning one takes some 10 ms in a hall."""


class Side(Enum):
    """Where a robot is on its way through the bottleneck."""

    BEFORE = "before"
    WITHIN = "within"
    BEYOND = "beyond"
    """Or its way does not lead through the bottleneck."""


def side_of(arena: Arena, place: Point, goal: Point) -> Side:
    """Return where a robot at `place` is on its way to `goal`."""
    route = leader_route(arena, place, goal, (), through_gate=True)
    if route is None or route.gate_m is None:
        return Side.BEYOND
    return Side.WITHIN if route.within else Side.BEFORE


def clearing_spot(
    arena: Arena, start: Point, goal: Point, others: Sequence[Point], entrance: Pose, off_m: float
) -> Point | None:
    """Return where to go from `start`, on the way to `goal`, to clear an entrance; None where there is no room.

    `entrance` is the pose of a robot that enters by it. The spot is before it, farther than `off_m` from it, and clear
    of `others`.
    """
    radius = arena.shape.radius
    ahead = math.atan2(goal.y - start.y, goal.x - start.x)
    for times in FARTHER:
        away = times * STEP_RADII * radius
        for degrees in CLEARING_ANGLES_DEG:
            turn = ahead + math.radians(degrees)
            spot = Point(start.x + away * math.cos(turn), start.y + away * math.sin(turn))
            free = all(distance(*spot, *other) > 2.0 * radius + PATH_MARGIN_M for other in others)
            if free and _before(entrance, spot, off_m) and segment_clearance(arena, start, spot) > radius:
                return spot
    return None


def clearing_route(
    arena: Arena,
    start: Point,
    goal: Point,
    parked: Sequence[Point],
    others: Sequence[Point],
    entrance: Pose,
    off_m: float,
) -> Route | None:
    """Return the route around those `parked` to the spot of `clearing_spot`, which is clear of the `others`, too."""
    spot = clearing_spot(arena, start, goal, (*parked, *others), entrance, off_m)
    return None if spot is None else leader_route(arena, start, spot, parked, through_gate=False)


def _before(entrance: Pose, spot: Point, off_m: float) -> bool:
    """Return whether `spot` is farther than `off_m` from an entrance, on the side from which it is entered."""
    x = entrance.x
    y = entrance.y
    theta = entrance.theta
    # Component of the vector from the entrance to the spot along the direction of entry.
    ahead = (spot.x - x) * math.cos(theta) + (spot.y - y) * math.sin(theta)
    return ahead < 0.0 and distance(*spot, x, y) > off_m


def retreat_route(
    arena: Arena,
    start: Point,
    goal: Point,
    others: Sequence[Point],
    robot: int,
    tries: int,
    paths: Sequence[Route] = (),
    *,
    off: Sequence[Point] = (),
) -> Route | None:
    """Return a route from `start` to free floor clear of `others`, and of the places `off`; None where there is none.

    The direction is drawn from the robot's id and the tries; the more `tries`, the farther. It ends on this side of the
    bottleneck, and on as few as can be of the `paths` that others want to take.
    """
    radius = arena.shape.radius
    detour_m = RETREAT_DETOUR_M * scale_of(arena.shape).size
    side = side_of(arena, start, goal)
    best: Route | None = None
    least = len(paths) + 1
    for spot, away in _spots_around(start, radius, uniform("walk", robot, tries) * math.tau, tries):
        if arena.clearance(*spot) < radius + PATH_MARGIN_M or _near(spot, (*others, *off), radius):
            continue
        hindered = sum(path.meets(0.0, ((spot.x, spot.y, 2.0 * radius + PATH_MARGIN_M),)) for path in paths)
        if hindered >= least:
            continue
        route = leader_route(arena, start, spot, others, through_gate=False)
        if route and route.length_m < away + detour_m and side_of(arena, spot, goal) is side:
            best = route
            least = hindered
            if not least:
                break
    return best


def _spots_around(start: Point, radius: float, first: float, tries: int) -> list[tuple[Point, float]]:
    """Return the places around `start` that the `tries`-th retreat may end at, each with how far away it is.

    The farthest that so many tries allow come first, then nearer ones, then those that are farther. All directions are
    tried, from that of the angle `first` on.
    """
    ring = min(tries, len(FARTHER))
    spots = []
    for times in (*FARTHER[ring - 1 :: -1], *FARTHER[ring:]):
        away = times * STEP_RADII * radius
        for turn in range(RETREAT_DIRECTIONS):
            angle = first + turn * math.tau / RETREAT_DIRECTIONS
            spots.append((Point(start.x + away * math.cos(angle), start.y + away * math.sin(angle)), away))
    return spots


def _near(spot: Point, others: Sequence[Point], radius: float) -> bool:
    return any(distance(*spot, *other) < 2.0 * radius + PATH_MARGIN_M for other in others)


def paths_of(arena: Arena, here: Point, others: Sequence[Heard], parked: Sequence[Point]) -> list[Route]:
    """Return the paths to their goals of those of `others` that drive nearest to `here`, around those `parked`."""
    trips = [(Point(other.pose.x, other.pose.y), other.goal) for other in others if other.goal is not None]
    near_m = OTHERS_PATHS_M * scale_of(arena.shape).size
    near = sorted((away, at, goal) for at, goal in trips if (away := distance(*at, *here)) < near_m)
    routes = (leader_route(arena, at, goal, parked, through_gate=False) for _, at, goal in near[:OTHERS_PATHS_MAX])
    return [route for route in routes if route is not None]
