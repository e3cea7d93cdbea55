"""How long a robot needs to its commit line, asked again and again while the robot does something else.

A plan costs milliseconds, so it is made from the place where the present drive ends (or from where the robot
stands) and kept until that place changes; the rest of the drive is added as time.
"""

from functools import lru_cache
from itertools import pairwise
from typing import Final

from rmr.base.arena import Area, Arena, FloorPassage
from rmr.base.direction import EXCLUSIVE
from rmr.base.geometry import Point, Pose, distance
from rmr.base.grid_path import GridPath
from rmr.base.motion_scale import scale_of
from rmr.base.time import Duration, milliseconds, seconds
from rmr.node.motion import forecast
from rmr.node.motion.estimate import Estimate
from rmr.node.motion.grid import grid_of
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.route import leader_route

MOVED_M: Final = 0.05
"""A cell: a robot that has moved less has the same route."""
SETTLE: Final[Duration] = milliseconds(600)
"""What turning to the queue's heading and setting out again costs."""
ORDER_MARGIN: Final[Duration] = milliseconds(350)
"""By how much a robot shall be at its place before the next one is at a nearer place."""


class Approach:
    """Estimates of one robot."""

    def __init__(self, navigator: Navigator, finishes_in_order: bool = True) -> None:
        self._navigator = navigator
        self._finishes_in_order = finishes_in_order
        self._made: tuple[Point, Point, Estimate] | None = None

    def estimate(self, pose: Pose, goal: Point) -> Estimate | None:
        """Return what the drive to `goal` will take from now on; None when there is no route."""
        navigator = self._navigator
        route = navigator.route
        if route is not None and route.gate_m is not None and self._made is not None:
            kept = self._made[2]
            same = kept.passage == route.passage and kept.way == route.way
            if same or not navigator.arena.has_shared_passages:
                return kept._replace(approach=navigator.eta_gate())
        if route is not None and route.gate_m is not None and navigator.arena.has_shared_passages:
            return forecast.estimate_of_drive(navigator)
        origin = pose
        rest = 0
        if navigator.status == "moving" and route is not None:
            end = route.points[-1]
            origin = Pose(end.x, end.y, pose.theta)
            rest = seconds(navigator.remaining_m / navigator.arena.shape.speed) + SETTLE
        made = self._plan(origin, goal)
        return None if made is None else made._replace(approach=made.approach + rest)

    def _plan(self, origin: Pose, goal: Point) -> Estimate | None:
        start = Point(origin.x, origin.y)
        if self._made is not None:
            was, to, estimate = self._made
            if to == goal and distance(*was, *start) <= MOVED_M:
                return estimate
        made = forecast.estimate(self._navigator.arena, origin, goal)
        if made is not None:
            self._made = (start, goal, made)
        return made

    def shared(self, pose: Pose, goal: Point, passage: FloorPassage | None, direction: int) -> dict[int, GridPath]:
        """Return the paths that the robot shares when it leads at `passage`, by direction.

        In its own one, `direction`, from `pose` to `goal`, and in the opposite one from the end to where it comes from.
        """
        navigator = self._navigator
        arena = navigator.arena
        paths = {direction: forecast.shared_path(arena, pose, goal, navigator.behind)}
        if passage is not None and not passage.one_way and direction != EXCLUSIVE:
            end = passage.end(direction)
            paths[passage.back(direction)] = forecast.shared_path(arena, Pose(*end, 0.0), Point(pose.x, pose.y))
        return {each: path for each, path in paths.items() if path is not None}

    def headway(self, area: Area, passage: FloorPassage | None, direction: int) -> Duration:
        """Return the time between two entries into `passage` in `direction` to `area`.

        Hulls keep clear of each other, and where the K-th robot's place is farther than the next one's, the next
        one waits so much longer that robots finish in the order in which they enter. Not where others come out of
        the passage, nor in a crowd: there time is what deadlines are missed for, and each headway delays many.
        """
        arena = self._navigator.arena
        apart = (2 * arena.shape.radius + scale_of(arena.shape).headway_m) / arena.shape.speed
        lengths: tuple[float, ...] = ()
        if passage is not None and passage.one_way and area.slotted and self._finishes_in_order:
            lengths = departures(arena, passage.entrance(direction), area.name)
        spread = max((a - b for a, b in pairwise(lengths)), default=0.0) / arena.shape.speed
        return max(seconds(apart), seconds(spread) + ORDER_MARGIN)


@lru_cache(maxsize=16)
def departures(arena: Arena, entrance: Point, area_name: str) -> tuple[float, ...]:
    """Return how far each place of an area is from an `entrance`, metres; empty without a route."""
    area = arena.area(area_name)
    if area is None:
        return ()
    routes = [leader_route(arena, entrance, place, (), through_gate=False) for place in area.places]
    return tuple(route.length_m for route in routes if route is not None)


def is_divided(arena: Arena, area: Area) -> bool:
    """Return whether a way from one slot of `area` to another leads through a passage of all robots."""
    return area.slotted and arena.has_shared_passages and len(_sides(arena, area)) > 1


@lru_cache(maxsize=64)
def _sides(arena: Arena, area: Area) -> tuple[tuple[Point, ...], ...]:
    """Return the slots of `area` in groups: between those of one group the ways lead through no passage."""
    found: list[list[Point]] = []
    for place in area.places:
        side = next((side for side in found if _is_free_way(arena, side[0], place)), None)
        if side is None:
            found.append([place])
        else:
            side.append(place)
    return tuple(map(tuple, found))


def side_of(arena: Arena, area: Area, pose: Pose) -> tuple[Point, ...]:
    """Return the slots of `area` to which the way from `pose` leads through no passage; empty if it does to all."""
    return _side_of_cell(arena, area, int(pose.x / arena.cell), int(pose.y / arena.cell))


@lru_cache(maxsize=4096)
def _side_of_cell(arena: Arena, area: Area, column: int, row: int) -> tuple[Point, ...]:
    """Return it for the middle of a grid cell: a plan costs milliseconds, and hellos ask again and again."""
    here = Point((column + 0.5) * arena.cell, (row + 0.5) * arena.cell)
    return next((side for side in _sides(arena, area) if _is_free_way(arena, here, side[0])), ())


def _is_free_way(arena: Arena, start: Point, place: Point) -> bool:
    """Return whether the way from `start` to `place` leads through no passage."""
    route = leader_route(arena, start, place, (), through_gate=True)
    return route is not None and route.gate_m is None


def foresee(arena: Arena) -> None:
    """Work out what plans need of the arena alone. It takes tenths of a second: once, before lab time runs."""
    grid_of(arena)
    for area in arena.areas:
        is_divided(arena, area)
    for passage in arena.passages:
        for area in arena.areas if passage.one_way else ():
            if area.slotted:
                departures(arena, passage.entrance(0), area.name)
