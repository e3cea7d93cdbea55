"""Clearance of a floor on a fine grid, and connected components of its cells.

Each cell holds the distance from its centre to the nearest obstacle or wall, and which one that is. Cells whose
neighbour has another nearest obstacle form the generalised Voronoi diagram, the skeleton of the free space (Choset and
Burdick 2000): a robot that follows it keeps as far from both sides as it can.
"""

import math

import numpy as np

from rmr.base.arena import Arena, Disc, Obstacle, Polygon
from rmr.base.geometry import Point

CELLS_MAX = 1_500_000
"""Bound of the cells; a larger floor gets larger cells."""


def cell_edge_m(arena: Arena) -> float:
    """Return the greatest edge of the cells of an arena's grid, metres."""
    # Cells along a robot's radius: fine enough to tell widths to 2 cm for the default robot.
    return max(arena.shape.radius / 5.0, math.sqrt(arena.width * arena.height / CELLS_MAX))


class ClearanceGrid:
    """The clearance of an arena; arrays have the shape (rows, columns), row 0 is at y = 0."""

    def __init__(self, arena: Arena, reach_m: float) -> None:
        """Distances to obstacles are exact up to `reach_m`; beyond that they may be too large."""
        cell = cell_edge_m(arena)
        columns = max(1, math.ceil(arena.width / cell))
        rows = max(1, math.ceil(arena.height / cell))
        self.cell_x = arena.width / columns
        self.cell_y = arena.height / rows
        self.cell = max(self.cell_x, self.cell_y)
        """Edge of a cell, metres."""
        self._xs = (np.arange(columns) + 0.5) * self.cell_x
        self._ys = (np.arange(rows) + 0.5) * self.cell_y
        walls = np.broadcast_arrays(
            self._xs[None, :], arena.width - self._xs[None, :], self._ys[:, None], arena.height - self._ys[:, None]
        )
        sides = np.stack(walls)
        self.clear: np.ndarray = sides.min(axis=0)
        """Metres; 0 inside an obstacle."""
        self.nearest: np.ndarray = sides.argmin(axis=0) - len(walls)
        """Index of the nearest obstacle; below 0 for a wall."""
        for index, obstacle in enumerate(arena.obstacles):
            self._add(index, obstacle, reach_m)

    def centre(self, cell: tuple[int, int]) -> Point:
        """Return the centre of the cell (row, column), metres."""
        return Point(float(self._xs[cell[1]]), float(self._ys[cell[0]]))

    def skeleton(self) -> np.ndarray:
        """Return which cells have a neighbour with another nearest obstacle."""
        found = np.zeros(self.nearest.shape, dtype=bool)
        along = self.nearest[:, 1:] != self.nearest[:, :-1]
        across = self.nearest[1:] != self.nearest[:-1]
        found[:, 1:] |= along
        found[:, :-1] |= along
        found[1:] |= across
        found[:-1] |= across
        return found

    def _add(self, index: int, obstacle: Obstacle, reach_m: float) -> None:
        """Lower the clearance of the cells near `obstacle`."""
        x0, y0, x1, y1 = obstacle.extent
        columns = slice(*np.searchsorted(self._xs, (x0 - reach_m, x1 + reach_m)))
        rows = slice(*np.searchsorted(self._ys, (y0 - reach_m, y1 + reach_m)))
        clear = self.clear[rows, columns]
        if clear.size == 0:
            return
        away = _distances(obstacle, self._xs[None, columns], self._ys[rows, None])
        # An obstacle is nearer than another only by more than this, so that rounding does not decide between touching
        # ones.
        nearer = away < clear - 1e-9
        clear[nearer] = away[nearer]
        self.nearest[rows, columns][nearer] = index


def _distances(obstacle: Obstacle, xs: np.ndarray, ys: np.ndarray) -> np.ndarray:
    """Return the distance of each point to `obstacle`, metres; 0 inside. `xs` has one row, `ys` one column."""
    if isinstance(obstacle, Disc):
        found: np.ndarray = np.maximum(0.0, np.hypot(xs - obstacle.centre.x, ys - obstacle.centre.y) - obstacle.radius)
        return found
    return _polygon_distances(obstacle, xs, ys)


def _polygon_distances(polygon: Polygon, xs: np.ndarray, ys: np.ndarray) -> np.ndarray:
    """Return the distance of each point to a convex polygon, metres; 0 inside."""
    shape = np.broadcast_shapes(xs.shape, ys.shape)
    squares = np.full(shape, np.inf)
    inside = np.ones(shape, dtype=bool)
    a = polygon.corners[-1]
    for b in polygon.corners:
        dx = b.x - a.x
        dy = b.y - a.y
        px = xs - a.x
        py = ys - a.y
        length = dx * dx + dy * dy
        t = np.clip((px * dx + py * dy) / length, 0.0, 1.0) if length > 0.0 else np.zeros(shape)
        np.minimum(squares, (px - t * dx) ** 2 + (py - t * dy) ** 2, out=squares)
        # Right of an edge, of corners counter-clockwise, is outside.
        inside &= dx * py - dy * px >= 0.0
        a = b
    squares[inside] = 0.0
    found: np.ndarray = np.sqrt(squares)
    return found


def components(mask: np.ndarray) -> np.ndarray:
    """Return the number, from 1, of the 8-connected component of each cell of `mask`; 0 elsewhere.

    Runs of cells in a row are joined with those that they touch in the row before (union-find). Components are numbered
    by their first cell.
    """
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    run_rows, begins = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[1]
    parents = _joined(run_rows.tolist(), begins.tolist(), ends.tolist())
    numbers: dict[int, int] = {}
    of_run = [numbers.setdefault(_root(parents, run), len(numbers) + 1) for run in range(len(parents))]
    labels = np.zeros(mask.shape, dtype=np.int32)
    # The cells of a mask come row by row, as the runs do.
    labels[mask] = np.repeat(np.array(of_run, dtype=np.int32), ends - begins)
    return labels


def _joined(rows: list[int], begins: list[int], ends: list[int]) -> list[int]:
    """Return the parent of each run in a forest of components. A run holds the columns from its begin up to its end."""
    parents = list(range(len(rows)))
    other = 0
    for run, row in enumerate(rows):
        while rows[other] < row - 1 or (rows[other] == row - 1 and ends[other] < begins[run]):
            other += 1
        touching = other
        while rows[touching] == row - 1 and begins[touching] <= ends[run]:
            parents[_root(parents, run)] = _root(parents, touching)
            touching += 1
    return parents


def _root(parents: list[int], run: int) -> int:
    while parents[run] != run:
        parents[run] = parents[parents[run]]
        run = parents[run]
    return run
