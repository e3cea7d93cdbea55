"""The floor as cells that a robot's centre may or may not enter (paper IV.D.1 and IV.D.2).

The arena is overlaid with square cells. A cell is blocked when its centre is nearer to an obstacle or a wall
than the inflation: the robot's radius and 3 cm, because a path at the radius alone hugs the walls. Starts and
goals may lie nearer to a wall than that, so around the two the inflation shrinks to the radius and 5 mm.
Parked robots block a disc of two radii and 5.5 cm around them, or 3 cm where that leaves no way; there is no mode that
ignores them.

A way through a door that is too narrow for these 3 cm keeps 1.5 cm. There the middle of the door is rarely the centre
of a cell: where nothing else joins two regions of the floor, a cell that is blocked at its centre is entered at that of
its points that is farthest from obstacles.

Blocked cells are a bytearray with a frame of blocked cells around it, so that a search needs no test for the
edge. What depends on the arena alone is computed once and shared by all robots of a process.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from rmr.base.arena import ROUNDING_M, Arena, Disc, Obstacle
from rmr.base.geometry import Point, distance, hypot, point_segment_distance

PATH_MARGIN_M: Final = 0.03
"""Margin of paths: added to the radius near walls, to two radii near parked robots where there is no more room."""
APART_M: Final = 0.055
"""Margin of a first try, added to two radii near parked robots: what the shield leaves to one that is heard and not
seen, at places known to 1 cm."""
DOOR_MARGIN_M: Final = 0.015
"""Margin of a second try, which finds ways through doors too narrow for the usual one."""
TIGHT_MARGIN_M: Final = 0.005
"""The same margin near start and goal."""
SAME_PLACE_M: Final = 0.03
"""A parked robot that is reported this near to where it was has not moved."""
RELAXED_M: Final = 0.15
"""How near to start or goal the tight margin holds, on cells of 5 cm; see `OccupancyGrid.relaxed_m`."""
SNAP_M: Final = 0.12
"""How far from start or goal the cell may be that stands for it (S' and T' of the paper), on cells of 5 cm."""
USUAL_CELL_M: Final = 0.05
"""The cells for which these lengths are stated. Coarser cells lengthen them, so that each point has a cell nearby."""

DOOR_STEPS: Final = (-0.375, -0.125, 0.125, 0.375)
"""Where the points of a cell that may stand for it are: in cells from its centre, in both directions."""
DOOR_STEP_CELLS: Final = 2.5
"""Distance of two such points of neighbouring cells at most, in cells: 1.75 cells in both directions."""
BLOCK: Final = 8
"""Edge, in cells, of the blocks whose clearance is measured together."""

Discs = tuple[tuple[float, float, float], ...]
"""Parked robots: x, y and the distance that another robot's centre keeps, metres."""


