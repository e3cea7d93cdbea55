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
from rmr.bytecode.limits import exceeded
from rmr.bytecode.part_checks import Checks, is_name, result_type
from rmr.bytecode.program import (
    GOALS_OF,
    REFERRING_DUTIES,
    SELF,
    SELF_SLOT,
    Aggregate,
    Assertion,
    Base,
    Comprehension,
    Constant,
    Debug,
    DeriveAction,
    Derived,
    DeriveFact,
    DeriveGoal,
    Duty,
    Effect,
    HeadValue,
    HiddenPredicate,
    InitialGoal,
    Kind,
    Lead,
    Mode,
    Operator,
    OwnFunction,
    Pattern,
    Predicate,
    Program,
    Rule,
    Slot,
    Steps,
    Type,
    When,
)
from rmr.bytecode.provided import is_provided
from rmr.bytecode.scope import ROBOT, UNKNOWN, Scope

ORDERED = (Base.INT, Base.FLOAT, Base.STRING)
"""Types by whose values the best of several facts is kept."""

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
        self.checks = Checks(program.predicates, program.functions)
        self.names: set[str] = set()
        """Names of the predicates checked so far: a repeated one is an error."""

    def reasons(self) -> Iterator[str]:
        program = self.program
        for index, function in enumerate(program.functions):
            yield from _of(f"function {function.name or index}", self.function(function))
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
        yield from _of("ensemble", self.ensemble(program.ensemble))
        yield from _of("debug", _debug(program.debug or Debug(), program))

    def ensemble(self, table: Sequence[HiddenPredicate]) -> Iterator[str]:
        """Check the predicates that stand for ensemble rules: each is a fact with the types that its duty needs."""
        predicates = self.program.predicates
        indices = [each.predicate for each in table] + [each.other for each in table if each.other is not None]
        if any(not 0 <= index < len(predicates) for index in indices):
            yield "a predicate that is not there"
            return
        if any(one.predicate >= other.predicate for one, other in pairwise(table)):
            yield "the predicates are not in order"
        if sum(each.duty is Duty.LIFE for each in table) > 1:
            yield "a robot has one life only"
        for each in table:
            yield from self.hidden(each)

    def hidden(self, hidden: HiddenPredicate) -> Iterator[str]:
        predicate = self.program.predicates[hidden.predicate]
        heard = hidden.duty is Duty.HEARD
        plain = predicate.kind in {Kind.TEMPORARY, Kind.PERSISTENT} and not predicate.provided
        if heard and (predicate.kind is not Kind.SENSED or predicate.provided):
            yield f"{predicate.name} is not sensed"
        if not heard and not plain:
            yield f"{predicate.name} is neither temporary nor persistent"
        if (hidden.other is not None) is not (hidden.duty in REFERRING_DUTIES):
            yield f"{predicate.name} has another predicate, or lacks one"
            return
        if hidden.duty is Duty.LIFE and (predicate.kind, predicate.types) != (Kind.PERSISTENT, (Type(Base.INT),)):
            yield f"{predicate.name} is not persistent with one int"
        if hidden.duty is Duty.RESTARTED and (predicate.kind, predicate.types) != (Kind.TEMPORARY, (Type(Base.ROBOT),)):
            yield f"{predicate.name} is not temporary with one robot"
        if hidden.other is None:
            return
        other = self.program.predicates[hidden.other]
        first = {Duty.DECISION: Base.ROBOT, Duty.ASIDE: Base.INT, Duty.HEARD: Base.ROBOT}.get(hidden.duty)
        small, large = (predicate, other)
        if heard or hidden.duty is Duty.ASIDE:
            small, large = large, small
        types = small.types if first is None else (Type(first), *small.types)
        temporary = other.kind is Kind.TEMPORARY and (heard or predicate.kind is Kind.TEMPORARY)
        if not temporary or large.types != types:
            yield f"{other.name} is not temporary with the types that {predicate.name} needs"

    def function(self, function: OwnFunction) -> Iterator[str]:
        if not is_name(function.name):
            yield "the name is not an identifier"
        scope = Scope()
        scope.bound = (1 << max(0, function.arity)) - 1
        yield from self.checks.code(function.code, scope, now=False)

    def predicate(self, predicate: Predicate) -> Iterator[str]:
        if predicate.name.startswith(GOALS_OF):
            yield from self.goal_table(predicate)
        elif not is_name(predicate.name) or predicate.name in self.names:
            yield "the name is not an identifier, or another predicate has it"
        self.names.add(predicate.name)
        for kind in predicate.types:
            yield from _type(kind)
        if predicate.provided and not is_provided(predicate.name, predicate.kind, predicate.types):
            yield "marked as provided, but there is no such provided predicate"
        yield from _best(predicate)
        if predicate.unordered and predicate.kind is Kind.SENSED:
            yield "unordered, but sensed facts are never sent"
        effects = (*predicate.effects, *predicate.else_effects)
        if effects and predicate.kind is not Kind.ACTION:
            yield "only an action has effects"
        # In an effect slot 0 is the executor and slots 1.. are the action's arguments.
        scope = Scope()
        for position, kind in enumerate(predicate.types):
            scope.bind(position + 1, kind)
        for effect in effects:
            yield from self.effect(effect, scope)

    def goal_table(self, predicate: Predicate) -> Iterator[str]:
        """Check a predicate that stands for the open goals of another one."""
        index = self.program.index(predicate.name.removeprefix(GOALS_OF))
        whose = None if index is None else self.program.predicates[index]
        if whose is None or whose.kind is Kind.ACTION or predicate.name in self.names:
            yield "no predicate has such goals, or another predicate stands for them"
        elif predicate.kind is not Kind.SENSED or predicate.types != whose.types:
            yield f"the goals of {whose.name} must be sensed and have its types"

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
        if self.program.predicates[index].name.startswith(GOALS_OF):
            yield "a fact or goal of a predicate that stands for goals"
        for pattern, kind in zip(args, self.program.predicates[index].types, strict=True):
            if isinstance(pattern, Slot) and pattern.index == SELF_SLOT and kind.base not in (Base.ROBOT, Base.OPEN):
                yield "the robot itself as an argument whose type is not robot"

    def goal(self, goal: InitialGoal) -> Iterator[str]:
        yield from self.stated(goal.predicate, goal.owner, goal.args, len(goal.args) + 1)
        yield from self.leads(goal.leads or ())

    def leads(self, leads: tuple[Lead, ...]) -> Iterator[str]:
        rules = [lead.rule for lead in leads]
        if any(not 0 <= rule < len(self.program.rules) for rule in rules):
            yield "a lead names a rule that does not exist"
        if any(one >= other for one, other in pairwise(rules)):
            yield "the leads are not in ascending order of their rules"
        if any(lead.rank is not None and not 0 <= lead.rank <= RANK_MAX for lead in leads):
            yield f"a rank beyond {RANK_MAX}"

    def rule(self, rule: Rule) -> Iterator[str]:
        if rule.slots < 1:
            yield "no slot for the robot itself"
        scope = Scope()
        yield from self.checks.body(rule.body, rule.slots, scope)
        self.checks.may_draw = True
        yield from self.heads(rule, scope)
        self.checks.may_draw = False

    def heads(self, rule: Rule, scope: Scope) -> Iterator[str]:
        for head in rule.head:
            if isinstance(head, HeadValue):
                yield from self.checks.code(head.code, scope)
                yield from self.checks.new(head.slot, UNKNOWN, rule.slots, scope)
            elif isinstance(head, When):
                if not scope.has(head.slot):
                    yield f"slot {head.slot} is used before it is bound"
                yield from self.head(head.item, rule.slots, scope)
            else:
                yield from self.head(head, rule.slots, scope)

    def head(self, head: Derived | Comprehension | Aggregate | Steps, slots: int, scope: Scope) -> Iterator[str]:
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
            case DeriveFact() | DeriveGoal() | DeriveAction():
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
        yield from self.checks.term(head, inner)
        if head.result in head.slots:
            yield f"slot {head.result} is the result and a variable of the matches"
        witness = inner if head.operator in (Operator.MIN, Operator.MAX) else Scope(scope)
        yield from self.checks.new(head.result, result_type(head), slots, witness)
        if not head.head:
            yield "an aggregate that derives nothing"
        for item in head.head:
            yield from self.checks.derived(item, witness)

    def assertion(self, assertion: Assertion) -> Iterator[str]:
        if not is_name(assertion.name):
            yield "the name is not an identifier"
        if assertion.slots < 1:
            yield "no slot for the robot itself"
        yield from _robot(assertion.robot)
        if not {assertion.start.mode, assertion.finish.mode} <= {Mode.KEEP, Mode.READ}:
            yield "start and finish must keep or read their facts"
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
                yield "the finisher is not a robot variable of the start"
        elif type(finisher.value) is not Robot or not 0 <= finisher.value <= ROBOT_ID_MAX:
            yield "the finisher is not a robot"


