"""Phase 2, fit of the floor: robots, areas, stations, queues, beacons and passages against walls and one another.

Each check takes the draft of the lab and yields the errors of one rule.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations

from rmr.base.arena import BOTTLENECK, Area
from rmr.base.geometry import Point, distance
from rmr.node.motion.grid import TIGHT_MARGIN_M
from rmr_world.finding import FilePath, Finding
from rmr_world.found_passages import too_near
from rmr_world.lab_geometry import overlaps
from rmr_world.units import ROBOTS_MAX
from rmr_world.validate.lab_draft import LabDraft

_TOUCH_M = 1e-9
"""Tolerance of rounding: two bodies side by side do not overlap."""
APART_M = 0.01
"""Least gap between robots on neighbouring places: the accuracy of a robot's own position."""


def robot_in_arena(draft: LabDraft) -> Iterator[Finding]:
    """A robot is no wider than the arena."""
    if not draft.robot_fits_arena:
        message = f"a robot of radius {draft.spec.robot.radius:g} m does not fit into the arena"
        yield draft.error(("robot", "radius"), message)


def obstacles_in_arena(draft: LabDraft) -> Iterator[Finding]:
    """Each obstacle lies in the arena, in part at least."""
    for i, parts in draft.obstacles:
        if not any(overlaps(part, draft.arena.width, draft.arena.height) for part in parts):
            yield draft.error(("obstacles", i), "lies outside the arena")


def beacons_in_arena(draft: LabDraft) -> Iterator[Finding]:
    """Each beacon that the file names stands in the arena."""
    for k, (x, y) in enumerate(draft.spec.localisation.beacons or ()):
        if not _in_arena(draft, x, y):
            yield draft.error(("localisation", "beacons", k), f"is out of the arena, {_size(draft)}")


def areas_in_arena(draft: LabDraft) -> Iterator[Finding]:
    """Each area lies in the arena, and a robot can stand at each of its places and at each place of its queue."""
    for name, (spec, area) in draft.areas.items():
        path: FilePath = ("areas", name)
        if spec.box is not None:
            x0, y0, x1, y1 = spec.box
            yield from _box_in_arena(draft, (*path, "box"), [Point(x0, y0), Point(x1, y1)])
        elif spec.slots is not None:
            yield from _slots_fit(draft, (*path, "slots"), area.places)
        else:
            yield from _places_fit(draft, (*path, "at" if spec.at is not None else "line"), area.places)
        yield from _places_fit(draft, (*path, "queue"), area.queue)


def places_apart(draft: LabDraft) -> Iterator[Finding]:
    """Robots on two places of an area, or of its queue, do not touch."""
    for name, (spec, area) in draft.areas.items():
        if area.slotted:
            yield from _apart(draft, ("areas", name, "slots" if spec.slots else "line"), area.places)
        yield from _apart(draft, ("areas", name, "queue", "spacing"), area.queue)


def passages_defined(draft: LabDraft) -> Iterator[Finding]:
    """The areas at the ends of the passages are in the file; there is a bottleneck, or passages with names."""
    for path, (name, mouths) in draft.entrances.items():
        for mouth in mouths:
            if mouth not in draft.area_names:
                yield draft.error(path, draft.undefined_area(mouth))
        if path[0] == "passages" and (name == BOTTLENECK or draft.spec.bottleneck is not None):
            message = "a lab has a bottleneck or passages: give the bottleneck another name, under passages"
            yield draft.error(path, message)


def passage_ends_apart(draft: LabDraft) -> Iterator[Finding]:
    """The ends of a passage are as many places."""
    for path, (name, _) in draft.entrances.items():
        passage = draft.arena.passage(name)
        ends = () if passage is None else combinations(passage.mouths, 2)
        if any(distance(*one, *other) < 2 * draft.arena.shape.radius for one, other in ends):
            yield draft.error(path, "two of its mouths are closer than a robot is wide")


def passages_apart(draft: LabDraft) -> Iterator[Finding]:
    """Robots that wait before an entrance stand in the way of none that use another passage."""
    arena = draft.arena
    for number, passage in enumerate(arena.passages):
        for other in arena.passages[:number]:
            for way, its_way, near in too_near(arena, passage, other):
                remedy = "make one of them, with mouths at the outer ends" if near.faces else "make them one passage"
                message = (
                    f"'{passage.entrances[way].name}' is {near.gap_m:.2f} m from '{other.entrances[its_way].name}' "
                    f"of passage '{other.name}'; robots that wait there need {near.apart_m:.2f} m: {remedy}"
                )
                yield draft.error(("passages", passage.name), message)


