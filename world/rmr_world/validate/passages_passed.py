"""Phase 4, use of the passages that a lab names: robots pass them, and pass the bottleneck in turns."""

from collections.abc import Iterator

from rmr.base.arena import BOTTLENECK
from rmr.base.geometry import Point
from rmr.bytecode.program import Program
from rmr.node.motion.route import leader_route
from rmr_world.finding import Finding
from rmr_world.lab import Lab
from rmr_world.passage_use import passages_on
from rmr_world.validate.first_instant import MOVETO
from rmr_world.validate.schedulability import served_by_moveto

ROUTES_MAX = 200
"""Routes that are planned to find one through each passage; a plan takes about a millisecond."""


def bottleneck_without_turns(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a bottleneck that robots pass without turns, since no drive serves a time assertion."""
    if lab.arena.passage(BOTTLENECK) is not None and not _has_turns(program):
        why = f"no {MOVETO} serves a time assertion of the program, so robots pass it without turns"
        yield lab.warning(("bottleneck",), f"the bottleneck is of no use: {why}")


def passage_not_passed(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a passage that lies on no robot's route."""
    passages = [each for each in lab.arena.passages if not each.found and (not each.by_event or _has_turns(program))]
    passed = _passed(lab) if passages else None
    if passed is None:
        return
    for passage in [each for each in passages if each.name not in passed]:
        between = " and ".join(f"'{area.name}'" for area in passage.entrances)
        why = f"no way of a robot to an area leads through {between}; nothing is passed in turns there"
        if passage.by_event:
            yield lab.warning((BOTTLENECK,), f"nobody passes the bottleneck: {why}")
        else:
            yield lab.warning(("passages", passage.name), f"nobody passes it: {why}")


CHECKS = (bottleneck_without_turns, passage_not_passed)
"""The rules of use of the passages."""


def _has_turns(program: Program) -> bool:
    return any(served_by_moveto(program, each) for each in program.assertions)


def _passed(lab: Lab) -> set[str] | None:
    """Return the passages that a route from a robot's start, or from an area, to an area leads through.

    None when there are more than ROUTES_MAX routes and the first ones do not pass all of them.
    """
    arena = lab.arena
    entrances = {area.name for passage in arena.passages for area in passage.entrances}
    goals = [area.places[0] for area in arena.areas if area.name not in entrances]
    starts = [Point(robot.pose.x, robot.pose.y) for robot in lab.robots]
    # The first and the last robot come first: they often stand on different sides.
    origins = (*starts[:1], *starts[-1:], *goals, *starts)
    trips = [(start, goal) for start in origins for goal in goals if start != goal]
    found: set[str] = set()
    for start, goal in trips[:ROUTES_MAX]:
        route = leader_route(arena, start, goal, (), through_gate=True)
        if route is not None:
            found |= passages_on(arena, route).keys()
        if len(found) == len(arena.passages):
            return found
    return None if len(trips) > ROUTES_MAX else found
