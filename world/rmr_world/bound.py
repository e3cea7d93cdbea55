"""The physical bound of a run: how fast the robots could be if everything but geometry and speed were free.

No schedule beats it. It is the larger of two figures:

- the longest free-flow trip, where the robots share the destination's slots out among themselves so that the
  longest trip is as short as it can be (a bottleneck assignment);
- where the lab names a bottleneck, shortest approach to it + (n - 1) x 2 radius / speed + shortest departure
  from it: robots pass its middle one behind the other, and bodies do not overlap.

A trip is the shortest obstacle-free way at full speed, without turning (`freeflow`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.values import Symbol
from rmr.bytecode.program import Constant
from rmr_world.freeflow import FreeFlow
from rmr_world.lab import Lab

BOX_SIDE_PLACES = 8
"""A box is reached at its edge; so many places stand for each side."""


@dataclass(frozen=True, slots=True)
class FreeTimes:
    """The free-flow times of a lab in seconds."""

    trips: tuple[tuple[float, ...], ...]
    """For each robot, in the lab's order, the time to each place of the destination; empty without one."""
    approaches: tuple[float, ...]
    """For each robot the time to the bottleneck; empty without one."""
    departures: tuple[float, ...]
    """From the bottleneck to each place of the destination; empty without either."""
    spacing: float
    """Between two robots that pass the same point one behind the other: 2 radius / speed."""


def destination(lab: Lab) -> Area | None:
    """Return the area that `finish` names, or None."""
    pattern = lab.finish_pattern
    for part in pattern.patterns if pattern else ():
        if isinstance(part, Constant) and isinstance(part.value, Symbol):
            return lab.arena.area(str(part.value))
    return None


@lru_cache(maxsize=4)
def free_times(lab: Lab) -> FreeTimes:
    """Return the free-flow times of `lab`; infinite where there is no way."""
    arena = lab.arena
    speed, flow = arena.shape.speed, FreeFlow(arena)
    goal = destination(lab)
    places = _places(goal) if goal else []
    neck = arena.area(arena.bottleneck) if arena.bottleneck else None
    neck_places = _places(neck) if neck else []
    trips, approaches = [], []
    for robot in lab.robots:
        lengths = flow.lengths(Point(robot.pose.x, robot.pose.y), [*places, *neck_places])
        trips.append(tuple(length / speed for length in lengths[: len(places)]))
        approaches.append(min(lengths[len(places) :], default=0.0) / speed)
    from_neck = [flow.lengths(place, places) for place in neck_places]
    departures = tuple(min(column) / speed for column in zip(*from_neck, strict=True))
    return FreeTimes(
        tuple(trips) if goal else (),
        tuple(approaches) if neck else (),
        departures,
        2.0 * arena.shape.radius / speed,
    )


def bound_s(lab: Lab) -> float:
    """Return the physical bound of `lab` in seconds; infinite when a robot has no way to its destination."""
    goal = destination(lab)
    times = free_times(lab)
    trip = _longest_trip(times.trips, shared=goal is not None and not goal.slotted)
    if not times.approaches:
        return trip
    passing = (len(times.approaches) - 1) * times.spacing
    return max(trip, min(times.approaches) + passing + min(times.departures, default=0.0))


def _places(area: Area) -> list[Point]:
    """Return the points by which an area can be reached: its places, for a box also points along its edge."""
    if area.box is None:
        return list(area.places)
    x0, y0, x1, y1 = area.box
    steps = [k / BOX_SIDE_PLACES for k in range(BOX_SIDE_PLACES + 1)]
    across = [Point(x0 + (x1 - x0) * s, y) for s in steps for y in (y0, y1)]
    return [*area.places, *across, *(Point(x, y0 + (y1 - y0) * s) for s in steps for x in (x0, x1))]


def _longest_trip(trips: Sequence[Sequence[float]], *, shared: bool) -> float:
    """Return the longest trip under the best assignment; with `shared` places all robots take their nearest."""
    if not trips:
        return 0.0
    if shared or len(trips[0]) < len(trips):
        return max(map(min, trips))
    candidates = sorted(dict.fromkeys(time for row in trips for time in row if time < math.inf))
    low, high = 0, len(candidates)
    while low < high:
        middle = (low + high) // 2
        if _assignable(trips, candidates[middle]):
            high = middle
        else:
            low = middle + 1
    return candidates[low] if low < len(candidates) else math.inf


def _assignable(trips: Sequence[Sequence[float]], limit: float) -> bool:
    """Return whether every robot can have a slot of its own within `limit` seconds (augmenting paths)."""
    taken: dict[int, int] = {}
    return all(_place(robot, trips, limit, taken) for robot in range(len(trips)))


def _place(robot: int, trips: Sequence[Sequence[float]], limit: float, taken: dict[int, int]) -> bool:
    """Give `robot` a slot, moving others to further ones where needed; breadth first, so without recursion."""
    came: dict[int, int] = {}
    frontier = [robot]
    while frontier:
        following = []
        for who in frontier:
            for slot, time in enumerate(trips[who]):
                if time > limit or slot in came:
                    continue
                came[slot] = who
                if slot in taken:
                    following.append(taken[slot])
                    continue
                _shift(slot, robot, came, taken)
                return True
        frontier = following
    return False


def _shift(slot: int, robot: int, came: dict[int, int], taken: dict[int, int]) -> None:
    """Hand slots on along the path that ends at the free `slot`."""
    owner = {who: held for held, who in taken.items()}
    while True:
        who = came[slot]
        taken[slot] = who
        if who == robot:
            return
        slot = owner[who]
