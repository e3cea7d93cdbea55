"""Stations and program: robots drive into each station, and can leave it again."""

from collections.abc import Iterator
from itertools import combinations, islice

from rmr.analysis.area_uses import area_uses
from rmr.base.arena import Area
from rmr.base.geometry import Point
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


FIT = (stations_used,)
"""The rules of stations and program."""
REACHABILITY = (stations_left,)
"""The rules of the ways out."""


def _path(lab: Lab, name: str) -> FilePath:
    path: FilePath = ("stations", name)
    return path if path in lab.places else ("stations",)


def _points_outside(lab: Lab, area: Area) -> Point | None:
    """Return where a robot goes that leaves `area`: the place of another area, else where a robot starts."""
    areas = (other.places[0] for other in lab.arena.areas if other != area)
    starts = (Point(robot.pose.x, robot.pose.y) for robot in lab.robots)
    return next(iter((*areas, *starts)), None)
