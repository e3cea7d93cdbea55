"""Whether a lab and its program fit: areas that the program uses, facts and finish that the lab states.

An area is a symbol of the type `area`, so the compiler cannot know which ones exist; the lab does. Checked is every
constant in an argument declared (or inferred) as `area`, in initial facts, goals, rules, effects and assertions, and
every comparison of a variable of that type with a constant.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.heads import items
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    Aggregate,
    Assertion,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveGoal,
    Guard,
    Head,
    Kind,
    Pattern,
    Place,
    Program,
    Rule,
    Slot,
    Type,
)
from rmr.bytecode.provided import PREDICATES
from rmr_world.document import Path_, Problem
from rmr_world.lab import Lab
from rmr_world.ranges import Range, StatedFact
from rmr_world.schema import near_miss

AREA = "area"
"""The symbol type whose members the lab defines."""
PROVIDED = tuple(PREDICATES)
"""Facts that a robot states whether or not the program mentions them."""
QUEUES = "lineup"
"""The provided action that needs the queue of the area it names."""


@dataclass(frozen=True, slots=True)
class _Use:
    """A constant of type `area` somewhere in the program."""

    area: str
    where: str
    place: Place | None
    queue: bool = False


def check_program(lab: Lab, program: Program) -> list[Problem]:
    """Return what in `program` does not fit `lab`, and what in `lab` does not fit `program`."""
    problems = [*_areas(lab, program), *_facts(lab, program), *_finish(lab, program)]
    return list(dict.fromkeys(problems))


def areas_used(program: Program) -> list[tuple[str, bool]]:
    """Return the areas that `program` names, and of each use whether it needs the area's queue."""
    return [(use.area, use.queue) for use in _uses(program)]


def problem_at(lab: Lab, path: Path_, message: str) -> Problem:
    """Return a problem with what stands at `path` of the lab's file, or in the section that it belongs to."""
    line, column = lab.places.get(path, lab.places.get(path[:1], (1, 1)))
    return Problem(str(lab.path), line, column, ".".join(map(str, path)), message)


# The lab's facts and finish


def _facts(lab: Lab, program: Program) -> Iterator[Problem]:
    for fact, index in zip(lab.stated_facts, lab.fact_items or count(), strict=False):
        message = _misfit(fact, program)
        if message:
            yield problem_at(lab, ("facts", index), message)
            continue
        for use in _Walker(program).values(program.index(fact.name) or 0, fact.args, "", None):
            if lab.arena.area(use.area) is None:
                hint = near_miss(use.area, _area_names(lab))
                yield problem_at(lab, ("facts", index), f"area '{use.area}' is not defined{hint}")


def _misfit(fact: StatedFact, program: Program) -> str:
    """Return why the program cannot hold `fact`, or nothing."""
    known = program.index(fact.name)
    if known is None:
        names = [p.name for p in program.predicates if p.kind is not Kind.ACTION]
        return f"the program knows no fact '{fact.name}'{near_miss(fact.name, names)}"
    predicate = program.predicates[known]
    if predicate.kind is Kind.ACTION:
        return f"'{fact.name}' is an action, not a fact"
    if len(predicate.types) != len(fact.args):
        return _arity(fact.name, len(predicate.types) + 1, len(fact.args) + 1)
    for position, (wanted, value) in enumerate(zip(predicate.types, fact.args, strict=True), start=2):
        if not _fits(wanted, value):
            return f"argument {position} of '{fact.name}' should be {_type_name(wanted)}"
    return ""


def _arity(name: str, wanted: int, given: int) -> str:
    return f"'{name}' has {wanted} argument{'s' if wanted > 1 else ''} in the program, here {given}"


