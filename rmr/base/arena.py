"""The arena, shared by world and robots: its size, its obstacles and its named areas.

Plain data, made by the loader of the lab file and sent to the robots over the bus in the form of `to_data`. Physics and
planner are built from the same value.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any, Final

from rmr.base.direction import direction_of, ends_of
from rmr.base.geometry import Point, distance, point_segment_distance

Extent = tuple[float, float, float, float]
"""Axis-aligned bounding box of an obstacle: least x, least y, greatest x, greatest y, metres."""


ROUNDING_M: Final = 1e-9
"""Margin of the bounding-box test, metres: an upper bound of the rounding error of a distance."""
BRAKE: Final = 0.8
"""Greatest acceleration and deceleration of the wheels, m/s^2: the world's bodies have it, the robots count on it."""
TURN_ACCELERATION: Final = 12.0
"""Greatest change of the turn rate, rad/s^2, likewise."""


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
        # Cross product of each edge with the point: negative means right of the edge, so outside.
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
        # The nearest edge is one of those that have the point on their outer side, to their right: mostly one or two.
        nearest = math.inf
        a = self.corners[-1]
        ax = a.x
        ay = a.y
        for b in self.corners:
            bx = b.x
            by = b.y
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) < 0.0:
                nearest = min(nearest, point_segment_distance(x, y, ax, ay, bx, by))
            ax = bx
            ay = by
        return 0.0 if nearest == math.inf else nearest


Obstacle = Disc | Polygon


@dataclass(frozen=True, slots=True)
class Area:
    """A named place of the lab file. `places` is never empty."""

    name: str
    places: tuple[Point, ...]
    """The points of the area: the one of `at`, the slots of `slots` and `line` in order, the centre of `box`."""
    box: tuple[float, float, float, float] | None = None
    """x0, y0, x1, y1 of a `box` area, metres: a robot anywhere inside is at the area."""
    slotted: bool = False
    """Whether the K-th robot of the schedule takes the K-th place."""
    queue: tuple[Point, ...] = ()
    """Waiting points for `lineup`, the K-th robot's at index K - 1; as many as fit on the path of the queue."""


BOTTLENECK: Final = "bottleneck"
"""Name of the passage of the lab file's key `bottleneck`."""


@dataclass(frozen=True, slots=True)
class FloorPassage:
    """A narrow section of the floor that robots pass in turns."""

    name: str
    entrances: tuple[Area, ...]
    """The areas at its ends: one, or two if robots enter at both."""
    found: bool = False
    """Whether it was found on the floor; the lab names no passage."""
    mouths: tuple[Point, ...] = field(init=False, compare=False, repr=False)
    """The point of each entrance."""
    ways: tuple[int, ...] = field(init=False, compare=False, repr=False)
    """The directions from end to end (`rmr.base.direction`); none of one entrance."""

    def __post_init__(self) -> None:
        count = len(self.entrances)
        object.__setattr__(self, "mouths", tuple(area.places[0] for area in self.entrances))
        object.__setattr__(self, "ways", tuple(direction_of(*ends, count) for ends in permutations(range(count), 2)))

    @property
    def by_event(self) -> bool:
        """Whether its turns are those of the robots' events: jobs of different events do not exclude each other."""
        return self.name == BOTTLENECK

    @property
    def ends(self) -> Iterator[tuple[Point, Area]]:
        """Its mouths with their areas."""
        return zip(self.mouths, self.entrances, strict=True)

    @property
    def one_way(self) -> bool:
        """Whether it has one entrance: no robot comes out of it there."""
        return len(self.entrances) == 1

    def entrance(self, way: int) -> Point:
        """Return where robots of direction `way` enter."""
        return self.mouths[ends_of(way)[0] % len(self.mouths)]

    def end(self, way: int) -> Point:
        """Return where they leave; of a passage with one entrance that."""
        return self.mouths[ends_of(way)[1] % len(self.mouths)]

    def back(self, way: int) -> int:
        """Return the direction that leads the other way."""
        entrance, end = ends_of(way)
        return direction_of(end, entrance, len(self.entrances))


@dataclass(frozen=True, slots=True)
class RobotShape:
    """The body, drive and field of view, equal for all robots of a lab."""

    radius: float = 0.07
    """Radius of the body, metres."""
    speed: float = 0.2
    """Greatest forward speed, m/s."""
    turn: float = math.pi
    """Greatest turn rate, rad/s."""
    view_angle: float = math.radians(60)
    """Whole opening angle of the field of view, radians (paper IV.E)."""
    view_depth: float = 0.25
    """Depth of view, metres, from the robot's centre to the nearest point of the other body."""


REFERENCE: Final = RobotShape()
"""The robot of the paper, with which the margins of motion were measured."""