class OccupancyGrid:
    """The cells of one arena. Index of a cell: (row + 1) * stride + column + 1."""

    __slots__ = ("_doors", "arena", "cell", "clear", "columns", "relaxed_m", "rows", "snap_m", "stride")

    def __init__(self, arena: Arena) -> None:
        self.arena = arena
        self.cell = arena.cell
        coarse = max(1.0, arena.cell / USUAL_CELL_M)
        self.relaxed_m = RELAXED_M * coarse
        self.snap_m = SNAP_M * coarse
        self.columns = max(1, round(arena.width / arena.cell))
        self.rows = max(1, round(arena.height / arena.cell))
        self.stride = self.columns + 2
        self.clear = [-1.0] * (self.stride * (self.rows + 2))
        self._doors: dict[int, Point] | None = None
        for row in range(0, self.rows, BLOCK):
            for column in range(0, self.columns, BLOCK):
                self._measure(row, column)

    def _measure(self, row: int, column: int) -> None:
        """Measure the block of cells with this one in its corner: few of many obstacles are near it."""
        half = 0.5 * BLOCK * self.cell
        near = self.arena.obstacles_around(column * self.cell + half, row * self.cell + half, 1.5 * half)
        for r in range(row, min(row + BLOCK, self.rows)):
            for c in range(column, min(column + BLOCK, self.columns)):
                self.clear[self.index_at(c, r)] = self.arena.clearance_of(
                    near, (c + 0.5) * self.cell, (r + 0.5) * self.cell
                )

    @property
    def doors(self) -> dict[int, Point]:
        """The points at which cells are entered that are too near to obstacles for `DOOR_MARGIN_M` at their centre."""
        if self._doors is None:
            least = self.arena.shape.radius + DOOR_MARGIN_M
            reach = math.hypot(0.375, 0.375) * self.cell
            near = [index for index, clear in enumerate(self.clear) if least - reach <= clear < least]
            if DOOR_STEP_CELLS * self.cell > 2.0 * least:
                near = []  # an obstacle could stand between two points that keep off it
            found = ((index, self._farthest(index)) for index in near)
            self._doors = {index: point for index, point in found if self.arena.clearance(*point) >= least}
        return self._doors

    def _farthest(self, index: int) -> Point:
        """Return the point of a cell that is farthest from obstacles and walls."""
        x, y = self.centre(index)
        points = [Point(x + u * self.cell, y + v * self.cell) for u in DOOR_STEPS for v in DOOR_STEPS]
        return max(points, key=lambda point: self.arena.clearance(*point))

    def place(self, index: int) -> Point:
        """Return the point of a cell at which a way passes it, metres."""
        return self.doors.get(index) or self.centre(index)

    def index(self, x: float, y: float) -> int:
        """Return the cell that holds (x, y); the nearest one for a point outside."""
        column = min(self.columns - 1, max(0, int(x / self.cell)))
        row = min(self.rows - 1, max(0, int(y / self.cell)))
        return (row + 1) * self.stride + column + 1

    def centre(self, index: int) -> Point:
        """Return the centre of a cell in metres."""
        row, column = divmod(index, self.stride)
        return Point((column - 0.5) * self.cell, (row - 0.5) * self.cell)

    def cell_at(self, index: int) -> tuple[int, int]:
        """Return (column, row) of a cell."""
        row, column = divmod(index, self.stride)
        return column - 1, row - 1

    def index_at(self, column: int, row: int) -> int:
        """Return the index of the cell (column, row)."""
        return (row + 1) * self.stride + column + 1

    def near(self, x: float, y: float, reach_m: float) -> list[int]:
        """Return the cells whose centres are within `reach_m` of (x, y), nearest first, then by index."""
        lo_c = max(0, math.ceil((x - reach_m) / self.cell - 0.5))
        hi_c = min(self.columns - 1, math.floor((x + reach_m) / self.cell - 0.5))
        lo_r = max(0, math.ceil((y - reach_m) / self.cell - 0.5))
        hi_r = min(self.rows - 1, math.floor((y + reach_m) / self.cell - 0.5))
        found = []
        for row in range(lo_r, hi_r + 1):
            dy = (row + 0.5) * self.cell - y
            for column in range(lo_c, hi_c + 1):
                away = hypot((column + 0.5) * self.cell - x, dy)
                if away <= reach_m:
                    found.append((away, (row + 1) * self.stride + column + 1))
        found.sort()
        return [index for _, index in found]


@lru_cache(maxsize=16)
def grid_of(arena: Arena) -> OccupancyGrid:
    """Return the grid of `arena`, made once."""
    return OccupancyGrid(arena)


@lru_cache(maxsize=32)
def _inflated(arena: Arena, margin_m: float, doors: bool) -> bytes:
    grid = grid_of(arena)
    blocked = bytearray(clear < arena.shape.radius + margin_m for clear in grid.clear)
    for index in grid.doors if doors else ():
        blocked[index] = 0
    return bytes(blocked)


@lru_cache(maxsize=8)
def regions(arena: Arena, *, doors: bool) -> list[int]:
    """Return the region of each cell, from 1; 0: a robot's centre cannot pass there, with the margin of doors.

    With `doors` those that are joined by doors off the centres of cells are one. A flood fill over four neighbours.
    """
    grid = grid_of(arena)
    blocked = _inflated(arena, DOOR_MARGIN_M, doors)
    region = [0] * len(blocked)
    steps = (1, -1, grid.stride, -grid.stride)
    count = 0
    for first, barred in enumerate(blocked):
        if barred or region[first]:
            continue
        count += 1
        region[first] = count
        edge = [first]
        while edge:
            cell = edge.pop()
            for step in steps:
                other = cell + step
                if not region[other] and not blocked[other]:
                    region[other] = count
                    edge.append(other)
    return region


def discs_around(
    parked: Sequence[Point], radius: float, start: Point, goal: Point, apart_m: float = PATH_MARGIN_M
) -> Discs:
    """Return the discs that parked robots block: two radii and `apart_m`, metres.

    One that holds `start` shrinks so far that the robot can get out; one that holds `goal` shrinks to two
    radii and 5 mm, and blocks the goal when that is not enough.
    """
    discs = []
    for x, y in parked:
        keep = 2.0 * radius + apart_m
        from_goal = hypot(goal.x - x, goal.y - y)
        if from_goal < keep:
            keep = max(2.0 * radius + TIGHT_MARGIN_M, from_goal - 1e-6)
        keep = min(keep, max(0.0, hypot(start.x - x, start.y - y) - 1e-6))
        discs.append((x, y, keep))
    return tuple(discs)


