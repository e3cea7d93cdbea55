"""Phase 3, reachability: robots have a way to where they are to go.

A way is one that the robots' own planner finds, with its margins; a place without one is an error, for such a run could
never finish. To keep many robots and places cheap, the cells of the floor are first grouped into connected regions: two
points whose cells of the planner are in one region have a way, and the planner is asked about the others only.

Checked are the destinations of all robots (`bound.destinations`), each place of them, and the areas and queues that the
program names: of the latter each must have a way from at least one robot.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, islice, pairwise

from rmr.analysis.area_uses import area_uses
from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point, point_segment_distance
from rmr.base.values import Symbol
from rmr.bytecode.program import Program
from rmr.node.driver import spots
from rmr.node.motion.astar import plan
from rmr.node.motion.grid import TIGHT_MARGIN_M, cell_for, grid_of, regions
from rmr_world.bound import approachable, destinations
from rmr_world.finding import FilePath, Finding
from rmr_world.lab import Lab
from rmr_world.passage_use import first_goal
from rmr_world.schema import CELLS_MAX
from rmr_world.validate.first_instant import ROBOTS_MAX

PLANS_MAX = 200
"""Calls of the planner, about a millisecond each, for places and for the ways out of stations; beyond them a way is
assumed. A lab with so many places without a way has enough errors."""
FINER = (2, 4)
"""Parts of a cell with which a way is looked for that the cells of the lab file are too large for."""


def unreachable_places(lab: Lab, program: Program) -> Iterator[Finding]:
    """Yield an error for each place that robots must reach and cannot."""
    ways = Ways(lab)
    yield from _unreachable_destinations(lab, ways)
    yield from _unreachable_used_areas(lab, program, ways)
    yield from _unreachable_first_drives(lab, program, ways)


class Ways:
    """The ways of one lab: whether a robot can get from one point to another."""

    def __init__(self, lab: Lab) -> None:
        self._arena = lab.arena
        self._region = regions(lab.arena, doors=True)
        least = lab.arena.shape.radius + TIGHT_MARGIN_M
        self._too_near = [clear < least for clear in grid_of(lab.arena).clear]
        """By cell: whether it is blocked at the ends of a way, too."""
        self._plans = 0
        self.starts = [(robot.id, Point(robot.pose.x, robot.pose.y)) for robot in lab.robots]

    def between(self, start: Point, goal: Point) -> bool:
        """Return whether a robot finds a way from `start` to `goal`; True without a look beyond PLANS_MAX plans."""
        region = self._region_of(start)
        if region and region == self._region_of(goal):
            return True
        self._plans += 1
        return self._plans > PLANS_MAX or plan(self._arena, start, goal) is not None

    def into(self, start: Point, places: Sequence[Point]) -> bool:
        """Return whether a robot finds a way from `start` to one of `places`."""
        return any(self.between(start, place) for place in places)

    def _region_of(self, point: Point) -> int:
        """Return the region of the cell from which the planner begins at `point`; 0 if that is in none."""
        cell = cell_for(grid_of(self._arena), self._too_near, point)
        return 0 if cell is None else self._region[cell]


def _unreachable_destinations(lab: Lab, ways: Ways) -> Iterator[Finding]:
    """Yield an error for each area, or slot of it, that is a destination and cannot be reached."""
    goals = destinations(lab)
    starts = dict(ways.starts)
    for area in dict.fromkeys(goals.values()):
        robots = [robot for robot, goal in goals.items() if goal == area]
        places = _places(lab.arena, area)
        cut_off = [robot for robot in robots if not ways.into(starts[robot], places)]
        if cut_off:
            yield _cut_off(lab, area, cut_off, _cell_with_way(lab.arena, starts[cut_off[0]], places))
        elif area.slotted:
            for index, place in enumerate(area.places):
                if not any(ways.between(starts[robot], place) for robot in robots):
                    message = f"no robot finds a way to place {index} of area '{area.name}'"
                    yield lab.error(_place_path(lab, area, index), message)


def _cut_off(lab: Lab, area: Area, robots: Sequence[int], cell: float | None) -> Finding:
    named = ", ".join(map(str, robots[:10])) + (", ..." if len(robots) > 10 else "")
    who = f"robot {named} finds" if len(robots) == 1 else f"robots {named} find"
    message = f"{who} no way to area '{area.name}'; a robot of radius {lab.arena.shape.radius:g} m must fit through"
    if cell is not None:
        message += f": it does, but not on a grid of {lab.arena.cell:g} m; set arena.cell to {cell:g} or less"
    return lab.error(("areas", area.name), message)


def _cell_with_way(arena: Arena, start: Point, places: Sequence[Point]) -> float | None:
    """Return the edge of smaller cells, metres, on which there is a way from `start` to one of `places`; or None."""
    for parts in FINER:
        cell = arena.cell / parts
        if arena.width / cell * arena.height / cell > CELLS_MAX:
            return None
        finer = replace(arena, cell=cell)
        if any(plan(finer, start, place) is not None for place in places[:4]):
            return cell
    return None


def _unreachable_used_areas(lab: Lab, program: Program, ways: Ways) -> Iterator[Finding]:
    """Yield an error for each area and queue place that the program uses and no robot can reach."""
    checked = {area.name for area in destinations(lab).values()}
    queues: dict[str, bool] = {}
    for use in area_uses(program):
        queues[use.area] = queues.get(use.area, False) or use.needs_queue
    for name, queue in queues.items():
        area = lab.arena.area(name)
        if area is None:
            continue
        starts = [start for _, start in ways.starts]
        if name not in checked and not any(ways.into(start, _places(lab.arena, area)) for start in starts):
            yield lab.error(("areas", name), f"no robot finds a way to area '{name}', which the program uses")
        for index, place in enumerate(area.queue if queue else ()):
            if not any(ways.between(start, place) for start in starts):
                message = f"no robot finds a way to place {index} of the queue of area '{name}'"
                yield lab.error(("areas", name, "queue"), message)


def _unreachable_first_drives(lab: Lab, program: Program, ways: Ways) -> Iterator[Finding]:
    """Yield a warning for each area to which the first drive of a robot leads and has no way: it will fail."""
    checked = {area.name for area in destinations(lab).values()} | {use.area for use in area_uses(program)}
    cut_off: dict[Area, list[int]] = {}
    for robot, start in ways.starts[:ROBOTS_MAX]:
        area = first_goal(lab, program, robot)
        if area is not None and area.name not in checked and not ways.into(start, _places(lab.arena, area)):
            cut_off.setdefault(area, []).append(robot)
    for area, robots in cut_off.items():
        found = _cut_off(lab, area, robots, None)
        yield replace(found, message=f"{found.message}; the first drive there fails", is_warning=True)


def _places(arena: Arena, area: Area) -> list[Point]:
    """Return the points of `area` at which a robot can stand."""
    least = arena.shape.radius + TIGHT_MARGIN_M
    return [place for place in approachable(area) if arena.clearance(*place) >= least]


def _place_path(lab: Lab, area: Area, index: int) -> FilePath:
    """Return the path of a place in the file: its own if the area lists slots, else the area's."""
    path: FilePath = ("areas", area.name, "slots", index)
    return path if path in lab.places else ("areas", area.name)


