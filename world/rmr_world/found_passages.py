"""The passages that a lab does not name: the narrow sections of its floor in which robots take turns by themselves."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from rmr.base.arena import Arena, FloorPassage, found_passage
from rmr.base.geometry import Point, distance, point_segment_distance
from rmr.base.motion_scale import scale_of
from rmr.node.motion.route import GATE_REACH_M, ROOM_M, way_through_m
from rmr_world.narrow_places import NarrowPassage, narrow_places
from rmr_world.units import PASSAGES_MAX


def found_passages(arena: Arena, stays: Iterable[Point]) -> tuple[FloorPassage, ...]:
    """Return the narrow sections of the floor of `arena` at which robots can take turns; of too many the longest.

    Left out are those of the passages that `arena` has already; those in which a robot `stays`, at its start or its
    goal, since it would hold the passage; those which no way of the planner leads through; and those with too little
    room for the robots that wait before them.
    """
    places = tuple(stays)
    size = scale_of(arena.shape).size
    # A way from end to end that is longer than the centre line times this leads elsewhere.
    usable = [
        each
        for each in narrow_places(arena).passages
        if not any(belongs(each, named.mouths, size) for named in arena.passages)
        and 0.0 < way_through_m(arena, *each.ends) <= 1.2 * each.length
        and not any(map(each.holds, places))
    ]
    names = {each.name for each in arena.passages}
    passages = [found_passage(f"{each.name}_found" if each.name in names else each.name, each.ends) for each in usable]
    clear = [
        each
        for each in passages
        if not any(
            other is not each and next(too_near(arena, each, other), None) for other in (*arena.passages, *passages)
        )
    ]
    length = {passage: each.length for passage, each in zip(passages, usable, strict=True)}
    longest = sorted(clear, key=lambda each: -length[each])[: PASSAGES_MAX - len(arena.passages)]
    return tuple(each for each in clear if each in longest)


def belongs(found: NarrowPassage, entrances: Sequence[Point], size: float) -> bool:
    """Return whether a narrow section that was found is that of a named passage: at an entrance, or between two.

    `size`: that of the robots (`rmr.base.motion_scale`).
    """
    reach_m = GATE_REACH_M * size + found.width / 2.0
    if any(found.away(entrance) <= reach_m for entrance in entrances):
        return True
    middle = found.line[len(found.line) // 2]
    return any(point_segment_distance(*middle, *a, *b) <= reach_m for a, b in pairwise(entrances))


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
