"""Where stations lie: areas that a robot holds from before it drives in until it has left. Geometry, without memory.

A robot is in a station as long as its hull is in the area, or so near to a place that no other robot can stand there.
"""

from collections.abc import Mapping
from typing import Final

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point, distance
from rmr.node.crossing.blocked_way import silent_words
from rmr.node.peers.perception import AT_LEAVE_M, LostRobot

CLEAR_M: Final = 0.02
"""Gap between a hull and a robot on the place: the least at which that one drives past."""


def touches(arena: Arena, area: Area, at: Point) -> bool:
    """Return whether the hull of a robot at `at` is in `area`, or in the way of a robot on one of its places."""
    radius = arena.shape.radius
    if area.box is None:
        return any(distance(*place, *at) < 2.0 * radius + CLEAR_M for place in area.places)
    x0, y0, x1, y1 = area.box
    outside_x = max(x0 - at.x, 0.0, at.x - x1)
    outside_y = max(y0 - at.y, 0.0, at.y - y1)
    return distance(outside_x, outside_y, 0.0, 0.0) < radius


def contains(area: Area, goal: Point) -> bool:
    """Return whether `goal` is a place of `area`, or a point in it."""
    if area.box is None:
        return any(distance(*place, *goal) < AT_LEAVE_M for place in area.places)
    x0, y0, x1, y1 = area.box
    return x0 <= goal.x <= x1 and y0 <= goal.y <= y1


def occupants(arena: Arena, area: Area, lost: Mapping[int, LostRobot]) -> dict[int, LostRobot]:
    """Return those of the `lost` robots that stand in `area`."""
    return {robot: body for robot, body in lost.items() if touches(arena, area, body.place)}


def full_words(arena: Arena, area: Area, lost: Mapping[int, LostRobot]) -> str:
    """Return which of the `lost` robots have all places of the station `area`, in words; empty if places are left."""
    there = occupants(arena, area, lost)
    capacity = arena.capacity(area.name)
    if not capacity or len(there) < capacity:
        return ""
    return f"the station {area.name} is blocked by {silent_words(tuple(there), there)}"
