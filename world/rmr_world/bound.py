"""The physical bound of a run: a lower bound of its time, from geometry and top speed alone.

No schedule is faster. The bound is the larger of two figures:

- the longest free-flow trip, with the slots of a destination assigned to its robots so that the longest trip is as
  short as possible (bottleneck assignment problem);
- if the lab names one passage: shortest approach + (n - 1) x 2 radius / speed + shortest departure, for robots pass
  an entrance one behind the other without overlap. If robots come from both sides, the passage from entrance to
  entrance is added for each change of direction, of which there is at least one.

A trip is the shortest obstacle-free path at full speed, without time for turning (`free_flow`). The destination of a
robot is the area that `finish` names or, if that names none, the one area that the robot's facts name.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import groupby

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.record import record
from rmr.base.values import Symbol
from rmr.bytecode.program import Constant
from rmr_world.free_flow import FreeFlow, free_flow
from rmr_world.lab import Lab, RobotStart
from rmr_world.quorum import LIVING

BOX_SIDE_PLACES = 8
"""Sample points along each side of a box, which a robot reaches at its edge."""


@record
class Stream:
    """The free-flow times, in seconds, of the robots with one destination and one entrance."""

    robots: tuple[int, ...]
    shared: bool
    """Whether all of them may be at one place of the destination, which has no slots."""
    trips: tuple[tuple[float, ...], ...]
    """Time of each robot to each place of the destination; empty without a destination."""
    mouth: int
    """Number of the entrance by which they enter the bottleneck, from 0; -1 if they do not pass it."""
    approaches: tuple[float, ...]
    """Time of each robot to its entrance; empty without an entrance."""
    departures: tuple[float, ...]
    """Time from the entrance to each place of the destination; empty without either."""


@record
class EntranceGroup:
    """The robots that enter the bottleneck by one entrance: a job family in the terms of scheduling."""

    count: int
    approach: float
    """Shortest time to the entrance, seconds."""
    departure: float
    """Shortest time from the entrance to a destination, seconds."""


@record
class FreeTimes:
    """The free-flow times of a lab in seconds."""

    streams: tuple[Stream, ...]
    spacing: float
    """Least time between two robots at one point: 2 radius / speed."""
    turnaround: float
    """Least time between two entries by different entrances: the passage from one to the other, and the spacing."""

    @property
    def entrances(self) -> dict[int, EntranceGroup]:
        """Robots by entrance, for the entrances that are used."""
        found = {}
        for mouth in (0, 1):
            streams = [stream for stream in self.streams if stream.mouth == mouth]
            if streams:
                approach = min(min(stream.approaches) for stream in streams)
                departure = min(min(stream.departures, default=0.0) for stream in streams)
                found[mouth] = EntranceGroup(sum(len(stream.robots) for stream in streams), approach, departure)
        return found


def destinations(lab: Lab) -> dict[int, Area]:
    """Return the destination of each robot that has one by the lab file."""
    pattern = lab.finish_pattern
    named = [part.value for part in (pattern.patterns if pattern else ()) if isinstance(part, Constant)]
    common = _areas(lab, named)
    if common:
        return dict.fromkeys(lab.roster, common[0])
    found = {}
    for robot in lab.roster if pattern else ():
        own = _areas(lab, [arg for fact in lab.initial_facts if fact.owner in (None, robot) for arg in fact.args])
        if len(own) == 1:
            found[robot] = own[0]
    return found


def _areas(lab: Lab, values: Sequence[object]) -> list[Area]:
    """Return the areas among `values`, none twice."""
    names = dict.fromkeys(str(value) for value in values if isinstance(value, Symbol))
    return [area for name in names if (area := lab.arena.area(name)) is not None]


@lru_cache(maxsize=4)
def free_times(lab: Lab) -> FreeTimes:
    """Return the free-flow times of `lab`; infinite where there is no way."""
    arena = lab.arena
    flow = free_flow(lab.arena)
    goals = destinations(lab)
    speed = arena.shape.speed
    # Robots need not all pass the same one of several passages, nor one that was found: trips alone are the bound.
    narrow = arena.passages[0] if len(arena.passages) == 1 and not arena.passages[0].found else None
    necks = [approachable(area) for area in narrow.entrances] if narrow is not None else []
    across = min(flow.lengths(necks[0][0], necks[1])) if len(necks) == 2 else 0.0
    kinds = [(goals.get(start.id), start) for start in lab.robots]
    order = {area: index for index, area in enumerate(dict.fromkeys(area for area, _ in kinds))}
    streams: list[Stream] = []
    for area, members in groupby(sorted(kinds, key=lambda kind: order[kind[0]]), key=lambda kind: kind[0]):
        streams += _streams(flow, speed, area, [start for _, start in members], necks, across)
    spacing = 2.0 * arena.shape.radius / speed
    return FreeTimes(tuple(streams), spacing, spacing + across / speed)


def _streams(
    flow: FreeFlow, speed: float, goal: Area | None, starts: list[RobotStart], necks: list[list[Point]], across: float
) -> list[Stream]:
    """Return the robots that go to `goal`, by entrance; `across` is the length of the passage between the entrances."""
    places = approachable(goal) if goal else []
    beyond = [[min(column) for column in zip(*(flow.lengths(p, places) for p in neck), strict=True)] for neck in necks]
    rows: dict[int, list[tuple[int, list[float], float]]] = {}
    for start in starts:
        here = Point(start.pose.x, start.pose.y)
        trip = flow.lengths(here, places)
        into = [min(flow.lengths(here, neck)) for neck in necks]
        mouth = _mouth(trip, into, beyond, across)
        rows.setdefault(mouth, []).append((start.id, trip, into[mouth] if mouth >= 0 else 0.0))
    return [
        Stream(
            robots=tuple(robot for robot, _, _ in members),
            shared=goal is not None and not goal.slotted,
            trips=tuple(tuple(length / speed for length in trip) for _, trip, _ in members) if goal else (),
            mouth=mouth,
            approaches=tuple(into / speed for _, _, into in members) if mouth >= 0 else (),
            departures=tuple(length / speed for length in beyond[mouth]) if mouth >= 0 else (),
        )
        for mouth, members in sorted(rows.items())
    ]


def _mouth(trip: list[float], into: list[float], beyond: list[list[float]], across: float) -> int:
    """Return the entrance on a robot's path; -1 if the shortest path avoids the bottleneck.

    `into`: to each entrance, `beyond`: from each entrance to each place; all are lengths in metres.
    """
    if len(into) < 2:
        return 0 if into else -1
    if not trip:
        return -1
    paths_m = [into[mouth] + across + min(beyond[1 - mouth]) for mouth in (0, 1)]
    mouth = paths_m.index(min(paths_m))
    # Tolerance for a path through both entrances: their exact points make it longer than the true path by at most this.
    return mouth if paths_m[mouth] <= min(trip) + 0.3 else -1


def bound_s(lab: Lab, dead: Collection[int] = ()) -> float:
    """Return the physical bound of `lab` in seconds; infinite when a robot has no way to its destination.

    With the quorum `living` it is that of the robots that are not `dead`, with a number that of the best so many.
    """
    if isinstance(lab.quorum, int) and lab.quorum < len(lab.robots):
        return _bound_of_some(free_times(lab), lab.quorum)
    if lab.quorum == LIVING and dead:
        lab = replace(lab, robots=tuple(start for start in lab.robots if start.id not in dead))
    times = free_times(lab)
    trip = max((_longest_trip(stream.trips, shared=stream.shared) for stream in times.streams), default=0.0)
    return max(trip, _passing(times.entrances, times))


def _bound_of_some(times: FreeTimes, count: int) -> float:
    """Return the bound of the `count` robots that can be fastest: the longest of their own shortest trips, seconds.

    As few of them as possible pass the bottleneck, which the others need not do.
    """
    rows = [row for stream in times.streams for row in stream.trips or [()] * len(stream.robots)]
    trips = sorted(min(row, default=0.0) for row in rows)
    beside = sum(len(stream.robots) for stream in times.streams if stream.mouth < 0)
    entrances = times.entrances
    passing = max(0, count - beside)
    west = entrances[0].count if 0 in entrances else 0
    east = entrances[1].count if 1 in entrances else 0
    splits = [(k, passing - k) for k in range(passing + 1) if k <= west and passing - k <= east]
    bounds = [
        _passing({mouth: replace(entrances[mouth], count=k) for mouth, k in enumerate(split) if k}, times)
        for split in splits
    ]
    return max(trips[count - 1], min(bounds, default=0.0))


def _passing(entrances: Mapping[int, EntranceGroup], times: FreeTimes) -> float:
    """Return the least time until these robots have passed the bottleneck and reached their destinations, seconds."""
    total = sum(group.count for group in entrances.values())
    lengths = []
    # With the first and the last robot's entrance fixed, as few changes of direction as possible are best.
    for first in entrances:
        for last in entrances:
            changes = 1 if first != last else 2 if len(entrances) == 2 else 0
            if changes == 2 and entrances[first].count == 1:
                continue  # it cannot be both the first and the last
            gaps = (total - 1 - changes) * times.spacing + changes * times.turnaround
            lengths.append(entrances[first].approach + gaps + entrances[last].departure)
    return min(lengths, default=0.0)


def approachable(area: Area) -> list[Point]:
    """Return the points at which an area can be reached: its places, and for a box also points along its edge."""
    if area.box is None:
        return list(area.places)
    x0, y0, x1, y1 = area.box
    steps = [k / BOX_SIDE_PLACES for k in range(BOX_SIDE_PLACES + 1)]
    across = [Point(x0 + (x1 - x0) * s, y) for s in steps for y in (y0, y1)]
    return [*area.places, *across, *(Point(x, y0 + (y1 - y0) * s) for s in steps for x in (x0, x1))]


def _longest_trip(trips: Sequence[Sequence[float]], *, shared: bool) -> float:
    """Return the longest trip under the best assignment, seconds; with `shared` places each robot takes its nearest.

    Binary search over the times that occur, for the least one within which a complete assignment exists.
    """
    if not trips:
        return 0.0
    if shared or len(trips[0]) < len(trips):
        return max(map(min, trips))
    candidates = sorted(dict.fromkeys(time for row in trips for time in row if time < math.inf))
    low = 0
    high = len(candidates)
    while low < high:
        middle = (low + high) // 2
        if _assignable(trips, candidates[middle]):
            high = middle
        else:
            low = middle + 1
    return candidates[low] if low < len(candidates) else math.inf


def _assignable(trips: Sequence[Sequence[float]], limit: float) -> bool:
    """Return whether each robot can have a slot of its own within `limit` seconds (matching by augmenting paths)."""
    taken: dict[int, int] = {}
    return all(_place(robot, trips, limit, taken) for robot in range(len(trips)))


def _place(robot: int, trips: Sequence[Sequence[float]], limit: float, taken: dict[int, int]) -> bool:
    """Give `robot` a slot, reassigning other robots where needed; breadth-first search for an augmenting path."""
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
    """Reassign the slots along the augmenting path that ends at the free `slot`."""
    owner = {who: held for held, who in taken.items()}
    while True:
        who = came[slot]
        taken[slot] = who
        if who == robot:
            return
        slot = owner[who]