def _fits(wanted: Type, value: Value | Range) -> bool:
    """Return whether `value` may be an argument of type `wanted`; an int is also a float."""
    if isinstance(value, Range):
        value = 0 if value.whole else 0.0
    match wanted.base:
        case Base.ROBOT:
            return isinstance(value, Robot)
        case Base.INT:
            return type(value) is int
        case Base.FLOAT:
            return type(value) in {int, float}
        case Base.BOOL:
            return isinstance(value, bool)
        case Base.STRING:
            return isinstance(value, str) and not isinstance(value, Symbol)
        case Base.SYMBOL:
            return isinstance(value, Symbol)
        case Base.LIST:
            inner = wanted.element
            return isinstance(value, tuple) and (inner is None or all(_fits(inner, item) for item in value))
        case Base.OPEN:
            return True


def _type_name(wanted: Type) -> str:
    if wanted.base is Base.LIST and wanted.element is not None:
        return f"list {_type_name(wanted.element)}"
    return wanted.name or wanted.base.name.lower()


def _finish(lab: Lab, program: Program) -> Iterator[Problem]:
    pattern = lab.finish_pattern
    if pattern is None:
        return
    known = program.index(pattern.name)
    if known is None and pattern.name in PROVIDED:
        return
    if known is None or program.predicates[known].kind is Kind.ACTION:
        names = [p.name for p in program.predicates if p.kind is not Kind.ACTION]
        hint = near_miss(pattern.name, names)
        yield problem_at(lab, ("finish",), f"the program knows no fact '{pattern.name}'{hint}")
        return
    types = program.predicates[known].types
    if len(types) != len(pattern.patterns):
        yield problem_at(lab, ("finish",), _arity(pattern.name, len(types) + 1, len(pattern.patterns) + 1))


# Areas


def _areas(lab: Lab, program: Program) -> Iterator[Problem]:
    names = _area_names(lab)
    for use in _uses(program):
        area = lab.arena.area(use.area)
        known = f" in {lab.path}" if use.place is not None else ""
        if area is None:
            message = f"area '{use.area}', used {use.where}, is not defined{known}{near_miss(use.area, names)}"
        elif use.queue and not area.queue:
            message = f"area '{use.area}' has no queue{known}, which {QUEUES} {use.where} needs"
        else:
            continue
        if use.place is not None:
            yield Problem(use.place.file, use.place.line, use.place.column, "", message)
        else:
            yield problem_at(lab, ("program",), message)


def _area_names(lab: Lab) -> list[str]:
    return sorted(area.name for area in lab.arena.areas)


def _uses(program: Program) -> Iterator[_Use]:
    """Yield every constant area of the program."""
    walker = _Walker(program)
    for fact in program.facts:
        yield from walker.values(fact.predicate, fact.args, "in a fact", None)
    for goal in program.goals:
        yield from walker.patterns(goal.predicate, goal.args, "in a goal", None)
    debug = program.debug
    rule_places = debug.rules if debug else ()
    for number, rule in enumerate(program.rules):
        place = rule_places[number] if number < len(rule_places) else None
        yield from walker.rule(rule, f"in rule {number + 1}", place)
    assertion_places = debug.assertions if debug else ()
    for number, assertion in enumerate(program.assertions):
        place = assertion_places[number] if number < len(assertion_places) else None
        yield from walker.assertion(assertion, place)
    for predicate in program.predicates:
        for effect in (*predicate.effects, *predicate.else_effects):
            yield from walker.codes(effect.predicate, effect.args, f"in an effect of {predicate.name}", None)


