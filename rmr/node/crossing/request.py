"""Where the action that serves a job leads: the goal of the job's crossing, as far as the job determines it."""

from collections.abc import Callable, Iterable

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point
from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.program import Anything, Constant, Kind, Program, Serving, Slot
from rmr.node.actions.job_steps import serves
from rmr.vm.job import TimedJob


def goal_of(program: Program, arena: Arena, drives_to_area: Callable[[int], bool], job: TimedJob) -> Area | None:
    """Return the area to which a serving action of `job` drives; None where the action itself has to say it."""
    for serving in program.assertions[job.assertion].serving:
        area = area_among(arena, known_arguments(serving, job)) if drives_to_area(serving.action) else None
        if area is not None:
            return area
    return None


def area_among(arena: Arena, values: Iterable[Value]) -> Area | None:
    """Return the first of `values` that is an area."""
    areas = (arena.area(value) for value in values if isinstance(value, Symbol))
    return next((area for area in areas if area is not None), None)


def goal_among(area: Area | None, goal: Point) -> Area:
    """Return `area` if `goal` is one of its places, else a place of its own: where a drive leads."""
    return area if area is not None and goal in area.places else Area("", (goal,))


def known_arguments(serving: Serving, job: TimedJob) -> list[Value]:
    """Return the arguments of a serving action that the job determines."""
    known: list[Value] = []
    for pattern in serving.args:
        match pattern:
            case Constant(value=value):
                known.append(value)
            case Slot(index=index):
                bound = job.bindings[index]
                if bound is not None:
                    known.append(bound)
            case Anything():
                pass
    return known


def may_drive(program: Program, drives_to_area: Callable[[int], bool], job: TimedJob) -> bool:
    """Return whether an action that serves `job`, or a later one of whose chain does, may drive to an area."""
    actions = (index for index, each in enumerate(program.predicates) if each.kind is Kind.ACTION)
    return any(drives_to_area(action) and serves(program, job, action) for action in actions)


def without_deadline(now: Instant, robot: int, name: str) -> TimedJob:
    """Return what stands for the job of a drive that serves none: it is due never, and belongs to no assertion."""
    owner = Robot(robot)
    return TimedJob(0, -1, name, name, name, now, NEVER, (owner,), owner)
