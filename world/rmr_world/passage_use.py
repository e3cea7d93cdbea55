"""Which robots' drives pass which narrow places, and by which turns.

Known are the drives with which robots begin (`first_instant`): the `moveto` that a program derives from its initial
facts alone, and the job that it serves. Later drives depend on what robots sense and receive, and are not shown.
"""

from functools import lru_cache

from rmr.base.arena import BOTTLENECK, Area, Arena, FloorPassage
from rmr.base.geometry import Point
from rmr.base.motion_scale import scale_of
from rmr.base.record import record
from rmr.base.values import Symbol, Value
from rmr.bytecode.program import Constant, Program, Serving, Slot
from rmr.node.motion.keep_right import gated_route
from rmr.node.motion.route import Route, make_route
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import ActionDerived
from rmr_world.finding import FilePath
from rmr_world.found_passages import belongs
from rmr_world.lab import Lab, RobotStart
from rmr_world.narrow_places import NarrowPassage, NarrowPlaces, narrow_places
from rmr_world.validate.first_instant import MOVETO, ROBOTS_MAX, FirstInstant, first_instants

SAMPLE_M = 0.02
"""Step along a route in the search for narrow places on it."""


@record
class NamedPassage:
    """A passage with turns: one that the lab file names, or of one that names none one that was found."""

    name: str
    path: FilePath
    """Its place in the lab file; of one that was found that of the floor."""
    areas: tuple[str, ...]
    """The areas at its entrances."""
    entrances: tuple[Point, ...]
    by_event: bool
    """Whether its turns exclude jobs of one event only, and not all that drive through."""
    found: bool = False


@record
class FirstDrive:
    """The first drive of a robot that knows at the start where it goes."""

    robot: int
    goal: Area
    route: Route
    job: TimedJob | None
    """The scheduled job that the drive serves; None: it waits for no turn."""
    to_station: bool = False
    """Whether its turn is a place of a station."""

    @property
    def event(self) -> str | None:
        """The event of the job; robots with jobs of one event take turns."""
        return None if self.job is None else self.job.event

    @property
    def gated(self) -> bool:
        """Whether its turn is a passage that the lab names, and not the whole drive or a station."""
        return self.job is not None and self.route.gate_m is not None and not self.to_station

    def needs_turn(self, passage: NamedPassage) -> bool:
        """Return whether it goes by turns at a passage that the lab names."""
        return self.job is not None or not passage.by_event


@record
class PassageUse:
    """A passage of the floor, named or found, and the drives that pass it."""

    name: str
    named: NamedPassage | None
    """None: it has no turns of its own."""
    ends: tuple[Point, ...]
    narrow: tuple[NarrowPassage, ...]
    """The narrow sections of the floor that it consists of; empty where a named one is not narrow."""
    drives: tuple[FirstDrive, ...]

    @property
    def events(self) -> tuple[str | None, ...]:
        """The events of the drives, none twice; None for drives that wait for no turn."""
        return tuple(dict.fromkeys(drive.event for drive in self.drives))


def passages_on(arena: Arena, route: Route) -> dict[str, Route]:
    """Return the named passages on a route in order, each with the route that has its gate there."""
    found: dict[str, Route] = {}
    while route.passage is not None and route.passage not in found:
        found[route.passage] = route
        route = make_route(arena, route.points, through_gate=True, behind=frozenset(found))
    return found


def named_passages(arena: Arena) -> tuple[NamedPassage, ...]:
    """Return the passages that have turns: the only place that knows by which keys of the lab file."""
    return tuple(
        NamedPassage(
            passage.name,
            _path(passage),
            tuple(area.name for area in passage.entrances),
            passage.mouths,
            by_event=passage.by_event,
            found=passage.found,
        )
        for passage in arena.passages
    )


def _path(passage: FloorPassage) -> FilePath:
    if passage.found:
        return ("arena",)
    return (BOTTLENECK,) if passage.by_event else ("passages", passage.name)


@lru_cache(maxsize=4)
def passage_uses(lab: Lab, program: Program) -> tuple[PassageUse, ...]:
    """Return the passages of the lab: those that it names first, then the others that were found."""
    arena = lab.arena
    found = narrow_places(arena)
    drives = first_drives(lab, program)
    uses = []
    left = list(found.passages)
    size = scale_of(arena.shape).size
    for named in named_passages(arena):
        own = tuple(each for each in left if belongs(each, named.entrances, size))
        left = [each for each in left if each not in own]
        ends = named.entrances if len(named.entrances) > 1 or not own else own[0].ends
        gated = [drive for drive in drives if named.name in passages_on(arena, drive.route)]
        passing = tuple(d for d in drives if d in gated or any(_stretch(d.route, each) for each in own))
        uses.append(PassageUse(named.name, named, ends, own, passing))
    for each in left:
        passing = tuple(drive for drive in drives if _stretch(drive.route, each))
        uses.append(PassageUse(each.name, None, each.ends, (each,), passing))
    return tuple(uses)


