"""Which place of an area a robot takes: of slots by its rank in a schedule, of a box the spot nearest to its middle."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point, distance
from rmr.node.motion.route import leader_route

SPOT_GAP_M: Final = 0.06
"""Gap between the hulls of two robots that stand in one box."""
SPOT_INSET_M: Final = 0.03
"""Distance of a spot from the box's edge, so that localisation noise does not put the robot outside."""
SPOTS_MAX: Final = 64
"""Spots of one box that are considered, from its middle outwards."""


def nearest_free(
    places: Sequence[Point], claimed: Sequence[Point], reach_m: float, stood: Sequence[Point], room_m: float
) -> Point:
    """Return the first of `places` that is free; the first one if none is.

    A place is taken when it is `claimed` within `reach_m`, or a robot has `stood` within `room_m` of it, metres.
    """
    for place in places:
        free = all(distance(*place, *at) > reach_m for at in claimed)
        if free and all(distance(*place, *at) > room_m for at in stood):
            return place
    return places[0]


@lru_cache(maxsize=256)
def in_order(arena: Arena, area: Area, first: int) -> tuple[Point, ...]:
    """Return where robots may stand in `area`, the one first that is the `first`, from 0, of an area with slots.

    A robot asks for its turn with its way to the area's first place. The places that are in one room with that come
    before the others: else the place would change with the rank, and the passage at which to ask with the place.
    """
    places = spots(arena, area)
    if not area.slotted:
        return places
    room, others = rooms(arena, places)
    first %= len(room)
    return (*room[first:], *room[:first], *others)


@lru_cache(maxsize=64)
def rooms(arena: Arena, places: tuple[Point, ...]) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    """Return those of `places` to which no passage leads from the first one, and the others."""
    start = places[0]
    others = [
        place
        for place in places[1:]
        if arena.passages
        and (route := leader_route(arena, start, place, (), through_gate=True)) is not None
        and route.gate_m is not None
    ]
    return tuple(place for place in places if place not in others), tuple(others)


@lru_cache(maxsize=64)
def spots(arena: Arena, area: Area) -> tuple[Point, ...]:
    """Return where robots may stand in `area`: its places, or the spots that fit a box, from its middle outwards."""
    if area.box is None:
        return area.places
    x0, y0, x1, y1 = area.box
    middle = area.places[0]
    across = _row(x1 - x0, arena.shape.radius)
    up = _row(y1 - y0, arena.shape.radius)
    offsets = sorted((dx * dx + dy * dy, dx, dy) for dx in across for dy in up)[:SPOTS_MAX]
    points = (Point(middle.x + dx, middle.y + dy) for _, dx, dy in offsets)
    return tuple(point for point in points if arena.clearance(*point) > arena.shape.radius) or area.places


def _row(length_m: float, radius_m: float) -> list[float]:
    """Return the offsets from the middle of as many robots as stand side by side with their centres in `length_m`."""
    step = 2 * radius_m + SPOT_GAP_M
    count = 1 + max(0, int((length_m - 2 * SPOT_INSET_M) / step))
    return [(i - (count - 1) / 2) * step for i in range(min(count, SPOTS_MAX))]
