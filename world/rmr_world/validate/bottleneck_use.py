"""Phase 4, use of the bottleneck: robots pass it, and pass it in turns."""

from collections.abc import Iterator

from rmr.base.geometry import Point
from rmr.bytecode.program import Program
from rmr.node.motion.route import leader_route
from rmr_world.finding import Finding
from rmr_world.lab import Lab
from rmr_world.validate.first_instant import MOVETO
from rmr_world.validate.schedulability import served_by_moveto

ROUTES_MAX = 200
"""Routes that are planned to find one through the bottleneck; a plan takes about a millisecond."""


def bottleneck_without_turns(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a bottleneck that robots pass without turns, since no drive serves a time assertion."""
    if lab.arena.bottleneck and not _has_turns(program):
        why = f"no {MOVETO} serves a time assertion of the program, so robots pass it without turns"
        yield lab.warning(("bottleneck",), f"the bottleneck is of no use: {why}")


def bottleneck_not_passed(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a bottleneck that lies on no robot's route."""
    if lab.arena.bottleneck and _has_turns(program) and not _passed(lab):
        between = " and ".join(f"'{name}'" for name in lab.arena.bottleneck)
        why = f"no way of a robot to an area leads through {between}; nothing is passed in turns there"
        yield lab.warning(("bottleneck",), f"nobody passes the bottleneck: {why}")


CHECKS = (bottleneck_without_turns, bottleneck_not_passed)
"""The rules of the bottleneck."""


def _has_turns(program: Program) -> bool:
    return any(served_by_moveto(program, each) for each in program.assertions)


def _passed(lab: Lab) -> bool:
    """Return whether a route from a robot's start, or from an area, to an area leads through the bottleneck.

    Also True when there are more than ROUTES_MAX routes and the first ones do not pass it.
    """
    arena = lab.arena
    goals = [area.places[0] for area in arena.areas if area.name not in arena.bottleneck]
    starts = [Point(robot.pose.x, robot.pose.y) for robot in lab.robots]
    # The first and the last robot come first: they often stand on different sides.
    origins = (*starts[:1], *starts[-1:], *goals, *starts)
    trips = [(start, goal) for start in origins for goal in goals if start != goal]
    for start, goal in trips[:ROUTES_MAX]:
        route = leader_route(arena, start, goal, (), through_gate=True)
        if route is not None and route.gate_m is not None:
            return True
    return len(trips) > ROUTES_MAX
