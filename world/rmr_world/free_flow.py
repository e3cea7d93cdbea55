"""Free-flow paths: the shortest path of a robot's centre past walls and obstacles, without other robots.

In configuration space obstacles are grown by the robot's radius and the robot is a point. The shortest path is then a
path in the visibility graph of start, goal and corners (Lozano-Perez and Wesley 1979), of which only the lines tangent
at their corners matter. A grown corner is an arc. It is replaced by a chain of points on the arc, whose chords cut a
little into the grown obstacle: the result is never longer than the true path, hence a lower bound, and shorter by at
most 0.3 % of the arcs. The walls, moved inwards by the radius, leave a rectangle, which blocks no line of sight.

The graph of n obstacles has about n^2 edges to look at. With more than `OBSTACLES_MAX` obstacles they are left out: the
straight line is a lower bound, too.
"""

import heapq
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rmr.base.arena import Arena, Disc, Obstacle
from rmr.base.geometry import Point

OBSTACLES_MAX = 300
"""Bound of the obstacles that ways lead around."""

_INSIDE_M = 1e-7
"""Depth to which a path may enter a grown obstacle, metres: tolerance of rounding for a path that touches it."""


class _Corner(NamedTuple):
    """A point where a path may bend."""

    at: Point
    before: Point
    """Its neighbours on the boundary of its obstacle: the one before, and `after`."""
    after: Point


class _Ring(NamedTuple):
    """The boundary of a grown obstacle, counter-clockwise, and the box around it."""

    points: tuple[Point, ...]
    left: float
    right: float
    bottom: float
    top: float


class FreeFlow:
    """Shortest paths in one arena for robots of its shape."""

    def __init__(self, arena: Arena) -> None:
        radius = arena.shape.radius
        self._low = radius - _INSIDE_M
        self._right = arena.width - self._low
        self._top = arena.height - self._low
        step = math.radians(15.0)  # between two points on a grown corner
        obstacles = arena.obstacles if len(arena.obstacles) <= OBSTACLES_MAX else ()
        self._rings = [_grown(obstacle, radius, step) for obstacle in obstacles]
        # With more corners in the visibility graph arcs are made coarser, which only weakens the bound.
        while sum(len(ring.points) for ring in self._rings) > 800 and step < math.pi:
            step *= 2.0
            self._rings = [_grown(obstacle, radius, step) for obstacle in obstacles]
        self._in_the_way = 0
        """The obstacle that was found in the way last."""
        self._boxes = np.array([ring[1:] for ring in self._rings]).reshape(-1, 4).T
        left, right, bottom, top = self._boxes
        diagonal = np.hypot(right - left, top - bottom)
        self._circles = np.array([(left + right) / 2.0, (bottom + top) / 2.0, diagonal / 2.0 + _INSIDE_M])
        """Centre and radius of a circle around each box."""
        self._corners = [corner for ring in self._rings for corner in _corners(ring) if self.free(corner.at)]
        self._links: list[list[tuple[int, float]]] | None = None
        self._ways: dict[Point, list[float]] = {}
        """Where paths began -> the length of the shortest path to each corner: a start has several goals."""
        self._known: dict[tuple[Point, Point], float] = {}
        """Start and goal -> the length of the shortest path, metres: several rules ask for the same."""

    def lengths(self, start: Point, goals: Sequence[Point]) -> list[float]:
        """Return the length in metres of the shortest path from `start` to each goal; infinite if there is none."""
        for goal in goals:
            if (start, goal) not in self._known:
                self._known[start, goal] = self._length(start, goal)
        return [self._known[start, goal] for goal in goals]

    def _length(self, start: Point, goal: Point) -> float:
        least = math.dist(start, goal) if self._visible(start, goal) else math.inf
        for corner, way in zip(self._corners, self._distances(start), strict=True):
            length = way + math.dist(corner.at, goal)
            if length < least and _passes(corner, goal) and self._visible(corner.at, goal):
                least = length
        return least

    def free(self, point: Point) -> bool:
        """Return whether a robot's centre may be at `point`."""
        x, y = point
        if not (self._low <= x <= self._right and self._low <= y <= self._top):
            return False
        return self._visible(point, point)

    def _distances(self, start: Point) -> list[float]:
        """Return the length of the shortest path from `start` to each corner, metres."""
        if start not in self._ways:
            self._ways[start] = self._dijkstra(start)
        return self._ways[start]

    def _dijkstra(self, start: Point) -> list[float]:
        links = self._graph()
        ways = [math.inf] * len(self._corners)
        heap = [
            (math.dist(start, corner.at), index)
            for index, corner in enumerate(self._corners)
            if _passes(corner, start) and self._visible(start, corner.at)
        ]
        heapq.heapify(heap)
        while heap:
            way, index = heapq.heappop(heap)
            if way >= ways[index]:
                continue
            ways[index] = way
            for other, length in links[index]:
                if way + length < ways[other]:
                    heapq.heappush(heap, (way + length, other))
        return ways

    def _graph(self) -> list[list[tuple[int, float]]]:
        """Return the edges of the visibility graph by corner, with lengths in metres; built on first use."""
        if self._links is None:
            links: list[list[tuple[int, float]]] = [[] for _ in self._corners]
            corners = np.array(self._corners).reshape(-1, 3, 2)
            for i, a in enumerate(self._corners):
                for j in _tangents(corners, i):
                    b = self._corners[j]
                    if self._visible(a.at, b.at):
                        length = math.dist(a.at, b.at)
                        links[i].append((j, length))
                        links[j].append((i, length))
            self._links = links
        return self._links

    def _visible(self, a: Point, b: Point) -> bool:
        """Return whether the straight way from `a` to `b` enters no grown obstacle."""
        # The way asked for before was often between the same obstacles, and what was in its way is in this one's, too.
        if self._rings and _crosses(a, b, self._rings[self._in_the_way].points):
            return False
        left, right, bottom, top = self._boxes
        beside = (max(a.x, b.x) < left) | (min(a.x, b.x) > right) | (max(a.y, b.y) < bottom) | (min(a.y, b.y) > top)
        dx, dy = b.x - a.x, b.y - a.y
        x, y, reach = self._circles
        beside |= np.abs(dx * (y - a.y) - dy * (x - a.x)) > reach * math.hypot(dx, dy)
        for k in np.flatnonzero(~beside):
            if _crosses(a, b, self._rings[k].points):
                self._in_the_way = int(k)
                return False
        return True