def off_goal(parked: Sequence[Point], goal: Point, radius: float) -> list[Point]:
    """Return `parked` without the robots that stand so near to `goal` that no other one can."""
    return [p for p in parked if distance(*p, *goal) >= 2.0 * radius + TIGHT_MARGIN_M]


def same_places(a: Sequence[Point], b: Sequence[Point]) -> bool:
    """Return whether two lists of parked robots mean the same but for the noise of their estimates."""
    if len(a) != len(b):
        return False
    for p, q in zip(a, b, strict=True):
        if p is not q and hypot(p[0] - q[0], p[1] - q[1]) >= SAME_PLACE_M:
            break
    else:
        return True  # the same robots in the same order, as a rule
    return all(any(distance(*p, *q) < SAME_PLACE_M for q in b) for p in a)


def blocked_cells(
    grid: OccupancyGrid, start: Point, goal: Point, discs: Discs, margin_m: float, *, doors: bool = False
) -> bytearray:
    """Return for each cell 1 if a robot's centre must not enter it on the way from `start` to `goal`."""
    blocked = bytearray(_inflated(grid.arena, margin_m, doors))
    tight = grid.arena.shape.radius + TIGHT_MARGIN_M
    for x, y in (start, goal):
        for index in grid.near(x, y, grid.relaxed_m):
            if grid.clear[index] >= tight:
                blocked[index] = 0
    for x, y, keep in discs:
        for index in grid.near(x, y, keep):
            blocked[index] = 1
    return blocked


def cell_for(grid: OccupancyGrid, blocked: Sequence[int], point: Point) -> int | None:
    """Return the nearest cell that is not blocked, on this side of obstacles and walls, or None."""
    for index in grid.near(*point, grid.snap_m):
        if not blocked[index] and segment_clearance(grid.arena, point, grid.centre(index), ROUNDING_M) > 0.0:
            return index
    return None


def segment_clearance(arena: Arena, a: Point, b: Point, enough_m: float = math.inf) -> float:
    """Return the least distance of the segment a-b from obstacles and walls in metres; 0 when it meets one.

    Where that is `enough_m` or more, `enough_m`: what is farther away need not be looked at.
    """
    ax = a.x
    ay = a.y
    bx = b.x
    by = b.y
    left = min(ax, bx)
    right = max(ax, bx)
    low = min(ay, by)
    high = max(ay, by)
    least = min(enough_m, left)
    least = min(least, low)
    least = min(least, arena.width - right)
    least = min(least, arena.height - high)
    for obstacle in arena.obstacles:
        if least <= 0.0:
            return 0.0
        x0, y0, x1, y1 = obstacle.extent
        if not (x0 - right >= least or left - x1 >= least or y0 - high >= least or low - y1 >= least):
            least = min(least, _obstacle_distance(obstacle, a, b))
    return max(0.0, least)


def _obstacle_distance(obstacle: Obstacle, a: Point, b: Point) -> float:
    """Return the distance of an obstacle from the segment a-b, at most 0 when they meet."""
    # Bare numbers: most of a plan's time is spent here.
    ax = a.x
    ay = a.y
    bx = b.x
    by = b.y
    if isinstance(obstacle, Disc):
        return point_segment_distance(obstacle.centre.x, obstacle.centre.y, ax, ay, bx, by) - obstacle.radius
    if obstacle.contains(ax, ay) or obstacle.contains(bx, by):
        return 0.0
    least = math.inf
    c = obstacle.corners[-1]
    cx = c.x
    cy = c.y
    for d in obstacle.corners:
        dx = d.x
        dy = d.y
        if (
            _side(ax, ay, bx, by, cx, cy) * _side(ax, ay, bx, by, dx, dy) < 0.0
            and _side(cx, cy, dx, dy, ax, ay) * _side(cx, cy, dx, dy, bx, by) < 0.0
        ):
            return 0.0
        least = min(least, point_segment_distance(dx, dy, ax, ay, bx, by))
        least = min(least, point_segment_distance(ax, ay, cx, cy, dx, dy))
        least = min(least, point_segment_distance(bx, by, cx, cy, dx, dy))
        cx = dx
        cy = dy
    return least


def _side(px: float, py: float, qx: float, qy: float, rx: float, ry: float) -> float:
    """Return on which side of the line from p through q the point r lies: the left is positive."""
    return (qx - px) * (ry - py) - (qy - py) * (rx - px)
