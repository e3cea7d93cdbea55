"""Phase 4, feasibility of time and space: durations and deadlines that no schedule can meet, areas without room.

Each robot's program is run on its initial facts alone (`first_instant`). A job that it starts has a deadline. Where the
finish fact says that the robot is in an area, or is the lab's, by which each robot is to be at its destination, the
free-flow trip is a lower bound of the time. Jobs that begin later, or depend on what robots sense or receive, are
compared with their bound in the report.
"""

from collections import Counter
from collections.abc import Iterator
from math import inf

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.time import in_seconds
from rmr.base.values import Symbol
from rmr.bytecode.program import Program
from rmr.node.driver import spots
from rmr.vm.job import TimedJob
from rmr_world.bound import approachable, bound_s, destinations
from rmr_world.fact_syntax import TermError, parse_fact
from rmr_world.finding import Finding
from rmr_world.free_flow import FreeFlow, free_flow
from rmr_world.lab import Lab, RobotStart
from rmr_world.validate.first_instant import ROBOTS_MAX, first_destinations, first_instants, largest_args
from rmr_world.validate.schedulability import served_by_handler, served_by_moveto

AT = "at"
"""The fact that a robot states while it is in an area."""


def duration_below_bound(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn when the duration is below the physical bound of the run."""
    duration_s = in_seconds(lab.duration)
    least_s = bound_s(lab)
    if duration_s < least_s < inf:
        message = f"nothing can finish within {duration_s:g} s: no schedule takes less than {least_s:.2f} s"
        yield lab.warning(("duration",), message)


def deadline_below_trip(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of the deadline of a job that starts at once and whose free-flow trip takes longer."""
    trips_end_with = {AT} if lab.finish_pattern is None else {AT, lab.finish_pattern.name}
    if all(program.predicates[each.finish.predicate].name not in trips_end_with for each in program.assertions):
        return
    flow = free_flow(lab.arena)
    goals = destinations(lab)
    for start in lab.robots[:ROBOTS_MAX]:
        yield from _deadlines_of(lab, program, start, goals.get(start.id), flow)


def _deadlines_of(
    lab: Lab, program: Program, start: RobotStart, destination: Area | None, flow: FreeFlow
) -> Iterator[Finding]:
    for job in first_instants(lab, program).of(start.id).jobs:
        goal = _goal_of(lab, job, destination)
        if goal is None or job.remote or job.finish is not None:
            continue
        lengths_m = flow.lengths(Point(start.pose.x, start.pose.y), approachable(goal))
        least_s = min(lengths_m) / lab.arena.shape.speed
        deadline_s = in_seconds(job.deadline)
        if deadline_s < least_s < inf:
            within = f"within {deadline_s:g} s ({job.name}): the way alone takes {least_s:.2f} s"
            message = f"robot {start.id} cannot be at {goal.name} {within}"
            yield lab.warning(_deadline_path(lab, start.id, deadline_s), message)


def _goal_of(lab: Lab, job: TimedJob, destination: Area | None) -> Area | None:
    """Return where a job ends: the area in its finish fact or, if that fact is the lab's, `destination`."""
    try:
        fact = parse_fact(job.text)
    except TermError:
        return None  # its finish fact holds a variable: any area will do
    if fact.name == AT and fact.args and isinstance(fact.args[0], Symbol):
        return lab.arena.area(str(fact.args[0]))
    return destination if lab.finish_pattern is not None and fact.name == lab.finish_pattern.name else None


def _deadline_path(lab: Lab, robot: int, deadline_s: float) -> tuple[str, int] | tuple[str]:
    """Return where the lab file states the deadline: the fact of the robot with that argument, else the program.

    A negative argument is a deadline of 0 s.
    """
    items = lab.fact_items or range(len(lab.facts))
    for fact, index in zip(lab.stated_facts, items, strict=False):
        numbers = [max(arg, 0) for arg in largest_args(fact) if isinstance(arg, int | float)]
        if fact.owner in (None, robot) and deadline_s in numbers:
            return "facts", index
    return ("program",)


# ---- feasibility of space: an area has room for the robots that go there


def area_too_small(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of an area with less room than the robots that go there need at a time."""
    ends_at_area = lab.finish_pattern is not None and lab.finish_pattern.name == "at"
    radius_m = lab.arena.shape.radius
    for area, robots in Counter(_goals(lab, program, ends_at_area=ends_at_area).values()).items():
        room = _room(lab, area)
        if room >= robots or (ends_at_area and area.box is None):
            continue  # too few places of the area in `finish` are an error of phase 2
        if 0 < lab.arena.capacity(area.name) <= room and not ends_at_area:
            continue  # a station: robots go there one after another
        if area.box is not None and room == 0:
            message = f"no robot of radius {radius_m:g} m fits into area '{area.name}'"
        else:
            fit = f"{room} robot{'s' if room != 1 else ''} of radius {radius_m:g} m"
            message = f"area '{area.name}' has room for {fit} at a time, and {robots} go there"
        kind = "box" if area.box is not None else "slots" if area.slotted else "at"
        yield lab.warning(("areas", area.name, kind), message)


def _goals(lab: Lab, program: Program, *, ends_at_area: bool) -> dict[int, Area]:
    """Return the area of each robot that certainly stands there together with the others that go there."""
    if any(served_by_moveto(program, each) for each in program.assertions):
        # Robots that go by turns may leave before the next one comes, unless all must be there to finish.
        return destinations(lab) if ends_at_area else {}
    goals = first_destinations(lab, program)
    if not ends_at_area and any(served_by_handler(program, each) for each in program.assertions):
        # A handler may drive by turns to the area that `finish` names, and leave it again.
        return {robot: area for robot, area in goals.items() if robot not in destinations(lab)}
    return goals


def _room(lab: Lab, area: Area) -> int:
    """Return how many robots can stand in `area` at a time."""
    if area.box is None:
        return len(area.places)
    return sum(lab.arena.clearance(*place) > lab.arena.shape.radius for place in spots(lab.arena, area))


CHECKS = (
    duration_below_bound,
    deadline_below_trip,
    area_too_small,
)
"""The rules of time and space."""
