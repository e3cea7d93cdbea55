"""The route of one robot: the leader's path and the followers' (paper IV.D.1).

The leader goes S1 -> S1' -> P1' -> T1' -> T1 and shares P1', the part of its path that all robots need: from
the bottleneck to where it is wide again (the part before depends on where the leader comes from). A follower
k goes S_k -> S1' -> P1' -> T1' -> T_k with straight legs where they are free and its own A* where they are not;
it joins P1' where it is nearest, so that a robot that waits at the entry never drives back to S1'.

A route is a polyline measured by arc length. Two lengths on it concern the bottleneck: the gate, where it
passes nearest to the mouth by which it enters, and where the narrow section after it has ended. A bottleneck with
two mouths is entered by either; robots that wait before one leave room for those that come out of it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import Final, NamedTuple

from rmr.base.arena import Arena, FloorPassage
from rmr.base.direction import ends_of
from rmr.base.geometry import Point, Pose, distance, hypot, point_segment_distance
from rmr.base.grid_path import GridPath
from rmr.base.motion_scale import scale_of
from rmr.node.motion.astar import plan
from rmr.node.motion.grid import PATH_MARGIN_M, Discs, segment_clearance

GATE_REACH_M: Final = 0.15
"""A route has a gate if it passes the bottleneck's point within this, times the size of the robots."""
EXIT_REACH_M: Final = 0.3
"""A route passes the mouth by which it leaves within this, times the size: it turns off to its goal there."""
AROUND: Final = 1.2
"""A way from mouth to mouth that is longer than this times the shortest one leads around the passage."""
ROOM_M: Final = 0.05
"""Before a mouth by which others come out, the one that waits leaves room for a hull and this."""
VIA_M: Final = 0.05
"""A route whose gate is nearer than this starts at the bottleneck and needs no point to pass through."""
DETOUR_M: Final = 0.15
"""What the way through the bottleneck's very point may cost, times the size."""
INTO_M: Final = 0.01
"""The path's direction so far behind the gate, which may be a corner of it, is that of the way through."""
GRAZES_M: Final = 0.01
"""A disc that the path enters by less than this is not in its way: parked robots tell centimetres."""
TOUCHES_M: Final = 1e-6
"""Farther from an obstacle than this is not on it."""
SCAN_M: Final = 0.04
"""Step of the search for the end of the narrow section."""


