"""The choice between passages: robots keep to the right.

Where two passages serve, robots of opposite directions take different ones, so that none waits for the direction to
change. A robot takes the passage on the right of the one that is on its shortest way, if the detour is no longer than
twice the passage: so much a robot that comes towards it costs, for each of the two may have to wait for the other. The
rule needs no message, since right of one direction is left of the other.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from rmr.base.arena import Arena, FloorPassage
from rmr.base.geometry import Point, distance, point_segment_distance
from rmr.base.motion_scale import scale_of
from rmr.node.motion.astar import plan
from rmr.node.motion.route import DETOUR_M, Route, leader_route, make_route, way_through_m


def gated_route(
    arena: Arena,
    start: Point,
    goal: Point,
    parked: Sequence[Point],
    *,
    behind: frozenset[str] = frozenset(),
    via: str | None = None,
) -> Route | None:
    """Return the robot's own route through the passages that are not `behind` it; None when there is no way.

    A robot that has asked for a turn at one, `via`, goes there if it can: else it would lose its place in the order.
    """
    shortest = leader_route(arena, start, goal, parked, through_gate=True, behind=behind)
    if shortest is None or shortest.within or shortest.gate_m is None:
        return shortest
    asked = arena.passage(via)
    if asked is not None and not asked.one_way and not asked.by_event and via not in behind:
        route = _through(arena, asked, start, goal, parked, behind, math.inf)
        if route is not None:
            return route
    first = arena.passage(shortest.passage)
    if first is None or first.by_event or first.one_way:
        return shortest
    longest_m = shortest.length_m + 2.0 * (shortest.clear_m - shortest.gate_m)
    routes = [
        route
        for other in _right_of(arena, first, shortest.way)
        if other.name not in behind
        and (route := _through(arena, other, start, goal, parked, behind, longest_m)) is not None
    ]
    return min(routes, key=lambda route: route.length_m, default=shortest)


def _right_of(arena: Arena, passage: FloorPassage, way: int) -> Iterator[FloorPassage]:
    """Yield the passages to the right of one who enters `passage` in direction `way`."""
    entrance = passage.entrance(way)
    end = passage.end(way)
    dx = end.x - entrance.x
    dy = end.y - entrance.y
    for other in arena.passages:
        if other is passage or len(other.mouths) != 2:
            continue  # of several arms none is on the right
        one, two = other.mouths
        # Cross product of the direction with the vector from the middle of the one to that of the other.
        ox = (one.x + two.x - entrance.x - end.x) / 2.0
        oy = (one.y + two.y - entrance.y - end.y) / 2.0
        if dx * oy - dy * ox < 0.0:
            yield other


def _through(
    arena: Arena,
    passage: FloorPassage,
    start: Point,
    goal: Point,
    parked: Sequence[Point],
    behind: frozenset[str],
    longest_m: float,
) -> Route | None:
    """Return the shorter route that passes `passage` first, in any direction; None if longer than allowed."""
    found = None
    back_m = 2.0 * arena.shape.radius
    for way in passage.ways:
        stops = start, passage.entrance(way), passage.end(way), goal
        legs = list(pairwise(stops))
        if sum(distance(*a, *b) for a, b in legs) > longest_m:
            continue
        paths = [path for a, b in legs if (path := plan(arena, a, b, parked)) is not None]
        if len(paths) < len(legs) or not _is_free(arena, passage, way, paths[1].length_m):
            continue
        # To a goal on this side it would lead there and back.
        if _nears(paths[0].points, stops[2], back_m) or _nears(paths[2].points, stops[1], back_m):
            continue
        points = [start, *(point for path in paths for point in path.points[1:])]
        route = make_route(arena, points, through_gate=True, behind=behind)
        if route.passage == passage.name and route.length_m <= longest_m:
            found = route
            longest_m = route.length_m
    return found


def _nears(points: Sequence[Point], place: Point, reach_m: float) -> bool:
    """Return whether the way along `points` comes nearer than `reach_m` to `place`."""
    return any(point_segment_distance(*place, *a, *b) < reach_m for a, b in pairwise(points))


def _is_free(arena: Arena, passage: FloorPassage, way: int, length_m: float) -> bool:
    """Return whether a way of `length_m` between the ends of `passage` leads through it, not around what bars it."""
    shortest_m = way_through_m(arena, passage.entrance(way), passage.end(way))
    return length_m <= shortest_m + DETOUR_M * scale_of(arena.shape).size