@dataclass(frozen=True, slots=True)
class Arena:
    """The floor of a lab."""

    width: float
    height: float
    cell: float
    """Edge length of a grid cell, metres (paper IV.D.2: 0.05)."""
    obstacles: tuple[Obstacle, ...] = ()
    areas: tuple[Area, ...] = ()
    beacons: tuple[Point, ...] = ()
    """Ultrasonic beacons of the localisation service."""
    passages: tuple[FloorPassage, ...] = ()
    """The passages that robots pass in turns, none twice by name."""
    stations: tuple[tuple[str, int], ...] = ()
    """Areas that robots hold from before they drive in until they have left, with how many may be there at a time."""
    shape: RobotShape = RobotShape()
    range_sigma: float = 0.005
    """Standard deviation of a range to a beacon, metres, as the localisation service states it."""
    _hash: int = field(init=False, compare=False, repr=False)
    """The hash, computed once, since arenas are keys of caches."""

    def __post_init__(self) -> None:
        parts = (
            self.width,
            self.height,
            self.cell,
            self.obstacles,
            self.areas,
            self.beacons,
            self.range_sigma,
            self.passages,
            self.stations,
        )
        object.__setattr__(self, "_hash", (parts, self.shape).__hash__())

    def __hash__(self) -> int:
        return self._hash

    def area(self, name: str) -> Area | None:
        """Return the area called `name`, or None."""
        return next((area for area in self.areas if area.name == name), None)

    def capacity(self, name: str) -> int:
        """Return how many robots may be in the station `name` at a time; 0 if the area is no station."""
        return next((capacity for station, capacity in self.stations if station == name), 0)

    def passage(self, name: str | None) -> FloorPassage | None:
        """Return the passage called `name`, or None."""
        return next((passage for passage in self.passages if passage.name == name), None)

    @property
    def has_shared_passages(self) -> bool:
        """Whether there are passages whose turns are those of all robots, whatever their events."""
        return any(not passage.by_event for passage in self.passages)

    def clearance(self, x: float, y: float) -> float:
        """Return the distance from (x, y) to the nearest obstacle or wall in metres; 0 when inside one."""
        return self.clearance_of(self.obstacles, x, y)

    def clearance_of(self, obstacles: Sequence[Obstacle], x: float, y: float) -> float:
        """Return the same for some of the obstacles, and the walls."""
        nearest = min(x, y, self.width - x, self.height - y)
        far = nearest + ROUNDING_M
        for obstacle in obstacles:
            # The distance to the bounding box is a lower bound: a farther box cannot hold the nearest obstacle.
            x0, y0, x1, y1 = obstacle.extent
            if x0 - x <= far and x - x1 <= far and y0 - y <= far and y - y1 <= far:
                away = obstacle.distance(x, y)
                if away < nearest:
                    nearest = away
                    far = nearest + ROUNDING_M
        return max(0.0, nearest)

    def obstacles_around(self, x: float, y: float, reach_m: float) -> list[Obstacle]:
        """Return all obstacles that can be the nearest one of a point within `reach_m` of (x, y)."""
        # Such a point is at most `clearance + reach_m` from its nearest obstacle, (x, y) at most `reach_m` farther.
        far = self.clearance(x, y) + 2.0 * reach_m + ROUNDING_M
        return [
            obstacle
            for obstacle in self.obstacles
            if max(obstacle.extent[0] - x, x - obstacle.extent[2], obstacle.extent[1] - y, y - obstacle.extent[3])
            <= far
        ]


NOWHERE: Final = Arena(1.0, 1.0, 0.05)
"""Placeholder arena for robots without bodies."""


def to_data(arena: Arena) -> dict[str, Any]:
    """Return `arena` as dicts, lists and numbers, for msgpack."""
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
        "range_sigma": arena.range_sigma,
        "passages": [
            [passage.name, [list(mouth) if passage.found else area.name for mouth, area in passage.ends]]
            for passage in arena.passages
        ],
        "stations": [[name, capacity] for name, capacity in arena.stations],
        "shape": {
            "radius": arena.shape.radius,
            "speed": arena.shape.speed,
            "turn": arena.shape.turn,
            "view_angle": arena.shape.view_angle,
            "view_depth": arena.shape.view_depth,
        },
    }


def from_data(data: dict[str, Any]) -> Arena:
    """Return the arena of `to_data`'s form. Raises KeyError or TypeError for any other data."""
    areas = tuple(
        Area(
            a["name"],
            tuple(Point(*p) for p in a["places"]),
            None if a["box"] is None else (a["box"][0], a["box"][1], a["box"][2], a["box"][3]),
            a["slotted"],
            tuple(Point(*p) for p in a["queue"]),
        )
        for a in data["areas"]
    )
    return Arena(
        width=data["width"],
        height=data["height"],
        cell=data["cell"],
        obstacles=tuple(
            Disc(Point(*o["centre"]), o["radius"]) if "radius" in o else Polygon(tuple(Point(*c) for c in o["corners"]))
            for o in data["obstacles"]
        ),
        areas=areas,
        beacons=tuple(Point(*b) for b in data["beacons"]),
        range_sigma=data.get("range_sigma", 0.005),  # recordings of before have none
        passages=_passages(data, {area.name: area for area in areas}),
        stations=tuple(
            (name, capacity) for name, capacity in data.get("stations", ())
        ),  # recordings of before have none
        shape=RobotShape(**data["shape"]),
    )


def _passages(data: dict[str, Any], areas: dict[str, Area]) -> tuple[FloorPassage, ...]:
    """Return the passages of `data`; recordings of before have one at most, by its entrances. Raises KeyError."""
    # In a recording these are tuples, which compiled code does not take for lists.
    named: Iterable[Sequence[Any]] = data.get("passages", ())
    if "passages" not in data and data["bottleneck"]:
        named = [(BOTTLENECK, data["bottleneck"])]
    return tuple(
        FloorPassage(name, tuple(areas[each] for each in ends))
        if all(isinstance(each, str) for each in ends)
        else found_passage(name, [Point(*each) for each in ends])
        for name, ends in named
    )


def found_passage(name: str, mouths: Sequence[Point]) -> FloorPassage:
    """Return a passage that was found on the floor, with areas at its `mouths` that no lab names."""
    return FloorPassage(name, tuple(Area(f"{name} end {k}", (at,)) for k, at in enumerate(mouths, 1)), found=True)
