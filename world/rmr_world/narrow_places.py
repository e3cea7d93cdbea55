"""Narrow sections of a floor: where two robots cannot pass each other, found from its geometry alone.

The skeleton of the free space (`clearance_grid`) runs in the middle between obstacles. Where its clearance allows one
robot but not two side by side, it is *narrow*; where it allows two, *wide*. A connected narrow part that reaches wide
places at two ends is a *passage*. One that reaches them at one end only is a dead end or the corner of a room, and no
passage. One with three ends or more is divided at a *zone*, the cell that is nearest to three of its ends together, and
each part is looked at again. So a crossing of corridors becomes a zone with a passage in each arm, and the whole a
*junction*.

A wide place in which two robots can hardly stand, such as the bend of a corridor, counts as narrow. Floors without any
wide place have no passages: nobody can wait for anybody there.
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import pairwise

import numpy as np

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance, point_segment_distance
from rmr.base.record import record
from rmr.node.motion.grid import DOOR_MARGIN_M, PATH_MARGIN_M
from rmr_world.clearance_grid import ClearanceGrid, cell_edge_m, components

LINE_M = 0.02
"""Tolerance of a centre line, which follows the cells of a grid."""
FINER = 8
"""Steps within a cell in which the axis is looked for at the narrowest point."""

Cell = tuple[int, int]
"""Row and column."""


@record
class NarrowPassage:
    """A narrow section between two places at which robots can wait for each other."""

    name: str
    """``passage_1`` and so on, from west to east and then from south to north."""
    line: tuple[Point, ...]
    """Its centre line, from the western end (of a vertical one the southern end) to the other."""
    width: float
    """Free width at the narrowest point, metres."""

    @property
    def ends(self) -> tuple[Point, Point]:
        """The two ends."""
        return self.line[0], self.line[-1]

    @property
    def length(self) -> float:
        """Length of the centre line, metres."""
        return sum(distance(*a, *b) for a, b in pairwise(self.line))

    def away(self, at: Point) -> float:
        """Return the distance of a point from the centre line, metres."""
        return min((point_segment_distance(*at, *a, *b) for a, b in pairwise(self.line)), default=math.inf)

    def holds(self, at: Point) -> bool:
        """Return whether a robot at `at` is between the ends."""
        reach_m = self.width / 2.0 + LINE_M
        x, y = at
        low_x = min(point.x for point in self.line) - reach_m
        high_x = max(point.x for point in self.line) + reach_m
        if not low_x <= x <= high_x:
            return False
        away_m = self.away(at)
        ends_m = min(distance(x, y, *end) for end in self.ends)
        return away_m <= reach_m and away_m < ends_m - LINE_M


@record
class NarrowZone:
    """A place where three narrow sections or more meet."""

    name: str
    """``zone_1`` and so on, in the same order."""
    centre: Point
    radius: float
    """Metres."""


@record
class NarrowJunction:
    """A connected narrow part with three ends or more: at none but these can robots wait for each other."""

    name: str
    """``junction_1`` and so on."""
    arms: tuple[NarrowPassage, ...]
    """The passages into which its zones divide it."""
    ends: tuple[Point, ...]


@record
class NarrowPlaces:
    """The narrow places of a floor."""

    passages: tuple[NarrowPassage, ...] = ()
    zones: tuple[NarrowZone, ...] = ()
    junctions: tuple[NarrowJunction, ...] = ()
    searched: bool = True
    """False where the floor is too large to be searched for so small a robot."""


def side_by_side_m(radius: float) -> float:
    """Return the least width in which the planner lets two robots of `radius` pass each other, metres.

    It keeps `PATH_MARGIN_M` between each hull and the wall, and between the two hulls.
    """
    return 4.0 * radius + 3.0 * PATH_MARGIN_M


@lru_cache(maxsize=8)
def narrow_places(arena: Arena) -> NarrowPlaces:
    """Return the passages and zones of the floor of `arena` for robots of its shape."""
    radius = arena.shape.radius
    if cell_edge_m(arena) * 2.0 > radius:  # the grid tells nothing
        return NarrowPlaces(searched=False)
    return _Search(arena).found()


class _Search:
    """The search in one arena."""

    def __init__(self, arena: Arena) -> None:
        radius = arena.shape.radius
        self._arena = arena
        self._half = side_by_side_m(radius) / 2.0
        self._grid = grid = ClearanceGrid(arena, self._half + radius)
        # The axis of a passage lies up to half a cell beside the nearest row of centres, which are so much less clear.
        slack = grid.cell / 2.0
        wide = grid.clear >= self._half - slack
        # A wide place whose robots' centres have less room than this, in radii of a robot, is part of the narrow
        # section.
        self._wide = _spacious(wide, 2.0 * radius / grid.cell)
        self._narrow = grid.skeleton() & ~self._wide & (grid.clear >= radius + DOOR_MARGIN_M - slack)
        self._passages: list[tuple[tuple[Point, ...], float]] = []
        self._zones: list[Point] = []

    def found(self) -> NarrowPlaces:
        meeting: list[tuple[slice, tuple[Point, ...]]] = []
        for cells in _grouped(self._narrow):
            first = len(self._passages)
            ends = list(_clusters({n for cell in cells for n in self._neighbours(cell) if self._wide[n]}))
            self._divide(cells, ends)
            arms = slice(first, len(self._passages))
            if len(ends) > 2:
                meeting.append((arms, self._outer_ends(arms, ends)))
        order = sorted(self._passages, key=lambda each: _from_west(*_middle(each[0])))
        passages = {line: NarrowPassage(f"passage_{k}", line, width) for k, (line, width) in enumerate(order, 1)}
        zones = sorted(self._zones, key=lambda at: _from_west(*at))
        junctions = [(tuple(passages[line] for line, _ in self._passages[arms]), ends) for arms, ends in meeting]
        return NarrowPlaces(
            tuple(passages.values()),
            tuple(NarrowZone(f"zone_{k}", at, self._half) for k, at in enumerate(zones, 1)),
            tuple(NarrowJunction(f"junction_{k}", arms, ends) for k, (arms, ends) in enumerate(junctions, 1)),
        )

    def _outer_ends(self, arms: slice, reached: Iterable[set[Cell]]) -> tuple[Point, ...]:
        """Return the ends of passages that lie at the wide places of `reached`, one for each; none where one has none.

        A wide place that adjoins a zone has no passage of its own.
        """
        ends = [end for line, _ in self._passages[arms] for end in (line[0], line[-1])]
        found = []
        for wide in reached:
            away = {end: min(distance(*end, *self._grid.centre(cell)) for cell in wide) for end in ends}
            nearest = min(away, key=lambda end: (away[end], end), default=None)
            if nearest is not None and away[nearest] <= 3.0 * self._grid.cell:
                found.append(nearest)
        return tuple(found)

    def _divide(self, cells: set[Cell], ends: list[set[Cell]]) -> None:
        """Note the passage of a connected narrow part with two ends; divide one with more."""
        waiting = [(cells, ends)]
        while waiting:
            part, reached = waiting.pop()
            if len(reached) == 2:
                self._note(part, *reached)
            if len(reached) < 3:
                continue
            steps = [_steps(part, self._beside(part, end)) for end in reached[:3]]
            far = len(part)
            meeting = min(part, key=lambda cell: (sum(each.get(cell, far) for each in steps), cell))
            reach = self._half / self._grid.cell
            inside = {cell for cell in part if math.dist(cell, meeting) <= reach}
            self._zones.append(self._grid.centre(meeting))
            for rest in _clusters(part - inside):
                around = {n for cell in rest for n in self._neighbours(cell)}
                waiting.append((rest, [end for end in (*reached, *_clusters(inside & around)) if end & around]))

    def _note(self, cells: set[Cell], one: set[Cell], other: set[Cell]) -> None:
        """Note the passage through `cells` from one end to the other."""
        sources = self._beside(cells, one)
        targets = self._beside(cells, other)
        steps = _steps(cells, sources)
        cell = min((each for each in targets if each in steps), key=lambda each: (steps[each], each), default=None)
        if cell is None:
            return
        path = [cell]
        while steps[cell] > 0:
            cell = min(n for n in self._neighbours(cell) if steps.get(n, -1) == steps[cell] - 1)
            path.append(cell)
        # Cells from one point of a passage's centre line to the next.
        points = [self._axis(cells, each) for each in path[:-1:5] + path[-1:]]
        line = (*points, points[-1]) if len(points) == 1 else tuple(points)
        clear = self._grid.clear
        narrowest = min(path, key=lambda each: (max(clear[n] for n in self._neighbours(each)), each))
        self._passages.append((min(line, line[::-1]), 2.0 * self._clearest(narrowest)))

    def _axis(self, cells: set[Cell], cell: Cell) -> Point:
        """Return the mean of `cell` and its neighbours in the skeleton, which has a cell on either side of the axis."""
        near = [self._grid.centre(n) for n in (cell, *_around(cell)) if n in cells]
        return Point(sum(x for x, _ in near) / len(near), sum(y for _, y in near) / len(near))

    def _clearest(self, cell: Cell) -> float:
        """Return the greatest clearance around the centre of `cell`, metres: at the axis, which lies beside it."""
        x, y = self._grid.centre(cell)
        near = self._arena.obstacles_around(x, y, 2.0 * self._grid.cell)
        step = self._grid.cell / FINER
        offsets = [k * step for k in range(-FINER, FINER + 1)]
        return max(self._arena.clearance_of(near, x + dx, y + dy) for dx in offsets for dy in offsets)

    def _beside(self, cells: set[Cell], end: Iterable[Cell]) -> set[Cell]:
        """Return those of `cells` that are neighbours of `end`."""
        return {n for cell in end for n in _around(cell) if n in cells}

    def _neighbours(self, cell: Cell) -> Iterator[Cell]:
        rows, columns = self._wide.shape
        return (n for n in _around(cell) if 0 <= n[0] < rows and 0 <= n[1] < columns)


def _spacious(wide: np.ndarray, least: float) -> np.ndarray:
    """Return `wide` without the components whose bounding box has no side of `least` cells."""
    labels = components(wide)
    rows, columns = np.nonzero(wide)
    of = labels[rows, columns]
    spans = np.zeros(int(labels.max(initial=0)) + 1)
    for along in (rows, columns):
        low = np.full(len(spans), np.iinfo(np.int64).max)
        high = np.full(len(spans), -1)
        np.minimum.at(low, of, along)
        np.maximum.at(high, of, along)
        spans[1:] = np.maximum(spans[1:], high[1:] - low[1:] + 1.0)
    kept: np.ndarray = (spans >= least)[labels] & wide
    return kept


def _grouped(mask: np.ndarray) -> list[set[Cell]]:
    """Return the cells of each component of `mask`."""
    labels = components(mask)
    groups: list[set[Cell]] = [set() for _ in range(int(labels.max(initial=0)))]
    for row, column in np.argwhere(mask).tolist():
        groups[labels[row, column] - 1].add((row, column))
    return groups


def _clusters(cells: set[Cell]) -> list[set[Cell]]:
    """Return the 8-connected components of `cells`, by their least cell."""
    left = set(cells)
    found = []
    for first in sorted(cells):
        if first in left:
            steps = _steps(left, {first})
            found.append(set(steps))
            left -= found[-1]
    return found


def _steps(cells: set[Cell], sources: set[Cell]) -> dict[Cell, int]:
    """Return the number of steps from the nearest of `sources` to each of `cells` that is reached (breadth first)."""
    steps = dict.fromkeys(sorted(sources), 0)
    waiting = deque(steps)
    while waiting:
        cell = waiting.popleft()
        for n in _around(cell):
            if n in cells and n not in steps:
                steps[n] = steps[cell] + 1
                waiting.append(n)
    return steps


def _around(cell: Cell) -> tuple[Cell, ...]:
    """Return the eight neighbours of a cell."""
    r, c = cell
    return (
        (r - 1, c - 1), (r - 1, c), (r - 1, c + 1), (r, c - 1), (r, c + 1), (r + 1, c - 1), (r + 1, c), (r + 1, c + 1),
    )  # fmt: skip


def _middle(line: tuple[Point, ...]) -> Point:
    a = line[0]
    b = line[-1]
    return Point((a.x + b.x) / 2.0, (a.y + b.y) / 2.0)


def _from_west(x: float, y: float) -> tuple[float, float]:
    """Return the order of a place: from west to east, and from south to north where x is equal to a centimetre."""
    return round(x, 2), y
