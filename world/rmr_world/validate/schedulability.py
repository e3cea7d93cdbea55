"""What a lab promises of turns and does not keep, told before the run as warnings.

- A bottleneck that nobody passes: the way of no robot leads through it, or no drive serves a time assertion.
- A time assertion whose event is never scheduled: no action serves its finish, so its robots take no turns, or nothing
  in program and lab ever makes the fact by which its jobs start.
- A place with less room than the robots that go there need.

Facts also come from Python (handlers, events); where the lab has any, all facts are taken to be possible.
"""

from collections import Counter
from collections.abc import Iterator

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.bytecode.heads import items
from rmr.bytecode.program import Assertion, Atom, Kind, Mode, Program, Rule
from rmr.node.actions.built_in import PROVIDED
from rmr.node.driver import spots
from rmr.node.motion.route import leader_route
from rmr_world.bound import destinations
from rmr_world.document import Problem
from rmr_world.lab import Lab
from rmr_world.validate.first_instant import MOVES, bound_for
from rmr_world.validate.program_fit import PROVIDED as SENSED
from rmr_world.validate.program_fit import problem_at

WAYS_MAX = 200
"""Ways that are planned to find one through the bottleneck; a plan costs a millisecond."""


def unkept(lab: Lab, program: Program) -> list[Problem]:
    """Return a warning for each promise of turns, or of room, that this lab does not keep."""
    return [*_unpassed(lab, program), *_unscheduled(lab, program), *_crowded(lab, program)]


# Room


def _crowded(lab: Lab, program: Program) -> Iterator[Problem]:
    stands_at_end = lab.finish_pattern is not None and lab.finish_pattern.name == "at"
    if any(_drives(program, each) for each in program.assertions):
        # Robots that go by turns may leave before the next one comes, unless all must stand there to finish.
        goals = destinations(lab) if stands_at_end else {}
    else:
        goals = bound_for(lab, program)
        if not stands_at_end and any(_handled(program, each) for each in program.assertions):
            # A handler may drive by turns to the area that `finish` names, and leave it again.
            goals = {robot: area for robot, area in goals.items() if robot not in destinations(lab)}
    for area, robots in Counter(goals.values()).items():
        room = _room(lab, area)
        if room >= robots or (stands_at_end and area.box is None):
            continue  # too few places of the area that `finish` names are an error of their own
        kind = "box" if area.box is not None else "slots" if area.slotted else "at"
        fit = f"{room} robot{'s' if room != 1 else ''} of radius {lab.arena.shape.radius:g} m"
        if area.box is not None and room == 0:
            message = f"warning: no robot of radius {lab.arena.shape.radius:g} m fits into area '{area.name}'"
        else:
            message = f"warning: area '{area.name}' has room for {fit} at a time, and {robots} go there"
        yield problem_at(lab, ("areas", area.name, kind), message)


def _room(lab: Lab, area: Area) -> int:
    """Return how many robots can stand in `area` at a time."""
    if area.box is None:
        return len(area.places)
    return sum(lab.arena.clearance(*place) > lab.arena.shape.radius for place in spots(lab.arena, area))


# The bottleneck


def _unpassed(lab: Lab, program: Program) -> Iterator[Problem]:
    if not lab.arena.bottleneck:
        return
    if not any(_drives(program, each) for each in program.assertions):
        why = f"no {MOVES} serves a time assertion of the program, so robots pass it without turns"
        yield problem_at(lab, ("bottleneck",), f"warning: the bottleneck is of no use: {why}")
    elif not _passed(lab):
        between = " and ".join(f"'{name}'" for name in lab.arena.bottleneck)
        why = f"no way of a robot to an area leads through {between}; nothing is passed in turns there"
        yield problem_at(lab, ("bottleneck",), f"warning: nobody passes the bottleneck: {why}")


def _drives(program: Program, assertion: Assertion) -> bool:
    return assertion.scheduled and any(program.predicates[each.action].name == MOVES for each in assertion.serving)


def _handled(program: Program, assertion: Assertion) -> bool:
    actions = [program.predicates[each.action].name for each in assertion.serving]
    return assertion.scheduled and any(name not in PROVIDED for name in actions)


