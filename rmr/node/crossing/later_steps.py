"""How long the later steps of a chain take: what the deadline of a job leaves for the step that is under way.

The deadline is that of the whole job. A robot that drives to load, and then to where the job ends, must be out of a
passage on its first way so much earlier as loading and the second way take. Drives count at full speed and without
other robots, `wait` counts as its seconds, and other actions as nothing: the least time that is left to be needed.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point
from rmr.base.motion_scale import scale_of
from rmr.base.time import Duration, seconds
from rmr.bytecode.program import Kind, Program
from rmr.node.crossing.request import area_among
from rmr.node.motion.route import leader_route
from rmr.vm.derive import Derived

WAIT: Final = "wait"
"""The provided action that waits, with its seconds as its only argument."""


def time_of(
    program: Program, arena: Arena, drives_to_area: Callable[[int], bool], start: Point, steps: Sequence[Derived]
) -> Duration:
    """Return the least time that `steps` take a robot that is at `start` when the first of them begins."""
    total: Duration = 0
    for step in steps:
        predicate = program.predicates[step.predicate]
        if predicate.kind is not Kind.ACTION:
            continue
        area = area_among(arena, step.args) if drives_to_area(step.predicate) else None
        if area is not None:
            total += seconds(_drive_s(arena, start, area.places[0]))
            start = area.places[0]
        elif predicate.name == WAIT:
            total += seconds(max([0.0, *(float(arg) for arg in step.args if isinstance(arg, (int, float)))]))
    return total


@lru_cache(maxsize=256)
def _drive_s(arena: Arena, start: Point, goal: Point) -> float:
    """Return the least time of a drive, seconds; 0 without a way."""
    route = leader_route(arena, start, goal, (), through_gate=False)
    return 0.0 if route is None else route.length_m / arena.shape.speed + scale_of(arena.shape).start_s
