"""Grid-based A* (paper IV.D.3), and the reduction of its result to a polyline.

f(n) = g(n) + h(n): g is the way from the start, 1 for a neighbour that shares an edge and sqrt 2 for a diagonal
one, h the Euclidean distance to the goal, which never overestimates. A diagonal step needs both cells beside
it free, so that no path cuts a blocked corner. Equal f is broken by h, then by the cell's index: the same
floor gives the same path everywhere.

The reduction pulls the string tight: from each kept point the path goes straight to the farthest later point
from which the whole segment keeps the clearance. It tests the true geometry, not the cells.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance, hypot, point_segment_distance
from rmr.base.grid_path import STEPS, GridPath
from rmr.base.motion_scale import scale_of
from rmr.node.motion.grid import (
    APART_M,
    DOOR_MARGIN_M,
    PATH_MARGIN_M,
    RELAXED_M,
    TIGHT_MARGIN_M,
    Discs,
    OccupancyGrid,
    blocked_cells,
    cell_for,
    discs_around,
    grid_of,
    regions,
    segment_clearance,
)


@dataclass(frozen=True, slots=True)
class Plan:
    """A way that a robot's centre can take."""

    points: tuple[Point, ...]
    """The polyline from start to goal, both included."""
    path: GridPath
    """The cells from S' to T'."""
    expansions: int
    """Cells that the search took from its queue."""

    @property
    def length_m(self) -> float:
        """Return the length of the polyline in metres."""
        return sum(distance(*a, *b) for a, b in zip(self.points, self.points[1:], strict=False))


def search(stride: int, blocked: bytearray, start: int, goal: int) -> tuple[list[int] | None, int]:
    """Return the cells of a least-cost path (None: no way) and the number of expansions.

    Cells are indices into `blocked`, whose rows are `stride` long and which has a blocked border.
    """
    root2 = math.sqrt(2.0)
    moves = tuple((dr * stride + dc, root2 if dc and dr else 1.0, dc, dr * stride) for dc, dr in STEPS)
    walls = bytes(blocked)
    done = [False] * len(blocked)
    cost = [math.inf] * len(blocked)
    parent = [0] * len(blocked)
    cost[start] = 0.0
    parent[start] = start
    aim = _aim(stride, start, goal)
    queue = [(aim, aim, start)]
    expansions = 0
    while queue:
        _, _, here = heappop(queue)
        if done[here]:
            continue
        done[here] = True
        expansions += 1
        if here == goal:
            return _trace(parent, goal), expansions
        so_far = cost[here]
        for offset, length, side, up in moves:
            there = here + offset
            if walls[there] or done[there] or (length > 1.0 and (walls[here + side] or walls[here + up])):
                continue
            way = so_far + length
            if way < cost[there]:
                cost[there] = way
                parent[there] = here
                aim = _aim(stride, there, goal)
                heappush(queue, (way + aim, aim, there))
    return None, expansions


def _aim(stride: int, cell: int, goal: int) -> float:
    """Return the straight way from `cell` to `goal`, in cells."""
    rows = cell // stride - goal // stride
    columns = cell % stride - goal % stride
    return math.sqrt(rows * rows + columns * columns)


def _trace(parent: Sequence[int], goal: int) -> list[int]:
    cells = [goal]
    while parent[cells[-1]] != cells[-1]:
        cells.append(parent[cells[-1]])
    cells.reverse()
    return cells


