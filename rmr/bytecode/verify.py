"""Verifier: the static checks that a program passes before any of it runs.

The virtual machine relies on them and does not check again. Indices are in range. Argument lists have the length
that the predicate declares, and constants its types. Slots are bound before they are used. Every expression leaves
exactly one value, and terminates because jumps go forward only. A body consumes temporary facts only. An owner may be
a robot. Properties that depend on values (division by zero, the type of an expression's value) are checked when the
expression is evaluated.

The work is linear in the size of a file: a constant or expression that entries share is examined once.
"""

from collections.abc import Iterator, Sequence
from itertools import islice, pairwise

from rmr.base.values import ROBOT_ID_MAX, Robot
from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.constants import is_name
from rmr.bytecode.limits import exceeded
from rmr.bytecode.part_checks import Checks
from rmr.bytecode.program import (
    SELF,
    SELF_SLOT,
    Aggregate,
    Assertion,
    Base,
    Comprehension,
    Constant,
    Debug,
    Effect,
    Head,
    InitialGoal,
    Kind,
    Lead,
    Mode,
    Operator,
    Pattern,
    Predicate,
    Program,
    Rule,
    Slot,
    Steps,
    Type,
)
from rmr.bytecode.provided import is_provided
from rmr.bytecode.scope import ROBOT, UNKNOWN, Scope

REASONS_MAX = 20
"""Largest number of reasons returned; a forged file may have a million."""

RANK_MAX = 65535
"""Largest rank of a lead, in firings; far beyond the depth of any search for goals."""

PLACE_MAX = (1 << 32) - 1
"""Largest line or column of a place in a source."""


def verify(program: Program) -> list[str]:
    """Return the first reasons to reject `program`, in the order of its tables; none if it is sound."""
    # Limits first: the other checks may rely on bounded sizes.
    excess = islice(exceeded(program), REASONS_MAX)
    too_much = [f"entry {entry} of the {table}: {text}" for table, entry, text in excess]
    return too_much or list(islice(_Verifier(program).reasons(), REASONS_MAX))