def robot_count(draft: LabDraft) -> Iterator[Finding]:
    """The world and the radio can serve that many robots."""
    if len(draft.robots) > ROBOTS_MAX:
        message = f"there are {len(draft.robots)} robots; at most {ROBOTS_MAX} are possible"
        yield draft.error(("robots",), message)


def robots_start_free(draft: LabDraft) -> Iterator[Finding]:
    """Each robot has an id of its own and starts in the arena, touching no wall, no obstacle and no other robot."""
    arena = draft.arena
    radius = arena.shape.radius
    for number, (i, start) in enumerate(draft.robots):
        earlier = [other for _, other in draft.robots[:number]]
        path: FilePath = ("robots", i)
        x, y, _ = start.pose
        if any(other.id == start.id for other in earlier):
            yield draft.error(path, f"robot {start.id} is there already")
            continue
        if not _in_arena(draft, x, y):
            yield draft.error(path, f"robot {start.id} starts out of the arena, {_size(draft)}")
        elif min(x, y, arena.width - x, arena.height - y) < radius - _TOUCH_M:
            yield draft.error(path, f"robot {start.id} starts inside a wall")
        elif any(obstacle.distance(x, y) < radius - _TOUCH_M for obstacle in arena.obstacles):
            yield draft.error(path, f"robot {start.id} starts inside an obstacle")
        touching = [o.id for o in earlier if distance(x, y, o.pose.x, o.pose.y) < 2 * radius - _TOUCH_M]
        if touching:
            yield draft.error(path, f"robot {start.id} starts inside robot {touching[0]}")


def _in_arena(draft: LabDraft, x: float, y: float) -> bool:
    return 0.0 <= x <= draft.arena.width and 0.0 <= y <= draft.arena.height


def _size(draft: LabDraft) -> str:
    return f"{draft.arena.width:g} m x {draft.arena.height:g} m"


def _tight(draft: LabDraft, x: float, y: float) -> bool:
    """Return whether an obstacle or a wall is too near to (x, y) for a robot."""
    return draft.arena.clearance(x, y) < draft.arena.shape.radius + TIGHT_MARGIN_M - _TOUCH_M


def _tight_message(draft: LabDraft, x: float, y: float) -> str:
    spare = f"with {TIGHT_MARGIN_M * 1000:g} mm to spare"
    return f"a robot of radius {draft.arena.shape.radius:g} m does not fit at ({x:g}, {y:g}) {spare}"


def _box_in_arena(draft: LabDraft, path: FilePath, corners: Sequence[Point]) -> Iterator[Finding]:
    if not all(_in_arena(draft, x, y) for x, y in corners):
        yield draft.error(path, f"it is out of the arena, {_size(draft)}")


def _slots_fit(draft: LabDraft, path: FilePath, slots: Sequence[Point]) -> Iterator[Finding]:
    """Yield an error for each slot where a robot cannot stand: each has a place of its own in the file."""
    for k, (x, y) in enumerate(slots):
        if not _in_arena(draft, x, y):
            yield draft.error((*path, k), f"it is out of the arena, {_size(draft)}")
        elif _tight(draft, x, y):
            yield draft.error((*path, k), _tight_message(draft, x, y))


def _places_fit(draft: LabDraft, path: FilePath, places: Sequence[Point]) -> Iterator[Finding]:
    """Yield one error for places of one path in the file: the first out of the arena, else the first tight one."""
    out = next(((x, y) for x, y in places if not _in_arena(draft, x, y)), None)
    if out is not None:
        yield draft.error(path, f"({out[0]:g}, {out[1]:g}) is out of the arena, {_size(draft)}")
        return
    tight = next(((x, y) for x, y in places if _tight(draft, x, y)), None)
    if tight is not None:
        yield draft.error(path, _tight_message(draft, *tight))