@dataclass(frozen=True, slots=True)
class Route:
    """A polyline with its arc lengths."""

    points: tuple[Point, ...]
    at_m: tuple[float, ...]
    """Arc length at each point."""
    gate_m: float | None = None
    """Arc length of the gate; None: the route passes no passage."""
    clear_m: float = 0.0
    """Arc length where the hull is out of the narrow section."""
    way: int = 0
    """Direction through the gate: 0 eastward (or due north), 1 westward (or due south); of a passage with several
    ends by `rmr.base.direction`."""
    within: bool = False
    """Whether it begins in the narrow section: the gate is where it begins."""
    room_m: float = 0.0
    """What a robot that waits before the gate leaves free for those that come out."""
    passage: str | None = None
    """Name of the passage behind the gate."""
    xs: tuple[float, ...] = field(init=False, compare=False, repr=False)
    """The points as bare numbers, for each frame of a moving robot asks for some."""
    ys: tuple[float, ...] = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "xs", tuple([x for x, _ in self.points]))
        object.__setattr__(self, "ys", tuple([y for _, y in self.points]))

    @property
    def length_m(self) -> float:
        """Return the whole length in metres."""
        return self.at_m[-1]

    @property
    def mouth(self) -> Pose:
        """Return the gate, as one who enters by it stands there."""
        gate = self.gate_m or 0.0
        return Pose(*self.point(gate), self.heading(gate + INTO_M))

    def segment(self, s: float) -> int:
        """Return the index of the segment that holds arc length `s`."""
        at_m = self.at_m
        i = 0
        last = len(self.at_m) - 2
        while i < last and at_m[i + 1] <= s:
            i += 1
        return i

    def point(self, s: float) -> Point:
        """Return the point at arc length `s`, at most the end."""
        return Point(*self.place(s))

    def place(self, s: float) -> tuple[float, float]:
        """Return the point at arc length `s` as bare numbers."""
        i = self.segment(s)
        xs = self.xs
        ys = self.ys
        ax = xs[i]
        ay = ys[i]
        bx = xs[i + 1]
        by = ys[i + 1]
        start = self.at_m[i]
        end = self.at_m[i + 1]
        t = 0.0 if s <= start else 1.0 if s >= end else (s - start) / (end - start)
        return ax + (bx - ax) * t, ay + (by - ay) * t

    def heading(self, s: float) -> float:
        """Return the direction of the path at arc length `s`, radians."""
        i = self.segment(s)
        a = self.points[i]
        b = self.points[i + 1]
        return math.atan2(b.y - a.y, b.x - a.x)

    def meets(self, s: float, discs: Discs) -> bool:
        """Return whether the route after arc length `s` enters one of `discs`."""
        i = self.segment(s)
        rest = (self.point(s), *self.points[i + 1 :])
        (x0, y0) = map(min, zip(*rest, strict=True))
        (x1, y1) = map(max, zip(*rest, strict=True))
        near = [(x, y, keep) for x, y, keep in discs if x0 - keep < x < x1 + keep and y0 - keep < y < y1 + keep]
        return any(
            point_segment_distance(x, y, *a, *b) < keep - GRAZES_M for a, b in pairwise(rest) for x, y, keep in near
        )

    def project(self, x: float, y: float, low: float, high: float) -> float:
        """Return the arc length within [low, high] whose point is nearest to (x, y)."""
        best = math.inf
        best_s = low
        xs = self.xs
        ys = self.ys
        at_m = self.at_m
        i = self.segment(low)
        last = len(at_m) - 1
        while i < last and at_m[i] <= high:
            ax = xs[i]
            ay = ys[i]
            start = at_m[i]
            length = at_m[i + 1] - start
            dx = xs[i + 1] - ax
            dy = ys[i + 1] - ay
            along = 0.0 if length <= 0.0 else ((x - ax) * dx + (y - ay) * dy) / length
            s = start if along < 0.0 else start + (length if along > length else along)
            s = high if s > high else s
            s = low if s < low else s
            t = 0.0 if length <= 0.0 else (s - start) / length
            away = hypot(x - ax - dx * t, y - ay - dy * t)
            if away < best - 1e-12:
                best = away
                best_s = s
            i += 1
        return best_s


class DriveOrder(NamedTuple):
    """A drive that was asked for: where to, along which shared path, and whether through the gate."""

    goal: Point
    shared: GridPath | None
    through_gate: bool
    lost: frozenset[Point] = frozenset()
    """Where the dead stand: nobody waits for them to leave."""
    behind: frozenset[str] = frozenset()
    """Names of the passages that the drive has behind it."""
    via: str | None = None
    """The passage at which the robot has asked for a turn: the drive leads through it if it can."""


def make_route(
    arena: Arena, points: Sequence[Point], *, through_gate: bool, behind: frozenset[str] = frozenset()
) -> Route:
    """Return the route along `points` (two at least), with the gate of the first passage that it is to pass.

    Passages that are `behind` the robot have no gate.
    """
    at = [0.0]
    for a, b in pairwise(points):
        at.append(at[-1] + distance(*a, *b))
    route = Route(tuple(points), tuple(at))
    passages = arena.passages if through_gate else ()
    for passage in passages:
        if passage.name not in behind and _begins_within(arena, passage, route):
            return gated_again(arena, passage, route)
    gated = [found for passage in passages if (found := _gated(arena, passage, route)) is not None]
    # A route that comes by both mouths of a passage may lead from the one to the other through the next passage.
    passed = [each for each in gated if not any(_encloses(each, other) for other in gated)]
    return min(
        (each for each in passed if each.passage not in behind), key=lambda each: each.gate_m or 0.0, default=route
    )


def _encloses(one: Route, other: Route) -> bool:
    """Return whether the passage of `one` begins before that of `other` and ends behind it."""
    return (one.gate_m or 0.0) < (other.gate_m or 0.0) and other.clear_m < one.clear_m


