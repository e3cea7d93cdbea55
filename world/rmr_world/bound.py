"""The physical bound of a run: how fast the robots could be if everything but geometry and speed were free.

No schedule beats it. It is the larger of two figures:

- the longest free-flow trip, where the robots of one destination share its slots out among themselves so that the
  longest trip is as short as it can be (a bottleneck assignment);
- where the lab names a bottleneck, shortest approach to it + (n - 1) x 2 radius / speed + shortest departure
  from it: robots pass its mouth one behind the other, and bodies do not overlap. Where they come from both sides,
  the way from mouth to mouth is added for each change of direction, of which there is one at least.

A trip is the shortest obstacle-free way at full speed, without turning (`freeflow`). A robot's destination is the
area that `finish` names or, where that names none, the one that the robot's facts name.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.values import Symbol
from rmr.bytecode.program import Constant
from rmr_world.free_flow import FreeFlow
from rmr_world.lab import Lab, RobotStart

BOX_SIDE_PLACES = 8
"""A box is reached at its edge; so many places stand for each side."""
DETOUR_M = 0.3
"""Who passes a bottleneck with two mouths goes this much farther at most by their very points."""


@dataclass(frozen=True, slots=True)
class Stream:
    """The free-flow times of the robots that have one destination and one way there, in seconds."""

    robots: tuple[int, ...]
    shared: bool
    """Whether all of them may be at one place of their destination, since it has no slots."""
    trips: tuple[tuple[float, ...], ...]
    """For each robot the time to each place of the destination; empty without one."""
    mouth: int
    """By which mouth they enter the bottleneck, from 0; -1 if they do not pass it."""
    approaches: tuple[float, ...]
    """For each robot the time to its mouth; empty without one."""
    departures: tuple[float, ...]
    """From the mouth to each place of the destination; empty without either."""


@dataclass(frozen=True, slots=True)
class EntranceGroup:
    """The robots that enter the bottleneck by one mouth."""

    count: int
    approach: float
    """The shortest one, seconds."""
    departure: float


@dataclass(frozen=True, slots=True)
class FreeTimes:
    """The free-flow times of a lab in seconds."""

    streams: tuple[Stream, ...]
    spacing: float
    """Between two robots that pass the same point one behind the other: 2 radius / speed."""
    turnaround: float
    """Between two that enter by different mouths: from one mouth to the other, and the spacing."""

    @property
    def entrances(self) -> dict[int, EntranceGroup]:
        """By mouth, those by which robots enter the bottleneck."""
        found = {}
        for mouth in (0, 1):
            streams = [stream for stream in self.streams if stream.mouth == mouth]
            if streams:
                approach = min(min(stream.approaches) for stream in streams)
                departure = min(min(stream.departures, default=0.0) for stream in streams)
                found[mouth] = EntranceGroup(sum(len(stream.robots) for stream in streams), approach, departure)
        return found


def destinations(lab: Lab) -> dict[int, Area]:
    """Return where robots are to go, as far as the lab says."""
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
    flow = FreeFlow(lab.arena)
    goals = destinations(lab)
    speed = arena.shape.speed
    necks = [approachable(area) for name in arena.bottleneck if (area := arena.area(name)) is not None]
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
    """Return the robots that go to `goal`, by the mouth by which they enter; `across` is the way between the mouths."""
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
    """Return by which mouth a robot enters the bottleneck; -1 when it does not pass it."""
    if len(into) < 2:
        return 0 if into else -1
    if not trip:
        return -1
    ways = [into[mouth] + across + min(beyond[1 - mouth]) for mouth in (0, 1)]
    mouth = ways.index(min(ways))
    return mouth if ways[mouth] <= min(trip) + DETOUR_M else -1


def bound_s(lab: Lab) -> float:
    """Return the physical bound of `lab` in seconds; infinite when a robot has no way to its destination."""
    times = free_times(lab)
    trip = max((_longest_trip(stream.trips, shared=stream.shared) for stream in times.streams), default=0.0)
    return max(trip, _passing(times))


def _passing(times: FreeTimes) -> float:
    """Return how long it takes at least until all are through the bottleneck and at their destinations."""
    entrances = times.entrances
    total = sum(group.count for group in entrances.values())
    lengths = []
    for first in entrances:
        for last in entrances:
            changes = 1 if first != last else 2 if len(entrances) == 2 else 0
            if changes == 2 and entrances[first].count == 1:
                continue  # it cannot be both the first and the last
            gaps = (total - 1 - changes) * times.spacing + changes * times.turnaround
            lengths.append(entrances[first].approach + gaps + entrances[last].departure)
    return min(lengths, default=0.0)


def approachable(area: Area) -> list[Point]:
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
