"""Deadlines that nothing can meet, told before the run where lab and program show them.

Each robot's program is run on its initial facts alone, at instant 0, without senses, radio or actions. The jobs that
it starts have a deadline; where the finish fact says that the robot is in an area, or is the lab's, by which each robot
is to be at its destination, the free-flow trip there takes a time that no robot beats. What begins later, or depends on
what robots sense or are told, is judged by the report.
"""

from collections.abc import Iterator

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.time import in_seconds
from rmr.base.values import Symbol
from rmr.bytecode.program import Program
from rmr.vm.job import TimedJob
from rmr_world.bound import approachable, destinations
from rmr_world.document import Problem
from rmr_world.first_moves import ROBOTS_MAX, at_most, started
from rmr_world.free_flow import FreeFlow
from rmr_world.lab import Lab, RobotStart
from rmr_world.terms import TermError, parse_fact
from rmr_world.usage import problem_at

AT = "at"
"""The fact that a robot states when it is in an area."""


def impossible(lab: Lab, program: Program) -> list[Problem]:
    """Return a warning for each deadline of a job that begins at once and that the way alone takes longer than."""
    ends_there = {AT} if lab.finish_pattern is None else {AT, lab.finish_pattern.name}
    if all(program.predicates[each.finish.predicate].name not in ends_there for each in program.assertions):
        return []
    flow, goals = FreeFlow(lab.arena), destinations(lab)
    return [
        problem
        for start in lab.robots[:ROBOTS_MAX]
        for problem in _of_robot(lab, program, start, goals.get(start.id), flow)
    ]


def _of_robot(
    lab: Lab, program: Program, start: RobotStart, destination: Area | None, flow: FreeFlow
) -> Iterator[Problem]:
    for job in started(lab, program, start.id).jobs:
        goal = _goal_of(lab, job, destination)
        if goal is None or job.remote or job.finish is not None:
            continue
        ways = flow.lengths(Point(start.pose.x, start.pose.y), approachable(goal))
        least_s = min(ways) / lab.arena.shape.speed
        if in_seconds(job.deadline) < least_s < float("inf"):
            within = f"within {in_seconds(job.deadline):g} s ({job.name}): the way alone takes {least_s:.2f} s"
            message = f"warning: robot {start.id} cannot be at {goal.name} {within}"
            yield problem_at(lab, _path(lab, start.id, in_seconds(job.deadline)), message)


def _goal_of(lab: Lab, job: TimedJob, destination: Area | None) -> Area | None:
    """Return where a job ends: in the area that its finish fact names or, if that is the lab's, at `destination`."""
    try:
        fact = parse_fact(job.text)
    except TermError:
        return None  # it waits for any area
    if fact.name == AT and fact.args and isinstance(fact.args[0], Symbol):
        return lab.arena.area(str(fact.args[0]))
    return destination if lab.finish_pattern is not None and fact.name == lab.finish_pattern.name else None


def _path(lab: Lab, robot: int, deadline_s: float) -> tuple[str, int] | tuple[str]:
    """Return where the lab file states the deadline: in a fact of the robot that has it for an argument.

    A negative one is a deadline of 0 s.
    """
    items = lab.fact_items or range(len(lab.facts))
    for fact, index in zip(lab.stated_facts, items, strict=False):
        numbers = [max(arg, 0) for arg in at_most(fact) if isinstance(arg, int | float)]
        if fact.owner in (None, robot) and deadline_s in numbers:
            return "facts", index
    return ("program",)