def grid_path(grid: OccupancyGrid, cells: Sequence[int]) -> GridPath:
    """Return a list of neighbouring cells as first cell and steps."""
    codes = {dr * grid.stride + dc: code for code, (dc, dr) in enumerate(STEPS)}
    return GridPath(grid.cell_at(cells[0]), tuple(codes[b - a] for a, b in pairwise(cells)))


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """What one plan must keep clear of, and how far."""

    arena: Arena
    discs: Discs
    start: Point
    goal: Point
    margin_m: float

    def sight(self, a: Point, b: Point) -> bool:
        """Return whether a robot can go straight from a to b, with the tight margin near start and goal."""
        ax = a.x
        ay = a.y
        bx = b.x
        by = b.y
        for x, y, keep in self.discs:
            if point_segment_distance(x, y, ax, ay, bx, by) < keep:
                return False
        radius = self.arena.shape.radius
        tight = radius + TIGHT_MARGIN_M
        wide = radius + self.margin_m
        length = distance(ax, ay, bx, by)
        head = RELAXED_M if a == self.start else 0.0
        tail = RELAXED_M if b == self.goal else 0.0
        if head + tail >= length:
            return segment_clearance(self.arena, a, b, tight) >= tight
        if segment_clearance(self.arena, _between(a, b, head), _between(b, a, tail), wide) < wide:
            return False
        return not (head or tail) or segment_clearance(self.arena, a, b, tight) >= tight

    def pull(self, points: Sequence[Point]) -> list[Point]:
        """Return `points` without those that the straight way can leave out."""
        kept = [points[0]]
        at = 0
        while at < len(points) - 1:
            ahead = len(points) - 1
            while ahead > at + 1 and not self.sight(points[at], points[ahead]):
                ahead -= 1
            kept.append(points[ahead])
            at = ahead
        return kept


def _between(a: Point, b: Point, way: float) -> Point:
    """Return the point `way` metres from a towards b."""
    if way <= 0.0:
        return a
    ax = a.x
    ay = a.y
    bx = b.x
    by = b.y
    length = distance(ax, ay, bx, by)
    return a if length <= 0.0 else Point(ax + (bx - ax) * way / length, ay + (by - ay) * way / length)


def plan(arena: Arena, start: Point, goal: Point, parked: Sequence[Point] = ()) -> Plan | None:
    """Return a way from `start` to `goal` around obstacles and parked robots, or None when there is none."""
    if arena.clearance(*goal) < arena.shape.radius:
        return None  # no robot can stand there
    # Where there is room, a robot whose way to stand is long keeps off by what its heading may lead it astray on it.
    astray_m = scale_of(arena.shape).astray_m
    margins = dict.fromkeys((PATH_MARGIN_M + astray_m, PATH_MARGIN_M, DOOR_MARGIN_M))
    tries = [(PATH_MARGIN_M + astray_m, APART_M + astray_m)] if parked else []
    for margin_m, apart_m in (*tries, *[(margin_m, PATH_MARGIN_M) for margin_m in margins]):
        found = _plan(arena, start, goal, parked, margin_m, apart_m)
        if found is not None:
            return found
    if not _apart(arena, start, goal, parked):
        return None
    return _plan(arena, start, goal, parked, DOOR_MARGIN_M, PATH_MARGIN_M, doors=True)


def _apart(arena: Arena, start: Point, goal: Point, parked: Sequence[Point]) -> bool:
    """Return whether doors off the centres of cells are all that may join `start` and `goal`, wherever robots stand."""
    grid = grid_of(arena)
    one, other = [regions(arena, doors=False)[grid.index(*point)] for point in (start, goal)]
    if one and one == other:
        return False
    # A point beside a wall lies in no region: the planner itself knows what its cell is joined to.
    return not parked or _plan(arena, start, goal, (), DOOR_MARGIN_M, PATH_MARGIN_M) is None


def _plan(
    arena: Arena,
    start: Point,
    goal: Point,
    parked: Sequence[Point],
    margin_m: float,
    apart_m: float,
    *,
    doors: bool = False,
) -> Plan | None:
    """Return a way that keeps off walls by `margin_m` and off `parked` robots by `apart_m`, or None."""
    grid = grid_of(arena)
    discs = discs_around(parked, arena.shape.radius, start, goal, apart_m)
    blocked = blocked_cells(grid, start, goal, discs, margin_m, doors=doors)
    first = cell_for(grid, blocked, start)
    last = cell_for(grid, blocked, goal)
    if first is None or last is None or any(hypot(goal.x - x, goal.y - y) < keep for x, y, keep in discs):
        return None
    cells, expansions = search(grid.stride, blocked, first, last)
    if cells is None:
        return None
    floor = FreeSpace(arena, discs, start, goal, margin_m)
    place = grid.place if doors else grid.centre
    points = floor.pull([start, *map(place, cells), goal])
    return Plan(tuple(points), grid_path(grid, cells), expansions)
