"""The passages that a lab does not name: the narrow sections of its floor in which robots take turns by themselves."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, pairwise
from typing import NamedTuple

from rmr.base.arena import Arena, FloorPassage, found_passage
from rmr.base.direction import ENDS_MAX
from rmr.base.geometry import Point, distance, point_segment_distance
from rmr.base.motion_scale import scale_of
from rmr.node.motion.route import GATE_REACH_M, ROOM_M, way_through_m
from rmr_world.narrow_places import NarrowPassage, narrow_places
from rmr_world.units import PASSAGES_MAX


def found_passages(arena: Arena, stays: Iterable[Point]) -> tuple[FloorPassage, ...]:
    """Return the narrow sections of the floor of `arena` at which robots can take turns; of too many the longest.

    Where several meet they are one, as far as directions tell its ends apart.

    Left out are those of the passages that `arena` has already; those in which a robot `stays`, at its start or its
    goal, since it would hold the passage; those which no way of the planner leads through; and those with too little
    room for the robots that wait before them.
    """
    places = tuple(stays)
    size = scale_of(arena.shape).size
    narrow = narrow_places(arena)
    meeting = [each for each in narrow.junctions if 2 < len(each.ends) <= ENDS_MAX]
    arms = {arm for each in meeting for arm in each.arms}
    sections = [
        *((each.name, each.ends, (each,)) for each in narrow.passages if each not in arms),
        *((each.name, each.ends, each.arms) for each in meeting),
    ]
    # A way from end to end that is longer than the centre lines times this leads elsewhere.
    usable = [
        (name, ends, parts)
        for name, ends, parts in sections
        if not any(belongs(part, named.mouths, size) for part in parts for named in arena.passages)
        and all(
            0.0 < way_through_m(arena, *pair) <= 1.2 * sum(part.length for part in parts)
            for pair in combinations(ends, 2)
        )
        and not any(part.holds(place) for part in parts for place in places)
    ]
    names = {each.name for each in arena.passages}
    passages = [found_passage(f"{name}_found" if name in names else name, ends) for name, ends, _ in usable]
    clear = [
        each
        for each in passages
        if not any(
            other is not each and next(too_near(arena, each, other), None) for other in (*arena.passages, *passages)
        )
    ]
    length = {
        passage: sum(part.length for part in parts) for passage, (_, _, parts) in zip(passages, usable, strict=True)
    }
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
    """Yield the ends of two passages, by their numbers, at which robots that wait stand in each other's way."""
    # What a robot that waits leaves free for one that comes out (`rmr.node.motion.route`), and its own hull.
    wait_m = 4.0 * arena.shape.radius + ROOM_M
    for end, mouth in enumerate(one.mouths):
        for its_end, its_mouth in enumerate(other.mouths):
            faces = _faces(one, mouth, its_mouth) and _faces(other, its_mouth, mouth)
            near = NearEnds(distance(*mouth, *its_mouth), 2.0 * wait_m if faces else wait_m, faces)
            if near.gap_m < near.apart_m:
                yield end, its_end, near


def _faces(passage: FloorPassage, mouth: Point, point: Point) -> bool:
    """Return whether `point` lies straight before `mouth`, within 60 degrees, as one comes out from another end."""
    return any(
        (point.x - mouth.x) * (mouth.x - end.x) + (point.y - mouth.y) * (mouth.y - end.y)
        > 0.5 * distance(*point, *mouth) * distance(*mouth, *end)
        for end in passage.mouths
        if end != mouth
    )
