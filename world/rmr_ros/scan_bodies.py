"""Bodies in view by a laser scan: what stands on the floor, is as wide as a robot, and is no wall of the map.

Points of the scan that are near a wall or an obstacle of the lab are the map's. Of the others, neighbours belong
together; what is much wider than a robot is none. A body is where a hull of the lab's radius would lie behind its
points. It keeps its track from scan to scan, so that it has a velocity over the ground, which begins at 0.

Nothing here imports ROS: a scan comes as numbers, and the pose of the robot with it.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Pose
from rmr.base.time import NS_PER_S, Duration, Instant, milliseconds
from rmr.node.ports import SeenBody

APART_M: Final = 0.1
"""Neighbours that are farther from each other belong to two bodies."""
KEPT: Final[Duration] = milliseconds(500)
"""For how long a body is in view that the scans do not show any more."""


class _Track:
    """One body, on the floor of the lab."""

    def __init__(self, x: float, y: float, clock: Instant) -> None:
        self.x = x
        self.y = y
        self.vx = self.vy = 0.0
        self.clock = clock

    def ahead(self, clock: Instant) -> tuple[float, float]:
        """Return where it is at `clock`."""
        dt = (clock - self.clock) / NS_PER_S
        return self.x + self.vx * dt, self.y + self.vy * dt

    def take(self, x: float, y: float, clock: Instant) -> None:
        """Take in where it was seen: half of what was not expected is its place, a fifth its velocity."""
        dt = max((clock - self.clock) / NS_PER_S, 0.02)
        expected_x, expected_y = self.ahead(clock)
        self.vx += 0.2 * (x - expected_x) / dt
        self.vy += 0.2 * (y - expected_y) / dt
        self.x = expected_x + 0.5 * (x - expected_x)
        self.y = expected_y + 0.5 * (y - expected_y)
        self.clock = clock


class ScanBodies:
    """The bodies about one robot."""

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._tracks: list[_Track] = []

    def scan(self, clock: Instant, lidar: Pose, angle: float, step: float, ranges: Sequence[float]) -> None:
        """Take in a scan from the pose `lidar` on the floor: its first ray at `angle`, the others `step` apart."""
        free = self._tracks.copy()
        kept = []
        for x, y in self._bodies(lidar, angle, step, ranges):
            near = min(free, key=lambda track: math.dist(track.ahead(clock), (x, y)), default=None)
            if near is not None and math.dist(near.ahead(clock), (x, y)) < 2.0 * self._arena.shape.radius:
                free.remove(near)
                near.take(x, y, clock)
                kept.append(near)
            else:
                kept.append(_Track(x, y, clock))
        self._tracks = kept + [track for track in free if clock - track.clock <= KEPT]

    def _bodies(self, lidar: Pose, angle: float, step: float, ranges: Sequence[float]) -> Iterator[tuple[float, float]]:
        """Yield the places of bodies that a scan shows."""
        radius = self._arena.shape.radius
        for cluster in self._clusters(lidar, angle, step, ranges):
            x0, y0, _ = cluster[0]
            x1, y1, _ = cluster[-1]
            if len(cluster) < 3 or math.dist((x0, y0), (x1, y1)) > 3.0 * radius:
                continue
            near = min(metres for _, _, metres in cluster)
            way = math.atan2(0.5 * (y0 + y1) - lidar.y, 0.5 * (x0 + x1) - lidar.x)
            yield lidar.x + (near + radius) * math.cos(way), lidar.y + (near + radius) * math.sin(way)

    def _clusters(
        self, lidar: Pose, angle: float, step: float, ranges: Sequence[float]
    ) -> list[list[tuple[float, float, float]]]:
        """Return what belongs together of the points that are no wall: x, y and the way from the lidar."""
        shape = self._arena.shape
        reach = shape.view_depth + 2.0 * shape.radius
        clusters: list[list[tuple[float, float, float]]] = []
        for k, metres in enumerate(ranges):
            if not 0.0 < metres <= reach:  # NaN and infinite: nothing there
                continue
            way = lidar.theta + angle + k * step
            x = lidar.x + metres * math.cos(way)
            y = lidar.y + metres * math.sin(way)
            if self._arena.clearance(x, y) < 0.07:
                continue  # it may be of the wall: the pose is known to some centimetres
            if clusters and math.dist(clusters[-1][-1][:2], (x, y)) <= APART_M:
                clusters[-1].append((x, y, metres))
            else:
                clusters.append([(x, y, metres)])
        if len(clusters) > 1 and math.dist(clusters[-1][-1][:2], clusters[0][0][:2]) <= APART_M:
            clusters[0] = clusters.pop() + clusters[0]  # around the end of the scan
        return clusters

    def in_view(self, clock: Instant, robot: Pose, known: Iterable[SeenBody]) -> tuple[SeenBody, ...]:
        """Return the bodies in the field of view of a robot at `robot`, but for those that are `known` already."""
        shape = self._arena.shape
        taken = [(body.x, body.y) for body in known]
        cos = math.cos(robot.theta)
        sin = math.sin(robot.theta)
        found = []
        for track in self._tracks:
            if clock - track.clock > KEPT:
                continue
            x, y = track.ahead(clock)
            dx = x - robot.x
            dy = y - robot.y
            ahead = cos * dx + sin * dy
            left = cos * dy - sin * dx
            away = math.hypot(dx, dy)
            half_width = math.asin(min(1.0, shape.radius / away)) if away > 0.0 else math.pi
            beside = abs(math.atan2(left, ahead)) - half_width > shape.view_angle / 2
            if beside or away > shape.view_depth + shape.radius:
                continue
            if any(math.dist(each, (ahead, left)) < 1.5 * shape.radius for each in taken):
                continue
            vx = cos * track.vx + sin * track.vy
            vy = cos * track.vy - sin * track.vx
            found.append((away, SeenBody(ahead, left, vx, vy)))
        return tuple(body for _, body in sorted(found, key=lambda each: each[0]))
