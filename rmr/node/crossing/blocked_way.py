"""Ways that the dead bar: whether a robot that has been silent for long stands in the only way to a goal.

A robot that never comes back never leaves. Where it stands in the only passage, those behind it are told so at once,
and need not wait for living robots to make room. Whether there is a way is decided by the planner of the robots, with
the dead as the only obstacles besides those of the floor.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from rmr.base.arena import Arena, FloorPassage
from rmr.base.geometry import Point, Pose, distance
from rmr.base.time import in_seconds
from rmr.node.crossing.resource import OFF_ROUTE_M, entry_routes, located
from rmr.node.motion.astar import plan
from rmr.node.motion.obstruction import obstruction
from rmr.node.peers.perception import LostRobot

PLACE_M: Final = 0.01
"""Raster of the places from which a way is looked for, so that a robot that stands is looked after once."""


def barring(arena: Arena, start: Point, goal: Point, lost: Mapping[int, LostRobot]) -> tuple[int, ...]:
    """Return those of the `lost` robots that bar every way from `start` to `goal`; none if there is a way."""
    if not lost:
        return ()
    from_ = Point(round(start.x / PLACE_M) * PLACE_M, round(start.y / PLACE_M) * PLACE_M)
    keep = 2.0 * arena.shape.radius
    return _barring(arena, from_, goal, tuple((robot, _off(body.place, from_, keep)) for robot, body in lost.items()))


def _off(place: Point, start: Point, keep: float) -> Point:
    """Return `place`, or farther away behind it: a body nearer than `keep` to the robot at `start` would touch it.

    It has driven on since it was heard last. A plan leads past an obstacle in which it begins.
    """
    away = distance(*place, *start)
    if away >= keep or away == 0.0:
        return place
    farther = keep / away
    return Point(start.x + (place.x - start.x) * farther, start.y + (place.y - start.y) * farther)


@lru_cache(maxsize=256)
def _barring(arena: Arena, start: Point, goal: Point, lost: tuple[tuple[int, Point], ...]) -> tuple[int, ...]:
    if plan(arena, start, goal, [place for _, place in lost]) is not None:
        return ()
    return obstruction(arena, start, goal, dict(lost)).robots


def blocked_words(arena: Arena, goal: Point, robots: tuple[int, ...], lost: Mapping[int, LostRobot]) -> str:
    """Return a sentence on the `robots` that bar the way to `goal`, without a full stop."""
    passage = next((p for robot in robots if (p := _passage_at(arena, goal, lost[robot].place)) is not None), None)
    what = "way" if passage is None else "bottleneck" if passage.by_event else f"passage '{passage.name}'"
    return f"the {what} is blocked by {silent_words(robots, lost)}"


def silent_words(robots: tuple[int, ...], lost: Mapping[int, LostRobot]) -> str:
    """Return the `robots`, which are `lost`, with the times since which they have been silent."""
    since_s = {robot: in_seconds(lost[robot].silent_since) for robot in robots}
    names = [f"robot {robot}, which has been silent since {since_s[robot]:.1f} s" for robot in robots]
    return ", and by ".join(names)


def _passage_at(arena: Arena, goal: Point, place: Point) -> FloorPassage | None:
    """Return the passage on the way to `goal` in which a body at `place` is, or before one of whose ends."""
    for passage in arena.passages:
        reach_m = 2.0 * arena.shape.radius
        for entry in entry_routes(arena, passage, goal):
            s, off_m = located(entry.route, Pose(place.x, place.y, 0.0))
            if off_m < OFF_ROUTE_M and entry.entrance_m - reach_m < s < entry.route.clear_m + reach_m:
                return passage
    return None