class _Walker:
    """Finds constants in arguments of type `area`."""

    def __init__(self, program: Program) -> None:
        self._program = program

    def values(self, predicate: int, args: Iterable[object], where: str, place: Place | None) -> Iterator[_Use]:
        """Yield the areas among plain arguments."""
        found = self._program.predicates[predicate]
        queue = found.kind is Kind.ACTION and found.name == QUEUES
        for wanted, value in zip(found.types, args, strict=False):
            yield from (_Use(area, where, place, queue) for area in _members(wanted, value))

    def codes(self, predicate: int, codes: Iterable[Code], where: str, place: Place | None) -> Iterator[_Use]:
        """Yield the areas among arguments that are a single constant."""
        values = [code[0].operand if len(code) == 1 and code[0].op is Op.CONST else None for code in codes]
        yield from self.values(predicate, values, where, place)

    def patterns(self, predicate: int, args: Iterable[Pattern], where: str, place: Place | None) -> Iterator[_Use]:
        """Yield the areas among patterns."""
        values = [arg.value if isinstance(arg, Constant) else None for arg in args]
        yield from self.values(predicate, values, where, place)

    def rule(self, rule: Rule, where: str, place: Place | None) -> Iterator[_Use]:
        """Yield the areas of a rule."""
        slots = self._area_slots(rule.body, set())
        yield from self._body(rule.body, slots, where, place)
        for head in rule.head:
            yield from self._head(head, slots, where, place)

    def assertion(self, assertion: Assertion, place: Place | None) -> Iterator[_Use]:
        """Yield the areas of a time assertion."""
        where = f"in the time assertion {assertion.name}"
        for atom in (assertion.start, assertion.finish):
            yield from self.patterns(atom.predicate, atom.args, where, place)
        yield from self.codes(assertion.violation.predicate, assertion.violation.args, where, place)

    def _head(self, head: Head, slots: set[int], where: str, place: Place | None) -> Iterator[_Use]:
        if isinstance(head, Comprehension | Aggregate):
            inner = self._area_slots(head.body, slots)
            yield from self._body(head.body, inner, where, place)
        for item in items((head,)):
            what = f"in a goal {where}" if isinstance(item, DeriveGoal) else where
            yield from self.codes(item.predicate, item.args, what, place)

    def _body(self, body: Iterable[Conjunct], slots: set[int], where: str, place: Place | None) -> Iterator[_Use]:
        for conjunct in body:
            if isinstance(conjunct, Atom):
                yield from self.patterns(conjunct.predicate, conjunct.args, where, place)
            elif isinstance(conjunct, Guard):
                yield from (_Use(area, where, place) for area in _compared(conjunct.code, slots))
            elif isinstance(conjunct, Bind):
                yield from (_Use(area, where, place) for area in _bound(conjunct, slots))

    def _area_slots(self, body: Iterable[Conjunct], known: set[int]) -> set[int]:
        """Return the slots that hold an area: `known` and those that an atom of `body` binds to one."""
        slots = set(known)
        for conjunct in body:
            if isinstance(conjunct, Atom):
                types = self._program.predicates[conjunct.predicate].types
                for wanted, arg in zip(types, conjunct.args, strict=False):
                    if isinstance(arg, Slot) and wanted.base is Base.SYMBOL and wanted.name == AREA:
                        slots.add(arg.index)
        return slots


def _members(wanted: Type, value: object) -> Iterator[str]:
    """Yield the areas that `value`, of type `wanted`, names: itself or, in a list, its items."""
    if wanted.base is Base.LIST and wanted.element is not None and isinstance(value, tuple):
        for item in value:
            yield from _members(wanted.element, item)
    elif wanted.base is Base.SYMBOL and wanted.name == AREA and isinstance(value, Symbol):
        yield str(value)


def _compared(code: Code, slots: set[int]) -> Iterator[str]:
    """Yield the constants that `code` compares with a slot of `slots`."""
    for a, b, c in zip(code, code[1:], code[2:], strict=False):
        if c.op in {Op.EQ, Op.NE}:
            for load, const in ((a, b), (b, a)):
                if load.op is Op.LOAD and load.operand in slots and const.op is Op.CONST:
                    yield from [str(const.operand)] if isinstance(const.operand, Symbol) else []


def _bound(bind: Bind, slots: set[int]) -> Iterator[str]:
    """Yield the constant that `bind` gives to a slot of `slots`."""
    if bind.slot in slots and len(bind.code) == 1 and isinstance(bind.code[0].operand, Symbol):
        yield str(bind.code[0].operand)
