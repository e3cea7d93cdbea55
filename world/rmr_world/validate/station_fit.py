"""Phase 2, fit of the stations: areas of the file, apart, with a place for each robot that they take."""

from collections.abc import Iterator

from rmr.base.arena import Area
from rmr.base.geometry import Point, distance
from rmr_world.finding import FilePath, Finding
from rmr_world.validate.lab_draft import LabDraft


def stations_defined(draft: LabDraft) -> Iterator[Finding]:
    """Each station is an area of the file."""
    for name in draft.spec.stations:
        if name not in draft.area_names:
            yield draft.error(_path(draft, name), draft.undefined_area(name))


def stations_have_places(draft: LabDraft) -> Iterator[Finding]:
    """A station takes no more robots than it has places, and no robot at all fits nowhere."""
    for name, area in _areas(draft):
        capacity = draft.spec.stations[name].capacity
        places = draft.places_of(area)
        if places == 0:
            yield draft.error(("areas", name), f"station '{name}' has no place for a robot")
        elif capacity is not None and capacity > places:
            have = f"{places} place{'s' if places > 1 else ''}"
            message = f"is {capacity}, but area '{name}' has {have}: name at most that many, or add places"
            yield draft.error((*_path(draft, name), "capacity"), message)


def stations_apart(draft: LabDraft) -> Iterator[Finding]:
    """No robot in one station stands in the way of one in another, and no queue does."""
    stations = list(_areas(draft))
    near_m = 2.0 * draft.arena.shape.radius
    for number, (name, area) in enumerate(stations):
        for other, others in stations[:number]:
            if _gap_m(area, others) < near_m:
                yield draft.error(_path(draft, name), f"lies nearer to station '{other}' than a robot is wide")
        for queued, (_, queue) in draft.areas.items():
            if any(_gap_to_m(area, place) < near_m for place in queue.queue):
                message = f"a place of the queue of area '{queued}' is nearer to station '{name}' than a robot is wide"
                yield draft.error(("areas", queued, "queue"), message)


def stations_without_bottleneck(draft: LabDraft) -> Iterator[Finding]:
    """A lab with stations has no bottleneck: the turns of that are by event, and who drives into a station has none."""
    if draft.spec.stations and draft.spec.bottleneck is not None:
        message = "a lab with a bottleneck has no stations: name the narrow section under passages instead"
        yield draft.error(("stations",), message)


CHECKS = (stations_defined, stations_have_places, stations_apart, stations_without_bottleneck)
"""The rules of the stations."""


def _path(draft: LabDraft, name: str) -> FilePath:
    """Return the path of a station in the file, which may list names or have capacities by name."""
    raw = draft.document.value.get("stations") if isinstance(draft.document.value, dict) else None
    return ("stations", raw.index(name)) if isinstance(raw, list) else ("stations", name)


def _areas(draft: LabDraft) -> Iterator[tuple[str, Area]]:
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