def _passed(lab: Lab) -> bool:
    """Return whether a way from where a robot starts, or from an area, to an area leads through the bottleneck."""
    arena = lab.arena
    goals = [area.places[0] for area in arena.areas if area.name not in arena.bottleneck]
    starts = [Point(robot.pose.x, robot.pose.y) for robot in lab.robots]
    ways = [(start, goal) for start in (*starts[:1], *starts[-1:], *goals, *starts) for goal in goals if start != goal]
    for start, goal in ways[:WAYS_MAX]:
        route = leader_route(arena, start, goal, (), through_gate=True)
        if route is not None and route.gate_m is not None:
            return True
    return len(ways) > WAYS_MAX


# Time assertions


def _unscheduled(lab: Lab, program: Program) -> Iterator[Problem]:
    scheduled = [(number, each) for number, each in enumerate(program.assertions) if each.scheduled]
    possible = _possible(lab, program) if scheduled else set()
    for number, assertion in scheduled:
        if assertion.start.predicate not in possible:
            start = program.predicates[assertion.start.predicate].name
            lacking = _lacking(program, assertion.start.predicate, possible)
            facts = ", ".join(f"'{program.predicates[index].name}'" for index in lacking)
            why = f"nothing makes a fact {facts}" + ("" if facts == f"'{start}'" else f", so there is no '{start}'")
            message = f"warning: the time assertion {assertion.name} never starts: {why}; state it under facts"
        elif not assertion.serving:
            finish = program.predicates[assertion.finish.predicate].name
            why = f"no action leads to its finish '{finish}'; if only the deadline matters, write watch"
            message = f"warning: the event of the time assertion {assertion.name} is never scheduled: {why}"
        else:
            continue
        yield _at_assertion(lab, program, number, message)


def _at_assertion(lab: Lab, program: Program, number: int, message: str) -> Problem:
    places = program.debug.assertions if program.debug is not None else ()
    if number >= len(places):
        return problem_at(lab, ("program",), message)
    place = places[number]
    return Problem(place.file, place.line, place.column, "", message)


def _possible(lab: Lab, program: Program) -> set[int]:
    """Return the predicates of which there may ever be a fact, and the actions that may be derived."""
    predicates = program.predicates
    own_actions = any(p.kind is Kind.ACTION and p.name not in PROVIDED for p in predicates)
    if own_actions or lab.actions is not None or lab.events is not None:
        return set(range(len(predicates)))
    stated = {program.index(fact.name) for fact in lab.stated_facts}
    outside = {i for i, p in enumerate(predicates) if p.kind is Kind.SENSED or p.provided or p.name in SENSED}
    found = {fact.predicate for fact in program.facts} | outside | {index for index in stated if index is not None}
    while True:
        more = {index for rule in program.rules if _may_fire(rule, found) for index in _derived(rule)}
        more |= {each.violation.predicate for each in program.assertions if each.start.predicate in found}
        actions = [predicates[index] for index in found | more if predicates[index].kind is Kind.ACTION]
        more |= {effect.predicate for each in actions for effect in (*each.effects, *each.else_effects)}
        if more <= found:
            return found
        found |= more


def _may_fire(rule: Rule, possible: set[int]) -> bool:
    return all(index in possible for index in _premises(rule))


def _premises(rule: Rule) -> list[int]:
    return [atom.predicate for atom in rule.body if isinstance(atom, Atom) and atom.mode is not Mode.ABSENT]


def _derived(rule: Rule) -> list[int]:
    return [item.predicate for item in items(rule.head)]


def _lacking(program: Program, predicate: int, possible: set[int]) -> list[int]:
    """Return the facts that nothing at all makes, by which `predicate` is not possible."""
    found: dict[int, None] = {}
    looked: set[int] = set()
    waiting = [predicate]
    while waiting:
        index = waiting.pop()
        if index in looked or index in possible:
            continue
        looked.add(index)
        makers = [rule for rule in program.rules if index in _derived(rule)]
        waiting += [premise for rule in makers for premise in _premises(rule)]
        if not makers:
            found[index] = None
    return list(found) or [predicate]