# ---- stations: robots drive into each, and can leave it again


def stations_used(lab: Lab, program: Program) -> Iterator[Finding]:
    """Each station is an area that the program or a fact of the lab names, for drives to lead there."""
    named = {use.area for use in area_uses(program)}
    named |= {str(arg) for fact in lab.stated_facts for arg in fact.args if isinstance(arg, Symbol)}
    for name, _ in lab.arena.stations:
        if name not in named:
            message = f"nothing drives to station '{name}': neither the program nor a fact of the lab names it"
            yield lab.error(_station_path(lab, name), message)


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
    for passage in [each for each in arena.passages if not each.found] if arena.stations else ():
        ways = [plan(arena, *ends) for ends in combinations(passage.mouths, 2)]
        lines = [way.points for way in ways if way is not None]
        for name, _ in arena.stations:
            area = arena.area(name)
            assert area is not None
            near_m = 2.0 * arena.shape.radius
            if any(_off(place, line) < near_m for line in lines for place in spots(arena, area)):
                message = f"lies in passage '{passage.name}': a robot that stays there would close it"
                yield lab.error(_station_path(lab, name), message)


CHECKS = (unreachable_places, stations_left, stations_off_passages)
"""The rules of reachability; `stations_used` is one of fit."""


def _station_path(lab: Lab, name: str) -> FilePath:
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
