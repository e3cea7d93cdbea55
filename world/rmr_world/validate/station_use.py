"""Stations and program: robots drive into each station, and can leave it again."""

from collections.abc import Iterator, Sequence
from itertools import combinations, islice, pairwise

from rmr.analysis.area_uses import area_uses
from rmr.base.arena import Area
from rmr.base.geometry import Point, point_segment_distance
from rmr.base.values import Symbol
from rmr.bytecode.program import Program
from rmr.node.driver import spots
from rmr.node.motion.astar import plan
from rmr_world.finding import FilePath, Finding
from rmr_world.lab import Lab

PLANS_MAX = 200
"""Ways out of stations that are planned; a plan takes about a millisecond."""


def stations_used(lab: Lab, program: Program) -> Iterator[Finding]:
    """Each station is an area that the program or a fact of the lab names, for drives to lead there."""
    named = {use.area for use in area_uses(program)}
    named |= {str(arg) for fact in lab.stated_facts for arg in fact.args if isinstance(arg, Symbol)}
    for name, _ in lab.arena.stations:
        if name not in named:
            message = f"nothing drives to station '{name}': neither the program nor a fact of the lab names it"
            yield lab.error(_path(lab, name), message)


def stations_left(lab: Lab, program: Program) -> Iterator[Finding]:
    """A robot on a place of a station has a way out while robots stand on as many others as may be there."""
    del program
    plans = 0
    for name, capacity in lab.arena.stations:
        area = lab.arena.area(name)
        assert area is not None
        places = spots(lab.arena, area)
        out = _points_outside(lab, area)
        for index, place in enumerate(places):
            if out is None or plan(lab.arena, place, out) is None:
                continue  # no way at all is told of as unreachable
            others = [other for other in places if other != place]
            for parked in islice(combinations(others, min(capacity - 1, len(others))), PLANS_MAX):
                plans += 1
                if plans > PLANS_MAX or plan(lab.arena, place, out, parked) is not None:
                    continue
                message = (
                    f"a robot on place {index} of station '{name}' has no way out while robots stand on the others: "
                    "leave room, or give the station a smaller capacity"
                )
                yield lab.error(("areas", name), message)
                break


def stations_off_passages(lab: Lab, program: Program) -> Iterator[Finding]:
    """No place of a station lies in a passage that the file names: a robot that stays there would close it."""
    del program
    arena = lab.arena
    for passage in [each for each in arena.passages if each.two_ended and not each.found] if arena.stations else ():
        way = plan(arena, passage.mouth(0), passage.mouth(1))
        for name, _ in arena.stations if way is not None else ():
            area = arena.area(name)
            assert way is not None
            assert area is not None
            if any(_off(place, way.points) < 2.0 * arena.shape.radius for place in spots(arena, area)):
                message = f"lies in passage '{passage.name}': a robot that stays there would close it"
                yield lab.error(_path(lab, name), message)


FIT = (stations_used,)
"""The rules of stations and program."""
REACHABILITY = (stations_left, stations_off_passages)
"""The rules of the ways out and past."""


def _path(lab: Lab, name: str) -> FilePath:
    path: FilePath = ("stations", name)
    return path if path in lab.places else ("stations",)


def _off(place: Point, way: Sequence[Point]) -> float:
    """Return how far `place` is from `way`, metres."""
    return min(point_segment_distance(*place, *a, *b) for a, b in pairwise(way))


def _points_outside(lab: Lab, area: Area) -> Point | None:
    """Return where a robot goes that leaves `area`: the place of another area, else where a robot starts."""
    areas = (other.places[0] for other in lab.arena.areas if other != area)
    starts = (Point(robot.pose.x, robot.pose.y) for robot in lab.robots)
    return next(iter((*areas, *starts)), None)
