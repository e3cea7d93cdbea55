"""Whether robots can get where they are to go, said before a run that could never finish.

The judge is the robots' own planner, with its own margins: what it finds no way to, no robot reaches. So that many
robots and places cost little, the floor's cells are first parted into regions that hang together; a robot and a place
that touch one region have a way, and only of the others the planner is asked.

Judged are the destinations of all robots (`bound.destinations`), every place of them, and the areas and queues that
the program names: these must have a way from one robot at least.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point
from rmr.bytecode.program import Program
from rmr.node.motion.astar import DOOR_MARGIN_M, plan
from rmr.node.motion.grid import RELAXED_M, TIGHT_MARGIN_M, grid_of
from rmr_world.bound import approachable, destinations
from rmr_world.document import Path_, Problem
from rmr_world.lab import Lab
from rmr_world.validate.program_fit import areas_used, problem_at

ASKED_MAX = 200
"""Questions to the planner; a lab of which so many have no answer is wrong enough to be told of."""


def unreachable(lab: Lab, program: Program) -> list[Problem]:
    """Return a problem for each place that robots must reach and cannot."""
    ways = _Ways(lab)
    return [*_destinations(lab, ways), *_used(lab, program, ways)]


class _Ways:
    """Answers whether there is a way between two points."""

    def __init__(self, lab: Lab) -> None:
        self._arena = lab.arena
        self._region = _regions(lab.arena)
        self._asked = 0
        self.starts = [(robot.id, Point(robot.pose.x, robot.pose.y)) for robot in lab.robots]

    def between(self, start: Point, goal: Point) -> bool:
        """Return whether a robot finds a way from `start` to `goal`; of too many questions the rest is answered yes."""
        if self._touches(start) & self._touches(goal):
            return True
        self._asked += 1
        return self._asked > ASKED_MAX or plan(self._arena, start, goal) is not None

    def into(self, start: Point, places: Sequence[Point]) -> bool:
        """Return whether a robot finds a way from `start` to one of `places`."""
        return any(self.between(start, place) for place in places)

    def _touches(self, point: Point) -> set[int]:
        """Return the regions of the cells near `point`, where the planner's margin shrinks."""
        grid = grid_of(self._arena)
        return {self._region[index] for index in grid.near(*point, RELAXED_M)} - {0}


@lru_cache(maxsize=4)
def _regions(arena: Arena) -> list[int]:
    """Return for each cell the region that it belongs to, from 1; 0 where a robot's centre cannot be on its way."""
    grid = grid_of(arena)
    least = arena.shape.radius + DOOR_MARGIN_M
    region = [0] * len(grid.clear)
    steps = (1, -1, grid.stride, -grid.stride)
    count = 0
    for first, clear in enumerate(grid.clear):
        if clear < least or region[first]:
            continue
        count += 1
        region[first] = count
        edge = [first]
        while edge:
            cell = edge.pop()
            for step in steps:
                other = cell + step
                if not region[other] and grid.clear[other] >= least:
                    region[other] = count
                    edge.append(other)
    return region


def _destinations(lab: Lab, ways: _Ways) -> Iterator[Problem]:
    """Yield what is wrong with where robots are to be in the end."""
    bound_for = destinations(lab)
    starts = dict(ways.starts)
    for area in dict.fromkeys(bound_for.values()):
        robots = [robot for robot, goal in bound_for.items() if goal == area]
        places = _places(lab.arena, area)
        cut_off = [robot for robot in robots if not ways.into(starts[robot], places)]
        if cut_off:
            yield _cut_off(lab, area, cut_off)
        elif area.slotted:
            for index, place in enumerate(area.places):
                if not any(ways.between(starts[robot], place) for robot in robots):
                    message = f"no robot finds a way to place {index} of area '{area.name}'"
                    yield problem_at(lab, _place_path(lab, area, index), message)


def _cut_off(lab: Lab, area: Area, robots: Sequence[int]) -> Problem:
    named = ", ".join(map(str, robots[:10])) + (", ..." if len(robots) > 10 else "")
    who = f"robot {named} finds" if len(robots) == 1 else f"robots {named} find"
    message = f"{who} no way to area '{area.name}'; a robot of radius {lab.arena.shape.radius:g} m must fit through"
    return problem_at(lab, ("areas", area.name), message)


def _used(lab: Lab, program: Program, ways: _Ways) -> Iterator[Problem]:
    """Yield the areas and queues of the program that no robot can reach."""
    judged = {area.name for area in destinations(lab).values()}
    queues: dict[str, bool] = {}
    for name, queue in areas_used(program):
        queues[name] = queues.get(name, False) or queue
    for name, queue in queues.items():
        area = lab.arena.area(name)
        if area is None:
            continue
        starts = [start for _, start in ways.starts]
        if name not in judged and not any(ways.into(start, _places(lab.arena, area)) for start in starts):
            yield problem_at(lab, ("areas", name), f"no robot finds a way to area '{name}', which the program uses")
        for index, place in enumerate(area.queue if queue else ()):
            if not any(ways.between(start, place) for start in starts):
                message = f"no robot finds a way to place {index} of the queue of area '{name}'"
                yield problem_at(lab, ("areas", name, "queue"), message)


def _places(arena: Arena, area: Area) -> list[Point]:
    """Return the points of `area` at which a robot can stand."""
    least = arena.shape.radius + TIGHT_MARGIN_M
    return [place for place in approachable(area) if arena.clearance(*place) >= least]


def _place_path(lab: Lab, area: Area, index: int) -> Path_:
    """Return where the place stands in the file: in a list of slots by itself."""
    path: Path_ = ("areas", area.name, "slots", index)
    return path if path in lab.places else ("areas", area.name)