class _Verifier:
    """The checks of one program, table by table, as generators of reasons."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.checks = Checks(program.predicates)
        self.names: set[str] = set()
        """Names of the predicates checked so far: a repeated one is an error."""

    def reasons(self) -> Iterator[str]:
        program = self.program
        for index, predicate in enumerate(program.predicates):
            yield from _of(f"predicate {predicate.name or index}", self.predicate(predicate))
        for index, fact in enumerate(program.facts):
            args = [arg if isinstance(arg, Slot) else Constant(arg) for arg in fact.args]
            yield from _of(f"fact {index}", self.stated(fact.predicate, fact.owner, args, 1))
        for index, goal in enumerate(program.goals):
            yield from _of(f"goal {index}", self.goal(goal))
        for index, rule in enumerate(program.rules):
            yield from _of(f"rule {index}", self.rule(rule))
        for index, assertion in enumerate(program.assertions):
            yield from _of(f"assertion {assertion.name or index}", self.assertion(assertion))
        yield from _of("debug", _debug(program.debug or Debug(), program))

    def predicate(self, predicate: Predicate) -> Iterator[str]:
        if not is_name(predicate.name) or predicate.name in self.names:
            yield "its name is no name or taken"
        self.names.add(predicate.name)
        for kind in predicate.types:
            yield from _type(kind)
        if predicate.provided and not is_provided(predicate.name, predicate.kind, predicate.types):
            yield "no robot provides it so"
        effects = (*predicate.effects, *predicate.else_effects)
        if effects and predicate.kind is not Kind.ACTION:
            yield "only an action has effects"
        # In an effect slot 0 is the executor and slots 1.. are the action's arguments.
        scope = Scope()
        for position, kind in enumerate(predicate.types):
            scope.bind(position + 1, kind)
        for effect in effects:
            yield from self.effect(effect, scope)

    def effect(self, effect: Effect, scope: Scope) -> Iterator[str]:
        wrong = list(self.checks.derived(effect, scope))
        yield from wrong
        # `not wrong` implies that the index of the predicate is in range.
        if not wrong and effect.owner != SELF:
            affected = self.program.predicates[effect.predicate]
            if affected.kind is Kind.SENSED:
                yield f"an effect on what another robot senses, {affected.name}"

    def stated(self, index: int, owner: int | None, args: Sequence[Pattern], slots: int) -> Iterator[str]:
        """Check an initial fact or goal."""
        yield from _robot(owner)
        wrong = list(self.checks.patterns(index, tuple(args), slots))
        yield from wrong
        if wrong:
            return
        for pattern, kind in zip(args, self.program.predicates[index].types, strict=True):
            if isinstance(pattern, Slot) and pattern.index == SELF_SLOT and kind.base not in (Base.ROBOT, Base.OPEN):
                yield "the robot itself where no robot can be"

    def goal(self, goal: InitialGoal) -> Iterator[str]:
        yield from self.stated(goal.predicate, goal.owner, goal.args, len(goal.args) + 1)
        yield from self.leads(goal.leads or ())

    def leads(self, leads: tuple[Lead, ...]) -> Iterator[str]:
        rules = [lead.rule for lead in leads]
        if any(not 0 <= rule < len(self.program.rules) for rule in rules):
            yield "a rule that is not there leads to it"
        if any(one >= other for one, other in pairwise(rules)):
            yield "the rules that lead to it are not in order"
        if any(lead.rank is not None and not 0 <= lead.rank <= RANK_MAX for lead in leads):
            yield f"a rank beyond {RANK_MAX}"

    def rule(self, rule: Rule) -> Iterator[str]:
        if rule.slots < 1:
            yield "no slot for the robot itself"
        scope = Scope()
        yield from self.checks.body(rule.body, rule.slots, scope)
        for head in rule.head:
            yield from self.head(head, rule.slots, scope)

    def head(self, head: Head, slots: int, scope: Scope) -> Iterator[str]:
        match head:
            case Comprehension():
                inner = Scope(scope)
                yield from self.inner(head, slots, scope, inner)
                for item in head.head:
                    yield from self.checks.derived(item, inner)
            case Aggregate():
                yield from self.aggregate(head, slots, scope)
            case Steps():
                if len(head.steps) < 2:
                    yield "fewer than two steps"
                for item in head.steps:
                    yield from self.checks.derived(item, scope)
            case _:
                yield from self.checks.derived(head, scope)

    def inner(self, head: Comprehension | Aggregate, slots: int, outer: Scope, inner: Scope) -> Iterator[str]:
        """Check the body of a comprehension or aggregate; its bindings are added to `inner`."""
        # Two scopes: `listed` holds what the head declares, `inner` what the body binds; the second is a subset.
        listed = Scope(outer)
        for slot in head.slots:
            yield from self.checks.new(slot, UNKNOWN, slots, listed)
        yield from self.checks.body(head.body, slots, inner)
        if inner.bound & ~listed.bound:
            yield "an inner body binds a variable that is not listed"

    def aggregate(self, head: Aggregate, slots: int, scope: Scope) -> Iterator[str]:
        """Check an aggregate; the head of min and max also sees the variables of the winning match."""
        inner = Scope(scope)
        yield from self.inner(head, slots, scope, inner)
        if (head.term is None) != (head.operator is Operator.COUNT):
            yield f"{head.operator.name} with a wrong number of terms"
        if head.term is not None:
            yield from self.checks.code(head.term, inner)
        if head.result in head.slots:
            yield f"slot {head.result} is the result and a variable of the matches"
        witness = inner if head.operator in (Operator.MIN, Operator.MAX) else Scope(scope)
        kind = Type(Base.INT) if head.operator is Operator.COUNT else UNKNOWN
        yield from self.checks.new(head.result, kind, slots, witness)
        yield from self.checks.derived(head.head, witness)

    def assertion(self, assertion: Assertion) -> Iterator[str]:
        if not is_name(assertion.name):
            yield "its name is no name"
        if assertion.slots < 1:
            yield "no slot for the robot itself"
        yield from _robot(assertion.robot)
        if not {assertion.start.mode, assertion.finish.mode} <= {Mode.KEEP, Mode.READ}:
            yield "start and finish are only looked at"
        scope = Scope()
        yield from self.checks.atom(assertion.start, assertion.slots, scope)
        # A scope of its own: the finish fact's variables are not bound in the deadline and the violation.
        yield from self.checks.atom(assertion.finish, assertion.slots, Scope(scope))
        yield from self.finisher(assertion.finisher, scope)
        yield from self.checks.code(assertion.deadline, scope)
        yield from self.checks.derived(assertion.violation, scope)
        for serving in assertion.serving:
            yield from self.checks.patterns(serving.action, serving.args, assertion.slots, action=True)

    @staticmethod
    def finisher(finisher: Slot | Constant, scope: Scope) -> Iterator[str]:
        if isinstance(finisher, Slot):
            if scope.type_at(finisher.index) != ROBOT:
                yield "who finishes it is no robot that its start names"
        elif type(finisher.value) is not Robot or not 0 <= finisher.value <= ROBOT_ID_MAX:
            yield "who finishes it is no robot"


def _of(where: str, reasons: Iterator[str]) -> Iterator[str]:
    return (f"{where}: {reason}" for reason in reasons)


def _robot(number: int | None) -> Iterator[str]:
    if number is not None and not 0 <= number <= ROBOT_ID_MAX:
        yield f"owner {number} is no robot"


def _type(kind: Type | None) -> Iterator[str]:
    """Check a declared type: only symbols have a set, only lists have elements, nesting is bounded."""
    for _ in range(NESTING_MAX + 1):
        if kind is None:
            return
        if kind.name and (kind.base is not Base.SYMBOL or not is_name(kind.name)):
            yield f"{kind.name!r} names no set of symbols"
        if kind.element is not None and kind.base is not Base.LIST:
            yield "a type with elements that is no list"
        kind = kind.element
    if kind is not None:
        yield f"lists nested deeper than {NESTING_MAX}"


def _debug(debug: Debug, program: Program) -> Iterator[str]:
    """Check the debug section: of each table all entries have a place, or none has."""
    tables = (
        (debug.rules, program.rules),
        (debug.assertions, program.assertions),
        (debug.predicates, program.predicates),
    )
    for places, entries in tables:
        if places and len(places) != len(entries):
            yield f"{len(places)} places for {len(entries)} entries"
        if any(not 1 <= number <= PLACE_MAX for place in places for number in (place.line, place.column)):
            yield "a place that no source has"
