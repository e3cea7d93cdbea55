"""Phase 4, exclusion: what robots do without excluding each other, and passages that nobody passes by turns.

An event of a time assertion excludes its own jobs from each other: in the bottleneck if their drives pass that, else
for their whole drives. Passages with names of their own exclude all that drive through. These rules warn where that
leaves robots of a scheduled assertion without turns.
"""

from collections.abc import Iterable, Iterator
from itertools import combinations

from rmr.base.arena import BOTTLENECK, Arena, FloorPassage, found_passage
from rmr.base.geometry import Point
from rmr.bytecode.program import Assertion, Program
from rmr.node.motion.astar import plan
from rmr.node.motion.route import leader_route, make_route
from rmr_world.finding import FilePath, Finding
from rmr_world.found_passages import NearEnds, too_near
from rmr_world.lab import Lab
from rmr_world.narrow_places import narrow_places, side_by_side_m
from rmr_world.passage_use import (
    FirstDrive,
    PassageUse,
    first_drives,
    is_in_narrow,
    named_passages,
    passage_uses,
    passages_on,
)
from rmr_world.validate.first_instant import MOVETO
from rmr_world.validate.schedulability import served_by_moveto


def passage_not_exclusive(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a narrow passage that robots of a scheduled assertion pass without turns that cover it."""
    if lab.arena.has_shared_passages:
        yield from _without_name(lab, program)
        return
    if not any(served_by_moveto(program, each) for each in program.assertions):
        return
    if any(drive.job is not None for drive in first_drives(lab, program)):
        for use in passage_uses(lab, program):
            yield from _several_events(lab, use)
            if use.named is None:
                yield from _turns_elsewhere(lab, use)


def passage_without_room(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a narrow passage that robots pass without turns, since none could wait before it."""
    chosen_none = ("passages",) in lab.places and not lab.arena.passages
    if chosen_none or lab.arena.passage(BOTTLENECK) is not None:
        return
    for use in passage_uses(lab, program):
        near = _too_near(lab, use) if _meet(use.drives) else None
        if near is not None:
            message = (
                f"{_where(use)} has no turns, so robots meet in it: it ends {near.gap_m:.2f} m from another one, and "
                f"robots that wait between two need {near.apart_m:.2f} m; leave that room, or make the shorter one "
                f"{side_by_side_m(lab.arena.shape.radius):.2f} m wide, so that two robots pass"
            )
            yield lab.warning(_path(use), message)


def turn_cut_to_bottleneck(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a turn that the key of a passage cuts short: it ends before further actions of the turn begin."""
    named = named_passages(lab.arena)
    for assertion in program.assertions if named else ():
        further = _further_actions(program, assertion)
        if not further or not served_by_moveto(program, assertion):
            continue
        drive = next((each for each in first_drives(lab, program) if _cut_short(lab, program, each, assertion)), None)
        if drive is not None:
            actions = " and ".join(further)
            found = named[0].found
            remedy = "write passages: {} for none" if found else "name no area here that such a drive passes"
            message = (
                f"a turn of {_told(drive.event)} is a passage of {_named(drive)} and ends behind it, since the drive "
                f"of robot {drive.robot} to '{drive.goal.name}' passes it: {actions}, which waits for the turn too, "
                f"excludes nobody; {remedy}, or make {actions} an event of its own"
            )
            yield lab.warning(named[0].path, message)


def _several_events(lab: Lab, use: PassageUse) -> Iterator[Finding]:
    """Warn of a passage for which robots with jobs of different events contend."""
    events = use.events
    if len(events) > 1 and _meet(use.drives):
        parties = " and ".join(f"{_robots(use.drives, event)} ({_told(event)})" for event in events)
        message = (
            f"{_where(use)} is not exclusive: {parties} pass it, and an event excludes its own jobs only; leave out of "
            f"the assertion's finish fact what tells them apart, or let one assertion hold all of these drives"
        )
        yield lab.warning(_path(use), message)


def _without_name(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of narrow passages without a name beside passages that have one and take turns."""
    for use in passage_uses(lab, program):
        if use.named is None and _meet(use.drives) and _too_near(lab, use) is None:
            message = (
                f"{_where(use)} is not exclusive: drives go through it without turns; name its ends under passages"
            )
            yield lab.warning(_path(use), message)


def _turns_elsewhere(lab: Lab, use: PassageUse) -> Iterator[Finding]:
    """Warn of a passage without a name that drives pass whose turn is a passage of another one."""
    gated = [drive for drive in use.drives if drive.gated]
    if gated and _meet(gated):
        others = " and ".join(f"'{each.name}'" for each in named_passages(lab.arena))
        message = (
            f"{_where(use)} is not exclusive: the turns of {_robots(gated, gated[0].event)} ({_told(gated[0].event)}) "
            f"cover {others} only; areas at the outer ends of both, named under bottleneck.mouths, let one turn "
            f"cover both"
        )
        yield lab.warning(_path(use), message)


def _meet(drives: Iterable[FirstDrive]) -> bool:
    """Return whether there are two robots, which can meet in a passage."""
    return len({drive.robot for drive in drives}) > 1


def _too_near(lab: Lab, use: PassageUse) -> NearEnds | None:
    """Return the ends of a passage without turns and of another one between which there is no room to wait."""
    if use.named is not None:
        return None
    own, *others = (
        found_passage(each.name, each.ends)
        for each in sorted(narrow_places(lab.arena).passages, key=lambda each: each not in use.narrow)
    )
    near = (each for other in (*others, *lab.arena.passages) for _, _, each in too_near(lab.arena, own, other))
    return min(near, default=None)


def _further_actions(program: Program, assertion: Assertion) -> list[str]:
    names = dict.fromkeys(program.predicates[each.action].name for each in assertion.serving)
    return [name for name in names if name not in (MOVETO, "navigate")] if assertion.scheduled else []


def _cut_short(lab: Lab, program: Program, drive: FirstDrive, assertion: Assertion) -> bool:
    """Return whether the turn by which `drive` goes ends before the robot is at its goal for a further action."""
    own = drive.gated and drive.job is not None and program.assertions[drive.job.assertion] is assertion
    return own and not is_in_narrow(narrow_places(lab.arena), drive.goal.places[0])


def _named(drive: FirstDrive) -> str:
    passage = drive.route.passage
    return "the bottleneck" if passage in (None, BOTTLENECK) else f"'{passage}'"


def _where(use: PassageUse) -> str:
    if use.named is not None:
        return f"the passage '{use.name}'"
    (passage,) = use.narrow
    ends = " and ".join(map(_at, passage.ends))
    return f"the narrow passage between {ends}, {passage.width:.2f} m wide,"


def _path(use: PassageUse) -> FilePath:
    return ("arena",) if use.named is None else use.named.path


def _told(event: str | None) -> str:
    return "without a turn" if event is None else event.removesuffix("()")


def _at(point: Point) -> str:
    return f"[{point.x:.2f}, {point.y:.2f}]"


def _robots(drives: Iterable[FirstDrive], event: str | None) -> str:
    ids = sorted({drive.robot for drive in drives if drive.event == event})
    shown = ", ".join(map(str, ids[:5]))
    more = f" and {len(ids) - 5} more" if len(ids) > 5 else ""
    return f"robot {shown}" if len(ids) == 1 else f"robots {shown}{more}"


# ---- use of the passages that a lab names: robots pass them, and pass the bottleneck in turns

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
    for passage in passages:
        between = " and ".join(f"'{area.name}'" for area in passage.entrances)
        if other := _instead(lab.arena, passage):
            radius = lab.arena.shape.radius
            why = f"between {between} robots of {radius:g} m drive through '{other}', which leaves them more room"
        elif passed is None or passage.name in passed:
            continue
        else:
            why = f"no way of a robot to an area leads through {between}; nothing is passed in turns there"
        if passage.by_event:
            yield lab.warning((BOTTLENECK,), f"nobody passes the bottleneck: {why}")
        else:
            yield lab.warning(("passages", passage.name), f"nobody passes it: {why}")


def _instead(arena: Arena, passage: FloorPassage) -> str | None:
    """Return the name of another passage through which all ways between the mouths of `passage` lead; None: of none."""
    for ends in combinations(passage.mouths, 2):
        found = plan(arena, *ends)
        named = {} if found is None else passages_on(arena, make_route(arena, found.points, through_gate=True))
        if not named or passage.name in named:
            return None
    return next(iter(named)) if len(passage.mouths) > 1 else None


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


CHECKS = (
    passage_not_exclusive,
    turn_cut_to_bottleneck,
    bottleneck_without_turns,
    passage_without_room,
    passage_not_passed,
)
"""The rules of exclusion."""
