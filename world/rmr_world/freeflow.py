"""Free-flow ways: the shortest way of a robot's centre past walls and obstacles, as if it were alone.

Obstacles grow by the robot's radius and the robot shrinks to a point; the shortest way then runs straight or
along the grown corners, so it is a path in the visibility graph of the starts, the goals and the corners (Lozano-
Perez and Wesley 1979). A grown corner is round. It is replaced by a chain of points on the arc, whose chords cut
a little into the forbidden ring: the result is never longer than the true way, hence a bound, and shorter by at
most 0.3 % of the arcs. The walls, shrunk by the radius, leave a rectangle, which hides nothing.
"""

import heapq
import math
from collections.abc import Sequence

from rmr.base.arena import Arena, Disc, Obstacle
from rmr.base.geometry import Point

ARC_STEP = math.radians(15.0)
"""Angle between two points on a grown corner."""
CORNERS_MAX = 1500
"""Of the visibility graph. A lab with more is judged with coarser arcs, which only weakens the bound."""

_INSIDE_M = 1e-7
"""A way may touch a grown obstacle, not enter it by more."""


class FreeFlow:
    """Shortest ways in one arena for robots of its shape."""

    def __init__(self, arena: Arena) -> None:
        self._radius = arena.shape.radius
        self._low = self._radius - _INSIDE_M
        self._right, self._top = arena.width - self._low, arena.height - self._low
        step = ARC_STEP
        self._rings = [_grown(obstacle, self._radius, step) for obstacle in arena.obstacles]
        while sum(map(len, self._rings)) > CORNERS_MAX and step < math.pi:
            step *= 2.0
            self._rings = [_grown(obstacle, self._radius, step) for obstacle in arena.obstacles]
        self._corners = [point for ring in self._rings for point in ring if self._free(point)]
        self._links: list[list[tuple[int, float]]] | None = None

    def lengths(self, start: Point, goals: Sequence[Point]) -> list[float]:
        """Return the length in metres of the shortest way from `start` to each goal; infinite where there is none."""
        to_corner = self._distances(start)
        lengths = []
        for goal in goals:
            direct = math.dist(start, goal) if self._visible(start, goal) else math.inf
            around = (
                way + math.dist(corner, goal)
                for corner, way in zip(self._corners, to_corner, strict=True)
                if way + math.dist(corner, goal) < direct and self._visible(corner, goal)
            )
            lengths.append(min(direct, min(around, default=math.inf)))
        return lengths

    def _distances(self, start: Point) -> list[float]:
        """Return the shortest way from `start` to every corner (Dijkstra)."""
        links = self._graph()
        ways = [math.inf] * len(self._corners)
        heap = [
            (math.dist(start, corner), index)
            for index, corner in enumerate(self._corners)
            if self._visible(start, corner)
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
        """Return for each corner the corners that it sees, with their distances; made on first use."""
        if self._links is None:
            self._links = [[] for _ in self._corners]
            for i, a in enumerate(self._corners):
                for j in range(i):
                    if self._visible(a, self._corners[j]):
                        length = math.dist(a, self._corners[j])
                        self._links[i].append((j, length))
                        self._links[j].append((i, length))
        return self._links

    def _free(self, point: Point) -> bool:
        """Return whether a centre may be at `point`."""
        x, y = point
        if not (self._low <= x <= self._right and self._low <= y <= self._top):
            return False
        return not any(_crosses(point, point, ring) for ring in self._rings)

    def _visible(self, a: Point, b: Point) -> bool:
        """Return whether the straight way from `a` to `b` enters no grown obstacle."""
        return not any(_crosses(a, b, ring) for ring in self._rings)


def _grown(obstacle: Obstacle, radius: float, step: float) -> list[Point]:
    """Return points, counter-clockwise, on the boundary of `obstacle` grown by `radius`."""
    if isinstance(obstacle, Disc):
        return _arc(obstacle.centre, obstacle.radius + radius, 0.0, math.tau, step)[:-1]
    corners = obstacle.corners
    ring: list[Point] = []
    for before, corner, after in zip(corners[-1:] + corners[:-1], corners, corners[1:] + corners[:1], strict=True):
        first = math.atan2(corner.y - before.y, corner.x - before.x) - math.pi / 2
        second = math.atan2(after.y - corner.y, after.x - corner.x) - math.pi / 2
        ring += _arc(corner, radius, first, first + (second - first) % math.tau, step)
    return ring


def _arc(centre: Point, radius: float, first: float, last: float, step: float) -> list[Point]:
    """Return points on an arc, both ends included, at most `step` radians apart."""
    parts = max(1, math.ceil((last - first) / step - 1e-9))
    angles = [first + (last - first) * k / parts for k in range(parts + 1)]
    return [Point(centre.x + radius * math.cos(a), centre.y + radius * math.sin(a)) for a in angles]


def _crosses(a: Point, b: Point, ring: Sequence[Point]) -> bool:
    """Return whether the segment a-b passes the inside of a convex ring (clipping by half-planes, Cyrus-Beck)."""
    enter, leave = 0.0, 1.0
    px, py = ring[-1]
    for qx, qy in ring:
        ex, ey = qx - px, qy - py
        length = math.sqrt(ex * ex + ey * ey)
        at_a = ex * (a[1] - py) - ey * (a[0] - px) - _INSIDE_M * length  # above 0: inside of this edge
        at_b = ex * (b[1] - py) - ey * (b[0] - px) - _INSIDE_M * length
        px, py = qx, qy
        if at_a <= 0.0 and at_b <= 0.0:
            return False
        if at_a <= 0.0:
            enter = max(enter, at_a / (at_a - at_b))
        elif at_b <= 0.0:
            leave = min(leave, at_a / (at_a - at_b))
        if enter >= leave:
            return False
    return True