def _apart(draft: LabDraft, path: FilePath, places: Sequence[Point]) -> Iterator[Finding]:
    """Yield an error for the first two of `places` that are too close."""
    radius = draft.arena.shape.radius
    for k, a in enumerate(places):
        for i, b in enumerate(places[:k]):
            if distance(*a, *b) < 2 * radius + APART_M - _TOUCH_M:
                least = f"two robots of radius {radius:g} m and {APART_M * 1000:g} mm"
                yield draft.error(path, f"places {i} and {k} are closer than {least}")
                return


# ---- stations: areas of the file, apart, with a place for each robot that they take


def stations_defined(draft: LabDraft) -> Iterator[Finding]:
    """Each station is an area of the file."""
    for name in draft.spec.stations:
        if name not in draft.area_names:
            yield draft.error(_station_path(draft, name), draft.undefined_area(name))


def stations_have_places(draft: LabDraft) -> Iterator[Finding]:
    """A station takes no more robots than it has places, and no robot at all fits nowhere."""
    for name, area in _stations(draft):
        capacity = draft.spec.stations[name].capacity
        places = draft.places_of(area)
        if places == 0:
            yield draft.error(("areas", name), f"station '{name}' has no place for a robot")
        elif capacity is not None and capacity > places:
            have = f"{places} place{'s' if places > 1 else ''}"
            message = f"is {capacity}, but area '{name}' has {have}: name at most that many, or add places"
            yield draft.error((*_station_path(draft, name), "capacity"), message)


def stations_apart(draft: LabDraft) -> Iterator[Finding]:
    """No robot in one station stands in the way of one in another, and no queue does."""
    stations = list(_stations(draft))
    near_m = 2.0 * draft.arena.shape.radius
    for number, (name, area) in enumerate(stations):
        for other, others in stations[:number]:
            if _gap_m(area, others) < near_m:
                yield draft.error(_station_path(draft, name), f"lies nearer to station '{other}' than a robot is wide")
        for queued, (_, queue) in draft.areas.items():
            if any(_gap_to_m(area, place) < near_m for place in queue.queue):
                message = f"a place of the queue of area '{queued}' is nearer to station '{name}' than a robot is wide"
                yield draft.error(("areas", queued, "queue"), message)


def stations_without_bottleneck(draft: LabDraft) -> Iterator[Finding]:
    """A lab with stations has no bottleneck: the turns of that are by event, and who drives into a station has none."""
    if draft.spec.stations and draft.spec.bottleneck is not None:
        message = "a lab with a bottleneck has no stations: name the narrow section under passages instead"
        yield draft.error(("stations",), message)


def _station_path(draft: LabDraft, name: str) -> FilePath:
    """Return the path of a station in the file, which may list names or have capacities by name."""
    raw = draft.document.value.get("stations") if isinstance(draft.document.value, dict) else None
    return ("stations", raw.index(name)) if isinstance(raw, list) else ("stations", name)


def _stations(draft: LabDraft) -> Iterator[tuple[str, Area]]:
    """Yield the stations whose areas can be built."""
    return ((name, draft.areas[name][1]) for name in draft.spec.stations if name in draft.areas)


def _gap_m(one: Area, other: Area) -> float:
    """Return the least distance of a point of `one` from a point of `other`, metres."""
    if one.box is None:
        return min(_gap_to_m(other, place) for place in one.places)
    if other.box is None:
        return min(_gap_to_m(one, place) for place in other.places)
    dx = max(one.box[0] - other.box[2], other.box[0] - one.box[2], 0.0)
    dy = max(one.box[1] - other.box[3], other.box[1] - one.box[3], 0.0)
    return distance(dx, dy, 0.0, 0.0)


def _gap_to_m(area: Area, at: Point) -> float:
    """Return the distance of `at` from `area`, metres."""
    if area.box is None:
        return min(distance(*place, *at) for place in area.places)
    x0, y0, x1, y1 = area.box
    return distance(max(x0 - at.x, 0.0, at.x - x1), max(y0 - at.y, 0.0, at.y - y1), 0.0, 0.0)


CHECKS = (
    robot_in_arena,
    obstacles_in_arena,
    beacons_in_arena,
    areas_in_arena,
    places_apart,
    passages_defined,
    passage_ends_apart,
    passages_apart,
    robot_count,
    robots_start_free,
    stations_defined,
    stations_have_places,
    stations_apart,
    stations_without_bottleneck,
)
"""The rules of the floor."""