def _gated(arena: Arena, passage: FloorPassage, route: Route) -> Route | None:
    """Return `route` with the gate of `passage`; None if it does not pass it."""
    size = scale_of(arena.shape).size
    if passage.one_way:
        gate = route.project(*passage.mouths[0], 0.0, route.length_m)
        if not _passes(arena, route, gate, passage.mouths[0], GATE_REACH_M * size):
            return None
        if not passage.by_event and route.length_m - gate < VIA_M:
            return None  # it ends before the entrance, in the queue
        way = way_of(route.heading(gate + INTO_M))
        clear = _end_of_narrow(arena, route, gate)
        return replace(route, gate_m=gate, clear_m=clear, way=way, passage=passage.name)
    found = None
    passed = [route.project(*mouth, 0.0, route.length_m) for mouth in passage.mouths]
    for way in passage.ways:
        entrance = passage.entrance(way)
        end = passage.end(way)
        gate, out = (passed[each] for each in ends_of(way))
        passes = gate <= out and _passes(arena, route, gate, entrance, GATE_REACH_M * size)
        if not (passes and _passes(arena, route, out, end, EXIT_REACH_M * size)):
            continue
        # Large robots reach far: past the mouths of this passage the way may lead through one beside it.
        if out - gate > AROUND * way_through_m(arena, entrance, end) + EXIT_REACH_M * size:
            continue
        if found is None or gate < (found.gate_m or 0.0):
            clear = _clear_of(arena, passage, route, gate)
            room = _room(arena, passage)
            found = replace(route, gate_m=gate, clear_m=clear, way=way, room_m=room, passage=passage.name)
    return found


def _passes(arena: Arena, route: Route, at_m: float, mouth: Point, reach_m: float) -> bool:
    """Return whether `route` leads through `mouth`, to which it is nearest at `at_m`.

    Where a passage is wide, a route leads past the middle of its mouth.
    """
    return distance(*route.point(at_m), *mouth) <= max(reach_m, arena.clearance(*mouth))


@lru_cache(maxsize=64)
def way_through_m(arena: Arena, one: Point, other: Point) -> float:
    """Return the length of the way between the mouths of a passage where nobody stands, metres; 0 without one."""
    found = plan(arena, one, other)
    return 0.0 if found is None else found.length_m


def _room(arena: Arena, passage: FloorPassage) -> float:
    """Return what a robot that waits before a mouth leaves free for others."""
    return 0.0 if passage.one_way else 2.0 * arena.shape.radius + ROOM_M


def still_behind(arena: Arena, behind: frozenset[str], at: Point) -> frozenset[str]:
    """Return those of the passages that a robot had `behind` it which it still has at `at`.

    It has driven away from the others: a way that leads through one of these again passes its gate. The bottleneck of
    an event stays behind: the turn is over.
    """
    away_m = 4.0 * arena.shape.radius + ROOM_M
    passages = [each for each in arena.passages if each.name in behind]
    return frozenset(
        each.name for each in passages if each.by_event or any(distance(*mouth, *at) <= away_m for mouth in each.mouths)
    )


def gated_again(arena: Arena, passage: FloorPassage, route: Route) -> Route:
    """Return `route`, made anew inside `passage`, with the gate behind its start."""
    way = way_of(route.heading(0.0))
    if not passage.one_way:
        passed = [route.project(*mouth, 0.0, route.length_m) for mouth in passage.mouths]
        off = [distance(*route.point(at), *mouth) for at, mouth in zip(passed, passage.mouths, strict=True)]
        # The mouth by which it came lies behind it, the nearest one if several do; it passes that by which it leaves.
        pairs = ((ends_of(each), each) for each in passage.ways)
        way = min(((passed[one] + off[other], off[one]), each) for (one, other), each in pairs)[1]
    clear = _clear_of(arena, passage, route, 0.0)
    room = _room(arena, passage)
    return replace(route, gate_m=0.0, clear_m=clear, way=way, within=True, room_m=room, passage=passage.name)


