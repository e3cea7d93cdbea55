"""The passages of a lab that names none: the narrow sections of its floor in which robots take turns by themselves."""

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from rmr.base.arena import Arena, FloorPassage, found_passage
from rmr.base.geometry import Point, distance
from rmr.node.motion.route import ROOM_M, way_through_m
from rmr_world.narrow_places import narrow_places
from rmr_world.units import PASSAGES_MAX

LONGER: Final = 1.2
"""A way from end to end that is longer than the centre line times this leads elsewhere."""


def found_passages(arena: Arena, stays: Iterable[Point]) -> tuple[FloorPassage, ...]:
    """Return the narrow sections of the floor of `arena` at which robots can take turns; of too many the longest.

    Left out are those in which a robot `stays`, at its start or its goal, since it would hold the passage; those which
    no way of the planner leads through; and those with too little room for the robots that wait before them.
    """
    places = tuple(stays)
    usable = [
        each
        for each in narrow_places(arena).passages
        if 0.0 < way_through_m(arena, *each.ends) <= LONGER * each.length and not any(map(each.holds, places))
    ]
    passages = [found_passage(each.name, each.ends) for each in usable]
    clear = [
        each
        for each in passages
        if not any(other is not each and next(too_near(arena, each, other), None) for other in passages)
    ]
    length = {each.name: each.length for each in usable}
    longest = sorted(clear, key=lambda each: -length[each.name])[:PASSAGES_MAX]
    return tuple(each for each in clear if each in longest)


class NearEnds(NamedTuple):
    """Two ends of different passages at which waiting robots stand in each other's way."""

    gap_m: float
    apart_m: float
    """How far they have to be apart, metres."""
    faces: bool
    """Whether each lies straight before the other."""


def too_near(arena: Arena, one: FloorPassage, other: FloorPassage) -> Iterator[tuple[int, int, NearEnds]]:
    """Yield the ends of two passages, by their directions, at which robots that wait stand in each other's way."""
    # What a robot that waits leaves free for one that comes out (`rmr.node.motion.route`), and its own hull.
    wait_m = 4.0 * arena.shape.radius + ROOM_M
    for way, mouth in enumerate(one.mouths):
        for its_way, its_mouth in enumerate(other.mouths):
            faces = _faces(one, way, its_mouth) and _faces(other, its_way, mouth)
            near = NearEnds(distance(*mouth, *its_mouth), 2.0 * wait_m if faces else wait_m, faces)
            if near.gap_m < near.apart_m:
                yield way, its_way, near


def _faces(passage: FloorPassage, way: int, point: Point) -> bool:
    """Return whether `point` lies straight before the entrance for `way`, within 60 degrees."""
    if not passage.two_ended:
        return False
    mouth = passage.mouth(way)
    end = passage.mouth(1 - way)
    ahead = (point.x - mouth.x) * (mouth.x - end.x) + (point.y - mouth.y) * (mouth.y - end.y)
    return ahead > 0.5 * distance(*point, *mouth) * distance(*mouth, *end)
