"""The path that the robots of a group share: the leader plans it, the others follow it (paper IV.D).

Shared is the part from the gate to the end of the narrow section, as cells. A robot that cannot use it plans its own.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance, point_segment_distance
from rmr.base.grid_path import GridPath
from rmr.base.motion_scale import scale_of
from rmr.node.motion.astar import FreeSpace, plan
from rmr.node.motion.grid import PATH_MARGIN_M, discs_around, grid_of
from rmr.node.motion.route import GATE_REACH_M, Route, leader_route, make_route

CELLS_LONGER: Final = 1.3
"""A path over cells is up to 1.09 times as long as the way that it describes."""


def shared_part(arena: Arena, route: Route) -> GridPath | None:
    """Return the cells of `route` from its gate to the end of the narrow section (P1' of the paper).

    None without a gate, and where no cells lead the way of the route: with few cells across a passage, none of their
    centres may be free in it.
    """
    if route.gate_m is None:
        return None
    begin = route.point(route.gate_m)
    end = route.point(route.clear_m)
    found = plan(arena, begin, end)
    longest = CELLS_LONGER * (route.clear_m - route.gate_m + 2.0 * arena.cell)
    return None if found is None or found.path.length * arena.cell > longest else found.path


def follower_route(
    arena: Arena,
    start: Point,
    goal: Point,
    parked: Sequence[Point],
    shared: GridPath,
    *,
    behind: frozenset[str] = frozenset(),
) -> Route | None:
    """Return the route along the leader's `shared` path, or by own A* when that does not serve."""
    middle = _usable(arena, start, goal, parked, shared)
    into = None if middle is None else _leg(arena, start, middle[0], parked)
    out = None if middle is None else _leg(arena, middle[-1], goal, parked)
    if middle is not None and into is not None and out is not None:
        route = make_route(arena, [*into, *middle[1:-1], *out], through_gate=True, behind=behind)
        if route.gate_m is not None:
            return route
    return leader_route(arena, start, goal, parked, through_gate=True, behind=behind)


def _usable(arena: Arena, start: Point, goal: Point, parked: Sequence[Point], shared: GridPath) -> list[Point] | None:
    """Return the corners of the shared path from where `start` joins it; None when it is blocked or foreign."""
    grid = grid_of(arena)
    cells = shared.cells()
    if not all(0 <= c < grid.columns and 0 <= r < grid.rows for c, r in cells):
        return None
    points = [grid.place(grid.index_at(c, r)) for c, r in cells]
    nearest = min(range(len(points)), key=lambda i: distance(*points[i], *start))
    points = points[nearest:]
    if len(points) < 2:
        return None
    floor = FreeSpace(arena, discs_around(parked, arena.shape.radius, start, goal), start, goal, PATH_MARGIN_M)
    for a, b in pairwise(points):
        if any(point_segment_distance(x, y, *a, *b) < keep for x, y, keep in floor.discs):
            return None
    mouths = [mouth for passage in arena.passages for mouth in passage.mouths]
    via = [mouth for mouth in mouths if distance(*points[0], *mouth) < GATE_REACH_M * scale_of(arena.shape).size]
    if nearest == 0 and via:
        points[0] = via[0]
    return floor.pull(points)


def _leg(arena: Arena, start: Point, goal: Point, parked: Sequence[Point]) -> list[Point] | None:
    """Return the straight leg if it is free, else one by A*, else None."""
    floor = FreeSpace(arena, discs_around(parked, arena.shape.radius, start, goal), start, goal, PATH_MARGIN_M)
    if distance(*start, *goal) < 1e-9 or floor.sight(start, goal):
        return [start, goal]
    found = plan(arena, start, goal, parked)
    return None if found is None else list(found.points)