def _clear_of(arena: Arena, passage: FloorPassage, route: Route, gate: float) -> float:
    """Return where the hull is out of what lies behind the gate; of several mouths also out of those that follow."""
    end = _end_of_narrow(arena, route, gate)
    for mouth in () if passage.one_way else passage.mouths:
        out = route.project(*mouth, gate, route.length_m)
        if out > gate + VIA_M and distance(*route.point(out), *mouth) <= EXIT_REACH_M * scale_of(arena.shape).size:
            end = max(end, min(route.length_m, out + arena.shape.radius))
    return end


def way_of(heading: float) -> int:
    """Return 0 for a heading to the east (or due north), 1 for the opposite ways."""
    east = math.cos(heading)
    if abs(east) <= 1e-9:
        return 0 if math.sin(heading) > 0.0 else 1
    return 0 if east > 0.0 else 1


def _end_of_narrow(arena: Arena, route: Route, gate: float) -> float:
    """Return where, after `gate`, the last narrow place lies, and a radius more."""
    radius = arena.shape.radius
    end = gate
    s = gate
    while s < route.length_m and s < end + 4.0 * radius:
        if _narrow(arena, route, s):
            end = s
        s += SCAN_M
    return min(route.length_m, end + SCAN_M + radius)


def _begins_within(arena: Arena, passage: FloorPassage, route: Route) -> bool:
    """Return whether the narrow section behind one of the mouths of `passage` reaches to where the route begins."""
    start = route.points[0]
    if not _narrow(arena, route, 0.0):
        return False
    for mouth in passage.mouths:
        back = None if mouth == start else leader_route(arena, mouth, start, (), through_gate=False)
        narrow = back is not None and _narrow(arena, back, back.length_m)
        if back is not None and narrow and _end_of_narrow(arena, back, 0.0) >= back.length_m:
            return True
    return False


def _narrow(arena: Arena, route: Route, s: float) -> bool:
    """Return whether both sides of the path are closed within two robot diameters."""
    here = route.point(s)
    heading = route.heading(s)
    reach = 4.0 * arena.shape.radius
    dx = -math.sin(heading) * reach
    dy = math.cos(heading) * reach
    return all(
        segment_clearance(arena, here, Point(here.x + side * dx, here.y + side * dy), TOUCHES_M) <= 0.0
        for side in (1.0, -1.0)
    )


def leader_route(
    arena: Arena,
    start: Point,
    goal: Point,
    parked: Sequence[Point],
    *,
    through_gate: bool,
    behind: frozenset[str] = frozenset(),
) -> Route | None:
    """Return the robot's own route by A*, or None when there is no way.

    A route that has a gate goes through the very point of the entrance, so that robots from all sides meet there and
    nowhere before. Passages that are `behind` the robot have none.
    """
    found = plan(arena, start, goal, parked)
    if found is None:
        return None
    route = make_route(arena, found.points, through_gate=through_gate, behind=behind)
    passage = arena.passage(route.passage)
    if passage is None or route.gate_m is None or route.gate_m < VIA_M:
        return route
    via = passage.entrance(route.way)
    into = plan(arena, start, via, parked)
    out = plan(arena, via, goal, parked)
    if (
        into is None
        or out is None
        or into.length_m + out.length_m > route.length_m + DETOUR_M * scale_of(arena.shape).size
    ):
        return route
    return make_route(arena, [*into.points, *out.points[1:]], through_gate=True, behind=behind)


def queue_before(arena: Arena, start: Point) -> list[Point]:
    """Return the nearest mouth's point and those places of its queue that are nearer to it than `start`."""
    entrances = [area for passage in arena.passages for area in passage.entrances]
    if not entrances:
        return []
    area = min(entrances, key=lambda area: distance(*start, *area.places[0]))
    gate = area.places[0]
    own = distance(*start, *gate) - 0.5 * arena.shape.radius
    return [gate, *(place for place in area.queue if distance(*place, *gate) < own)]


def off_queue(arena: Arena, start: Point, parked: Sequence[Point]) -> list[Point]:
    """Return `parked` without the robots that stand before `start` at the gate or in its queue.

    They go first; who comes after them waits for them to leave and does not drive around them.
    """
    spots = queue_before(arena, start)
    keep = 2.0 * arena.shape.radius + PATH_MARGIN_M
    return [p for p in parked if all(distance(*p, *spot) >= 0.5 * keep for spot in spots)]
