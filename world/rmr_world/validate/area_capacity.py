"""Phase 4, feasibility of space: an area has room for the robots that go there."""

from collections import Counter
from collections.abc import Iterator

from rmr.base.arena import Area
from rmr.bytecode.program import Program
from rmr.node.driver import spots
from rmr_world.bound import destinations
from rmr_world.finding import Finding
from rmr_world.lab import Lab
from rmr_world.validate.first_instant import first_destinations
from rmr_world.validate.schedulability import served_by_handler, served_by_moveto


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


CHECKS = (area_too_small,)
"""The rules of room."""


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