def _of(where: str, reasons: Iterator[str]) -> Iterator[str]:
    return (f"{where}: {reason}" for reason in reasons)


def _robot(number: int | None) -> Iterator[str]:
    if number is not None and not 0 <= number <= ROBOT_ID_MAX:
        yield f"owner {number} is not a robot id"


def _best(predicate: Predicate) -> Iterator[str]:
    """Check which facts are kept: of a persistent predicate, by an argument that has an order."""
    if predicate.best is None:
        return
    if predicate.kind is not Kind.PERSISTENT or predicate.provided:
        yield "keeps the best of facts that are not persistent"
    argument = predicate.best.argument
    if not 0 <= argument < len(predicate.types):
        yield f"keeps the best by argument {argument} of {len(predicate.types)}"
    elif predicate.types[argument].base not in ORDERED:
        yield "keeps the best by an argument whose type has no order"


def _type(kind: Type | None) -> Iterator[str]:
    """Check a declared type: only symbols have a set, only lists have elements, nesting is bounded."""
    for _ in range(NESTING_MAX + 1):
        if kind is None:
            return
        if kind.name and (kind.base is not Base.SYMBOL or not is_name(kind.name)):
            yield f"{kind.name!r} is not the name of a set of symbols"
        if kind.element is not None and kind.base is not Base.LIST:
            yield "an element type on a type other than list"
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
            yield f"{len(places)} source positions for {len(entries)} entries"
        if any(not 1 <= number <= PLACE_MAX for place in places for number in (place.line, place.column)):
            yield f"a line or column outside 1 to {PLACE_MAX}"