def first_drives(lab: Lab, program: Program) -> tuple[FirstDrive, ...]:
    """Return the first drive of each robot, at most one for a robot, for the first `ROBOTS_MAX` robots."""
    return tuple(drive for drive, _ in _first_instants(lab, program) if drive is not None)


def first_events(lab: Lab, program: Program, assertion: int) -> tuple[str, ...]:
    """Return the events of the jobs of an assertion that begin at the start, none twice."""
    jobs = [job for _, of_robot in _first_instants(lab, program) for job in of_robot]
    return tuple(dict.fromkeys(job.event for job in jobs if job.assertion == assertion))


@lru_cache(maxsize=4)
def _first_instants(lab: Lab, program: Program) -> tuple[tuple[FirstDrive | None, tuple[TimedJob, ...]], ...]:
    """Return the first drive and the jobs of each robot after its first instant."""
    found = []
    for start in lab.robots[:ROBOTS_MAX]:
        instant = first_instants(lab, program).of(start.id)
        found.append((_first_drive(lab, program, start, instant), instant.jobs))
    return tuple(found)


def is_in_narrow(found: NarrowPlaces, at: Point) -> bool:
    """Return whether a robot at `at` stands in a narrow section."""
    return any(each.holds(at) for each in found.passages)


def _first_drive(lab: Lab, program: Program, start: RobotStart, instant: FirstInstant) -> FirstDrive | None:
    event = _first_moveto(program, start.id, instant)
    goal = _goal(lab.arena, event)
    if event is None or goal is None:
        return None
    here = Point(start.pose.x, start.pose.y)
    route = gated_route(lab.arena, here, goal.places[0], ())
    job = next((job for job in instant.jobs if _serves(program, job, event.predicate, event.args)), None)
    to_station = lab.arena.capacity(goal.name) > 0
    return None if route is None else FirstDrive(start.id, goal, route, job, to_station)


def first_goal(lab: Lab, program: Program, robot: int) -> Area | None:
    """Return the area to which the first drive of `robot` leads, with a way or without; None: to none that is known."""
    return _goal(lab.arena, _first_moveto(program, robot, first_instants(lab, program).of(robot)))


def _first_moveto(program: Program, robot: int, instant: FirstInstant) -> ActionDerived | None:
    moveto = program.index(MOVETO)
    derived = (event for event in instant.events if isinstance(event, ActionDerived) and event.predicate == moveto)
    return next((event for event in derived if event.executor == robot), None)


def _goal(arena: Arena, moveto: ActionDerived | None) -> Area | None:
    named = moveto is not None and moveto.args and isinstance(moveto.args[0], Symbol)
    return arena.area(str(moveto.args[0])) if moveto is not None and named else None


def _serves(program: Program, job: TimedJob, action: int, args: tuple[Value, ...]) -> bool:
    """Return whether an action with these arguments waits for the turn of `job`."""
    assertion = program.assertions[job.assertion]
    return assertion.scheduled and any(
        serving.action == action and _matches(serving, job, args) for serving in assertion.serving
    )


def _matches(serving: Serving, job: TimedJob, args: tuple[Value, ...]) -> bool:
    for pattern, arg in zip(serving.args, args, strict=True):
        if isinstance(pattern, Constant) and pattern.value != arg:
            return False
        if isinstance(pattern, Slot) and job.bindings[pattern.index] not in (None, arg):
            return False
    return True


def stretch(arena: Arena, drive: FirstDrive, use: PassageUse) -> tuple[float, float] | None:
    """Return where a drive enters a passage and where it has left it, arc lengths in metres; None: it does not pass.

    Of a named passage that turns cover these are the gate and the end of the narrow section.
    """
    gated = passages_on(arena, drive.route).get(use.name) if use.named is not None else None
    if gated is not None and gated.gate_m is not None:
        return gated.gate_m, gated.clear_m
    found = [each for passage in use.narrow if (each := _stretch(drive.route, passage)) is not None]
    return (min(enter for enter, _ in found), max(leave for _, leave in found)) if found else None


def _stretch(route: Route, passage: NarrowPassage) -> tuple[float, float] | None:
    """Return the arc lengths of the first and of the last point of `route` in a narrow section, metres."""
    steps = int(route.length_m / SAMPLE_M)
    inside = [k * SAMPLE_M for k in range(steps + 1) if passage.holds(route.point(k * SAMPLE_M))]
    return (inside[0], inside[-1]) if inside else None
