"""The arena as both the world and the robots know it: its size, its obstacles and its named areas.

Plain data, made by the lab file's loader and carried to the robots over the bus as the result of `to_data`;
the physics and the planner are built from the same value.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Final

from rmr.base.geometry import Point, distance, point_segment_distance

Extent = tuple[float, float, float, float]
"""The least x and y of an obstacle, and the greatest."""


ROUNDING_M: Final = 1e-9
"""More than arithmetic may take from a distance: obstacles whose box is farther away than this are not looked at."""


@dataclass(frozen=True, slots=True)
class Disc:
    """A round obstacle."""

    centre: Point
    radius: float
    """Metres."""
    extent: Extent = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        (x, y) = self.centre
        r = self.radius
        object.__setattr__(self, "extent", (x - r, y - r, x + r, y + r))

    def distance(self, x: float, y: float) -> float:
        """Return how far (x, y) is outside the disc in metres; 0 inside."""
        return max(0.0, distance(x, y, *self.centre) - self.radius)


@dataclass(frozen=True, slots=True)
class Polygon:
    """A convex obstacle, its corners counter-clockwise."""

    corners: tuple[Point, ...]
    extent: Extent = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        xs, ys = zip(*self.corners, strict=True)
        object.__setattr__(self, "extent", (min(xs), min(ys), max(xs), max(ys)))

    def contains(self, x: float, y: float) -> bool:
        """Return whether (x, y) lies inside or on the edge."""
        a = self.corners[-1]
        ax = a.x
        ay = a.y
        for b in self.corners:
            bx = b.x
            by = b.y
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) < 0.0:
                return False
            ax = bx
            ay = by
        return True

    def distance(self, x: float, y: float) -> float:
        """Return how far (x, y) is outside the polygon in metres; 0 inside."""
        if self.contains(x, y):
            return 0.0
        corners = self.corners
        return min(
            point_segment_distance(x, y, *a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        )


Obstacle = Disc | Polygon


@dataclass(frozen=True, slots=True)
class Area:
    """A named place of the lab file. `places` is never empty."""

    name: str
    places: tuple[Point, ...]
    """For `at` the one point, for `slots` and `line` the slots in order, for `box` its centre."""
    box: tuple[float, float, float, float] | None = None
    """x0, y0, x1, y1 of a `box` area: a robot is at the area anywhere inside."""
    slotted: bool = False
    """Whether the K-th robot of the schedule takes the K-th place."""
    queue: tuple[Point, ...] = ()
    """Where the K-th robot waits (`lineup`), K from 1; as many as fit on the queue's path."""


@dataclass(frozen=True, slots=True)
class RobotShape:
    """What all robots of a lab have in common."""

    radius: float = 0.07
    """Metres."""
    speed: float = 0.2
    """Greatest forward speed, m/s."""
    turn: float = math.pi
    """Greatest turn rate, rad/s."""
    view_angle: float = math.radians(60)
    """Whole opening angle of the field of view, radians (paper IV.E)."""
    view_depth: float = 0.25
    """Depth of view, metres, from the robot's centre to the nearest point of the other body."""


@dataclass(frozen=True, slots=True)
class Arena:
    """Everything about the lab's floor."""

    width: float
    height: float
    cell: float
    """Edge of a grid cell, metres (paper IV.D.2: 0.05)."""
    obstacles: tuple[Obstacle, ...] = ()
    areas: tuple[Area, ...] = ()
    beacons: tuple[Point, ...] = ()
    """Ultrasonic beacons of the localisation service."""
    bottleneck: tuple[str, ...] = ()
    """The areas at the mouths of what robots pass one at a time: its entry, or both ends where they come from both."""
    shape: RobotShape = RobotShape()
    _hash: int = field(init=False, compare=False, repr=False)
    """Worked out once: what depends on the arena alone is kept by arena."""

    def __post_init__(self) -> None:
        parts = (self.width, self.height, self.cell, self.obstacles, self.areas, self.beacons, self.bottleneck)
        object.__setattr__(self, "_hash", (parts, self.shape).__hash__())

    def __hash__(self) -> int:
        return self._hash

    def area(self, name: str) -> Area | None:
        """Return the area called `name`, or None."""
        return next((area for area in self.areas if area.name == name), None)

    @property
    def mouths(self) -> tuple[Point, ...]:
        """The bottleneck's entries: none, one, or two; one for each way through it."""
        areas = (self.area(name) for name in self.bottleneck)
        return tuple(area.places[0] for area in areas if area is not None)

    def mouth(self, way: int) -> Point | None:
        """Return where robots of `way` enter the bottleneck; None when there is none."""
        mouths = self.mouths
        return mouths[way % len(mouths)] if mouths else None

    def clearance(self, x: float, y: float) -> float:
        """Return the distance from (x, y) to the nearest obstacle or wall in metres; 0 when inside one."""
        nearest = min(x, y, self.width - x, self.height - y)
        for obstacle in self.obstacles:
            x0, y0, x1, y1 = obstacle.extent
            if max(x0 - x, x - x1, y0 - y, y - y1) <= nearest + ROUNDING_M:
                nearest = min(nearest, obstacle.distance(x, y))
        return max(0.0, nearest)


NOWHERE: Final = Arena(1.0, 1.0, 0.05)
"""The arena of robots without bodies: a floor that nobody stands on."""


def to_data(arena: Arena) -> dict[str, Any]:
    """Return `arena` as plain dicts, lists and numbers (what msgpack carries)."""
    return {
        "width": arena.width,
        "height": arena.height,
        "cell": arena.cell,
        "obstacles": [
            {"centre": list(o.centre), "radius": o.radius}
            if isinstance(o, Disc)
            else {"corners": [list(c) for c in o.corners]}
            for o in arena.obstacles
        ],
        "areas": [
            {
                "name": a.name,
                "places": [list(p) for p in a.places],
                "box": None if a.box is None else list(a.box),
                "slotted": a.slotted,
                "queue": [list(p) for p in a.queue],
            }
            for a in arena.areas
        ],
        "beacons": [list(b) for b in arena.beacons],
        "bottleneck": list(arena.bottleneck),
        "shape": {
            "radius": arena.shape.radius,
            "speed": arena.shape.speed,
            "turn": arena.shape.turn,
            "view_angle": arena.shape.view_angle,
            "view_depth": arena.shape.view_depth,
        },
    }


def from_data(data: dict[str, Any]) -> Arena:
    """Return the arena that `to_data` described. Raises KeyError or TypeError when `data` is something else."""
    return Arena(
        width=data["width"],
        height=data["height"],
        cell=data["cell"],
        obstacles=tuple(
            Disc(Point(*o["centre"]), o["radius"]) if "radius" in o else Polygon(tuple(Point(*c) for c in o["corners"]))
            for o in data["obstacles"]
        ),
        areas=tuple(
            Area(
                a["name"],
                tuple(Point(*p) for p in a["places"]),
                None if a["box"] is None else (a["box"][0], a["box"][1], a["box"][2], a["box"][3]),
                a["slotted"],
                tuple(Point(*p) for p in a["queue"]),
            )
            for a in data["areas"]
        ),
        beacons=tuple(Point(*b) for b in data["beacons"]),
        bottleneck=tuple(data["bottleneck"]),
        shape=RobotShape(**data["shape"]),
    )
