"""Phase 4, schedulability of time assertions: each one can start, and an action leads to its finish.

Facts also come from Python (handlers, events). Where the lab has any, all facts are taken to be possible.
"""

from collections.abc import Iterator

from rmr.bytecode.heads import items
from rmr.bytecode.program import Assertion, Atom, Kind, Mode, Program, Rule
from rmr.node.actions.built_in import PROVIDED
from rmr_world.finding import Finding
from rmr_world.lab import Lab
from rmr_world.validate.first_instant import MOVETO
from rmr_world.validate.program_fit import PROVIDED_FACTS


def assertion_never_starts(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a time assertion whose start fact nothing in program and lab can make."""
    scheduled = _scheduled(program)
    possible = _possible_predicates(lab, program) if scheduled else set()
    for number, assertion in scheduled:
        if assertion.start.predicate in possible:
            continue
        start = program.predicates[assertion.start.predicate].name
        missing = _missing_premises(program, assertion.start.predicate, possible)
        facts = ", ".join(f"'{program.predicates[index].name}'" for index in missing)
        why = f"nothing makes a fact {facts}" + ("" if facts == f"'{start}'" else f", so there is no '{start}'")
        message = f"the time assertion {assertion.name} never starts: {why}; state it under facts"
        yield _at_assertion(lab, program, number, message)


def assertion_never_scheduled(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a time assertion that starts and that no action serves: its robots take no turns."""
    scheduled = _scheduled(program)
    possible = _possible_predicates(lab, program) if scheduled else set()
    for number, assertion in scheduled:
        if assertion.serving or assertion.start.predicate not in possible:
            continue
        finish = program.predicates[assertion.finish.predicate].name
        why = f"no action leads to its finish '{finish}'; if only the deadline matters, write watch"
        message = f"the event of the time assertion {assertion.name} is never scheduled: {why}"
        yield _at_assertion(lab, program, number, message)


CHECKS = (assertion_never_starts, assertion_never_scheduled)
"""The rules of time assertions."""


def served_by_moveto(program: Program, assertion: Assertion) -> bool:
    """Return whether the assertion is scheduled and a drive to an area serves it: robots pass a bottleneck in turns."""
    served_by = [program.predicates[each.action].name for each in assertion.serving]
    return assertion.scheduled and any(name in (MOVETO, "navigate") for name in served_by)


def served_by_handler(program: Program, assertion: Assertion) -> bool:
    """Return whether the assertion is scheduled and an action of the user's own serves it."""
    actions = [program.predicates[each.action].name for each in assertion.serving]
    return assertion.scheduled and any(name not in PROVIDED for name in actions)


def _scheduled(program: Program) -> list[tuple[int, Assertion]]:
    return [(number, each) for number, each in enumerate(program.assertions) if each.scheduled]


def _at_assertion(lab: Lab, program: Program, number: int, message: str) -> Finding:
    """Return a warning at an assertion: in the program's source if that is known, else in the lab file."""
    places = program.debug.assertions if program.debug is not None else ()
    if number >= len(places):
        return lab.warning(("program",), message)
    place = places[number]
    return Finding(place.file, place.line, place.column, "", message, is_warning=True)


def _possible_predicates(lab: Lab, program: Program) -> set[int]:
    """Return the predicates with a fact in some run and the actions derived in some run: a fixed point over the rules.

    Conditions other than the presence of facts are ignored, so the set may be too large, never too small.
    """
    predicates = program.predicates
    own_actions = any(p.kind is Kind.ACTION and p.name not in PROVIDED for p in predicates)
    if own_actions or lab.actions is not None or lab.events is not None:
        return set(range(len(predicates)))
    stated = {program.index(fact.name) for fact in lab.stated_facts}
    outside = {i for i, p in enumerate(predicates) if p.kind is Kind.SENSED or p.provided or p.name in PROVIDED_FACTS}
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


def _missing_premises(program: Program, predicate: int, possible: set[int]) -> list[int]:
    """Return the predicates that no rule derives and without which `predicate` is not possible."""
    found: dict[int, None] = {}
    visited: set[int] = set()
    waiting = [predicate]
    while waiting:
        index = waiting.pop()
        if index in visited or index in possible:
            continue
        visited.add(index)
        rules = [rule for rule in program.rules if index in _derived(rule)]
        waiting += [premise for rule in rules for premise in _premises(rule)]
        if not rules:
            found[index] = None
    return list(found) or [predicate]