@lru_cache(maxsize=4)
def free_flow(arena: Arena) -> FreeFlow:
    """Return the shortest paths in `arena`, the same for all that ask for them."""
    return FreeFlow(arena)


def _tangents(corners: np.ndarray, i: int) -> list[int]:
    """Return the corners before the i-th one that the line from it touches: `_passes` at both ends.

    `corners`: shape (n, 3, 2), each corner with the points before and after it.
    """
    at, before, after = corners[:i].transpose(1, 2, 0)
    (x, y), (px, py), (qx, qy) = corners[i]
    dx, dy = at[0] - x, at[1] - y
    slack = _INSIDE_M * (np.abs(dx) + np.abs(dy))
    found = np.ones(i, dtype=bool)
    for one, other in (
        (dx * (py - y) - dy * (px - x), dx * (qy - y) - dy * (qx - x)),
        (
            -dx * (before[1] - at[1]) + dy * (before[0] - at[0]),
            -dx * (after[1] - at[1]) + dy * (after[0] - at[0]),
        ),
    ):
        found &= ((one <= slack) & (other <= slack)) | ((one >= -slack) & (other >= -slack))
    return [int(j) for j in np.flatnonzero(found)]


def _passes(corner: _Corner, other: Point) -> bool:
    """Return whether the line through `corner` and `other` is tangent to the corner's obstacle.

    A shortest path bends only at such corners. Elsewhere the line enters the obstacle, or the bend can be cut short.
    """
    (x, y), (px, py), (qx, qy) = corner
    dx = other[0] - x
    dy = other[1] - y
    slack = _INSIDE_M * (abs(dx) + abs(dy))
    # Cross products: both neighbours on one side of the line, or on it.
    side_p = dx * (py - y) - dy * (px - x)
    side_q = dx * (qy - y) - dy * (qx - x)
    return (side_p <= slack and side_q <= slack) or (side_p >= -slack and side_q >= -slack)


def _corners(ring: _Ring) -> list[_Corner]:
    """Return the points of a boundary with their neighbours."""
    points = ring.points
    return [_Corner(*three) for three in zip(points, points[-1:] + points[:-1], points[1:] + points[:1], strict=True)]


def _grown(obstacle: Obstacle, radius: float, step: float) -> _Ring:
    """Return the boundary of `obstacle` grown by `radius` as a chain of points on it."""
    points: list[Point] = []
    if isinstance(obstacle, Disc):
        points = _arc(obstacle.centre, obstacle.radius + radius, 0.0, math.tau, step)[:-1]
    else:
        corners = obstacle.corners
        for before, corner, after in zip(corners[-1:] + corners[:-1], corners, corners[1:] + corners[:1], strict=True):
            first = math.atan2(corner.y - before.y, corner.x - before.x) - math.pi / 2
            second = math.atan2(after.y - corner.y, after.x - corner.x) - math.pi / 2
            points += _arc(corner, radius, first, first + (second - first) % math.tau, step)
    xs = [point.x for point in points]
    ys = [point.y for point in points]
    return _Ring(tuple(points), min(xs), max(xs), min(ys), max(ys))


def _arc(centre: Point, radius: float, first: float, last: float, step: float) -> list[Point]:
    """Return points on an arc, both ends included, at most `step` radians apart."""
    parts = max(1, math.ceil((last - first) / step - 1e-9))
    angles = [first + (last - first) * k / parts for k in range(parts + 1)]
    return [Point(centre.x + radius * math.cos(a), centre.y + radius * math.sin(a)) for a in angles]


def _crosses(a: Point, b: Point, ring: Sequence[Point]) -> bool:
    """Return whether the segment a-b passes the inside of a convex ring (clipping by half-planes, Cyrus-Beck)."""
    enter = 0.0
    leave = 1.0
    px, py = ring[-1]
    for qx, qy in ring:
        ex = qx - px
        ey = qy - py
        length = math.sqrt(ex * ex + ey * ey)
        at_a = ex * (a[1] - py) - ey * (a[0] - px) - _INSIDE_M * length  # above 0: inside of this edge
        at_b = ex * (b[1] - py) - ey * (b[0] - px) - _INSIDE_M * length
        px = qx
        py = qy
        if at_a <= 0.0 and at_b <= 0.0:
            return False
        if at_a <= 0.0:
            enter = max(enter, at_a / (at_a - at_b))
        elif at_b <= 0.0:
            leave = min(leave, at_a / (at_a - at_b))
        if enter >= leave:
            return False
    return True
