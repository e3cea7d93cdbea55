"""Uses of areas in a program: every constant of the symbol type `area`, with its place in the source.

The compiler cannot know which areas exist, for the lab defines them. Searched are arguments declared (or inferred) as
`area` in initial facts, goals, rules, effects and assertions, and comparisons of a variable of that type with a
constant.
"""

from collections.abc import Iterable, Iterator

from rmr.base.record import record
from rmr.base.values import Symbol
from rmr.bytecode.heads import folds, inner, items
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    Assertion,
    Atom,
    Base,
    Bind,
    Code,
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

AREA = "area"
"""The symbol type whose members the lab defines."""
LINEUP = "lineup"
"""The provided action that needs the queue of the area in its argument."""


@record
class AreaUse:
    """A constant of type `area` in the program or in a fact of the lab."""

    area: str
    where: str
    """The construct that holds it, in words for a message."""
    place: Place | None
    """In the source; None without debug information."""
    needs_queue: bool = False


def area_uses(program: Program) -> Iterator[AreaUse]:
    """Yield every use of an area in `program`."""
    walker = _AreaFinder(program)
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


def areas_in_fact(program: Program, predicate: int, args: Iterable[object]) -> Iterator[AreaUse]:
    """Yield the uses of areas among the arguments of a fact of the lab."""
    return _AreaFinder(program).values(predicate, args, "", None)


class _AreaFinder:
    """Finds constants in arguments of type `area`."""

    def __init__(self, program: Program) -> None:
        self._program = program

    def values(self, predicate: int, args: Iterable[object], where: str, place: Place | None) -> Iterator[AreaUse]:
        """Yield the areas among plain arguments."""
        found = self._program.predicates[predicate]
        queue = found.kind is Kind.ACTION and found.name == LINEUP
        for wanted, value in zip(found.types, args, strict=False):
            yield from (AreaUse(area, where, place, queue) for area in _members(wanted, value))

    def codes(self, predicate: int, codes: Iterable[Code], where: str, place: Place | None) -> Iterator[AreaUse]:
        """Yield the areas among arguments that are a single constant."""
        values = [code[0].operand if len(code) == 1 and code[0].op is Op.CONST else None for code in codes]
        yield from self.values(predicate, values, where, place)

    def patterns(self, predicate: int, args: Iterable[Pattern], where: str, place: Place | None) -> Iterator[AreaUse]:
        """Yield the areas among patterns."""
        values = [arg.value if isinstance(arg, Constant) else None for arg in args]
        yield from self.values(predicate, values, where, place)

    def rule(self, rule: Rule, where: str, place: Place | None) -> Iterator[AreaUse]:
        """Yield the areas of a rule."""
        slots = self._area_slots(rule.body, set())
        yield from self._body(rule.body, slots, where, place)
        for fold in folds(rule.body):
            yield from self._body(fold.body, self._area_slots(fold.body, slots), where, place)
        for head in rule.head:
            yield from self._head(head, slots, where, place)

    def assertion(self, assertion: Assertion, place: Place | None) -> Iterator[AreaUse]:
        """Yield the areas of a time assertion."""
        where = f"in the time assertion {assertion.name}"
        for atom in (assertion.start, assertion.finish):
            yield from self.patterns(atom.predicate, atom.args, where, place)
        yield from self.codes(assertion.violation.predicate, assertion.violation.args, where, place)

    def _head(self, head: Head, slots: set[int], where: str, place: Place | None) -> Iterator[AreaUse]:
        for part in inner((head,)):
            yield from self._body(part.body, self._area_slots(part.body, slots), where, place)
        for item in items((head,)):
            what = f"in a goal {where}" if isinstance(item, DeriveGoal) else where
            yield from self.codes(item.predicate, item.args, what, place)

    def _body(self, body: Iterable[Conjunct], slots: set[int], where: str, place: Place | None) -> Iterator[AreaUse]:
        for conjunct in body:
            if isinstance(conjunct, Atom):
                yield from self.patterns(conjunct.predicate, conjunct.args, where, place)
            elif isinstance(conjunct, Guard):
                yield from (AreaUse(area, where, place) for area in _compared(conjunct.code, slots))
            elif isinstance(conjunct, Bind):
                yield from (AreaUse(area, where, place) for area in _bound(conjunct, slots))

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
