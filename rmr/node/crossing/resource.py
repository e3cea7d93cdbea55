"""Where a shared resource lies and where a robot stands beside it: geometry of the arena, without memory.

A resource is a narrow section that robots use in turns, entered by one entrance or by either of two. Routes tell where
its entrance and its end are; hold line and commit line come with the route (`rmr.node.motion.gate`).
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

from rmr.base.arena import Area, Arena, FloorPassage
from rmr.base.geometry import Point, Pose, distance
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.route import Route, leader_route

OFF_ROUTE_M: Final = 0.15
"""A robot farther than this from the route through a resource is not on it."""
IN_ENTRANCE_M: Final = 0.02
"""Nearer to an entrance than two radii and this a robot keeps others out."""
NARROW_RADII: Final = 4.0
"""A shorter section than this is passed in a moment: standing in it means nothing."""


class EntryRoute(NamedTuple):
    """The route to a goal from the entrance behind which it lies."""

    route: Route
    entrance: Point
    entrance_m: float
    """Arc length of the entrance on the route."""


def located(route: Route, pose: Pose) -> tuple[float, float]:
    """Return the arc length of the point of `route` nearest to `pose`, and how far away that is, metres."""
    s = route.project(pose.x, pose.y, 0.0, route.length_m)
    return s, distance(*route.point(s), pose.x, pose.y)


def entry_routes(arena: Arena, passage: FloorPassage | None, goal: Point) -> tuple[EntryRoute, ...]:
    """Return the routes to `goal` from the entrances of `passage` behind which it lies.

    Empty where no narrow section of it is on the route.
    """
    return () if passage is None else _entry_routes(arena, passage.name, goal)


@lru_cache(maxsize=256)
def _entry_routes(arena: Arena, name: str, goal: Point) -> tuple[EntryRoute, ...]:
    passage = arena.passage(name)
    found = []
    others = frozenset(each.name for each in arena.passages if each.name != name)
    for entrance in () if passage is None else passage.mouths:
        route = leader_route(arena, entrance, goal, (), through_gate=True, behind=others)
        if route is None or route.gate_m is None:
            continue
        if route.clear_m - route.gate_m > NARROW_RADII * arena.shape.radius:
            found.append(EntryRoute(route, entrance, route.gate_m))
    return tuple(found)


def entered_route(navigator: Navigator) -> Route | None:
    """Return the route that the robot follows, if that leads through a passage."""
    route = navigator.route
    return None if route is None or route.gate_m is None else route


def stands_within(arena: Arena, passage: FloorPassage | None, goal: Area, pose: Pose, slack_m: float = 0.0) -> bool:
    """Return whether a robot at `pose` stands in `passage` on the way to `goal`, or within `slack_m` of that."""
    inset_m = arena.shape.radius - slack_m
    for entry in entry_routes(arena, passage, goal.places[0]):
        s, off_m = located(entry.route, pose)
        if off_m < OFF_ROUTE_M and entry.entrance_m + inset_m < s < entry.route.clear_m - inset_m:
            return True
    return False


def obstructs_exit(arena: Arena, passage: FloorPassage | None, goal: Area, pose: Pose) -> bool:
    """Return whether a robot at `pose` stands where others come out of `passage`, nearer than where it may wait."""
    radius = arena.shape.radius
    entries = [entry for entry in entry_routes(arena, passage, goal.places[0]) if entry.route.room_m > 0.0]
    beside = any(
        distance(*entry.route.point(entry.entrance_m), pose.x, pose.y) < entry.route.room_m + radius
        for entry in entries
    )
    return beside or (bool(entries) and stands_within(arena, passage, goal, pose, radius))


def in_entrance(navigator: Navigator, passage: FloorPassage | None, goal: Area | None, pose: Pose | None) -> bool:
    """Return whether the robot is so near to an entrance by which no robot comes out that it blocks others.

    Standing, without a route, it is judged by `passage`, through which its way to `goal` will lead; None: through none.
    """
    route = navigator.route
    near_m = 2.0 * navigator.arena.shape.radius + IN_ENTRANCE_M
    if route is not None:
        if route.gate_m is None or route.within or route.room_m > 0.0 or navigator.aside:
            return False
        return route.gate_m - near_m < route.length_m - navigator.remaining_m < route.clear_m
    entries = () if goal is None or pose is None else entry_routes(navigator.arena, passage, goal.places[0])
    return pose is not None and any(
        entry.route.room_m <= 0.0 and distance(*entry.entrance, pose.x, pose.y) < near_m for entry in entries
    )


def is_clear(navigator: Navigator, entered: Route | None, pose: Pose | None, *, stays: bool = False) -> bool:
    """Return whether the robot is out of the resource, even if its drive has been broken off inside.

    A robot whose action has failed and that `stays` where it is holds up others only if its hull is in the resource:
    before the hold line it gives its turn back.
    """
    ahead = entered_route(navigator)
    if ahead is not None and (entered is None or entered.passage == ahead.passage):
        return navigator.cleared
    if pose is None or entered is None or entered.gate_m is None:
        return True
    s, off_m = located(entered, pose)
    before_m = navigator.arena.shape.radius if stays else OFF_ROUTE_M
    return off_m > OFF_ROUTE_M or not entered.gate_m - before_m < s < entered.clear_m


def is_beyond(arena: Arena, passage: FloorPassage | None, goal: Area, pose: Pose) -> bool:
    """Return whether a robot at `pose` has `passage` behind it on its way to a goal with room for many.

    It has if it is nearer to the far end of the passage that leads there than to its entrance. A drive that does not
    pass the resource is no evidence: it may lead through another aisle, or to a goal on this side.
    """
    entries = entry_routes(arena, passage, goal.places[0]) if goal.slotted or goal.box is not None else ()
    here = Point(pose.x, pose.y)

    def away_m(place: Point) -> float:
        route = leader_route(arena, here, place, (), through_gate=False)
        return math.inf if route is None else route.length_m

    for entry in entries:
        entrance_m = away_m(entry.route.point(entry.entrance_m))
        if entrance_m < math.inf and entrance_m <= away_m(entry.route.point(entry.route.clear_m)):
            return False
    return bool(entries)
