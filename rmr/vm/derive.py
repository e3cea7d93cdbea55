"""Evaluation of a rule's head: the consumed facts and derived items of one match (paper III.D), without side effects.

The head's own facts, goals and actions are evaluated with the match's bindings; so are all the steps of
``a(R) then b(R)``. Comprehensions and aggregates are matched left to right. Each sees the facts that the body and the
comprehensions before it have not consumed. Each of its matches consumes its temporary facts, the oldest first, so no
fact serves two matches.

An expression without value leaves something out: in a comprehension's item that match, in an aggregate's term that
match, elsewhere the whole firing.
"""

from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, TypeVar

from rmr.base.streams import Choices, stable_hash
from rmr.base.time import Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.arithmetic import truth
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.heads import codes
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    SELF_SLOT,
    Aggregate,
    Atom,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Effect,
    Fold,
    HeadValue,
    Mode,
    Operator,
    Predicate,
    Rule,
    Slot,
    Steps,
    When,
)
from rmr.bytecode.program import Derived as Item
from rmr.bytecode.scope import UNKNOWN, Scope
from rmr.vm.aggregate import FOLDS, better
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.match import Env, Found, Plan, Search, consumed_places, plan
from rmr.vm.store import Fact, Store
from rmr.vm.type_checks import TypeChecks, check_types, type_checks

OnFailure = Callable[[int, int, Sequence[Fact], str], None]
"""Callback for an expression without value: (part of the rule, step of that part, facts matched, reason)."""

MATCHES_MAX = 100_000
"""Bound on the matches of the comprehensions and aggregates of one firing, weighted by the items that each derives.

A robot can hold no more facts than that, and a firing, which is atomic, must not take minutes and gigabytes. A rule
that exceeds the bound does not fire."""

HEAD_PART = -1
"""Part number of the head's own expressions in failure reports; comprehensions and aggregates have their place."""

T = TypeVar("T")


class DerivedKind(IntEnum):
    """The kind of a derived item."""

    FACT = 0
    GOAL = 1
    ACTION = 2


class Derived(NamedTuple):
    """One item of a head, evaluated."""

    role: DerivedKind
    predicate: int
    owner: Robot
    """The owner or executor."""
    args: tuple[Value, ...]


Chain = tuple[Derived, ...]
"""Steps in sequence (``then``): each is derived when the one before it is complete. Most chains have one step."""


class FiringEffect(NamedTuple):
    """The effect of one firing."""

    consumed: list[Fact]
    derived: list[Chain]
    """In textual order; a comprehension's or aggregate's at its place."""


_ROLES: dict[type, DerivedKind] = {
    DeriveFact: DerivedKind.FACT,
    DeriveGoal: DerivedKind.GOAL,
    DeriveAction: DerivedKind.ACTION,
    Effect: DerivedKind.FACT,
}


class PlannedItem(NamedTuple):
    """An item of a head, with its run-time type checks."""

    item: Item
    checks: TypeChecks


Planned = tuple[PlannedItem, ...]
"""The steps of a `Chain` before evaluation."""


class Inner(NamedTuple):
    """A comprehension or aggregate with its body planned."""

    head: Comprehension | Aggregate
    steps: Plan
    taken: tuple[int, ...]
    """Places of the consumed facts among those of a match."""
    items: Planned
    """Items that each match of a comprehension, or the whole aggregate, derives."""


class PlannedWhen(NamedTuple):
    """A conditional item with what it derives planned."""

    slot: int
    item: Planned | Inner


PlannedHead = Planned | Inner | PlannedWhen | HeadValue


class InnerMatch(NamedTuple):
    """A match of a comprehension or aggregate."""

    part: int
    """Place of the comprehension or aggregate in the head."""
    facts: tuple[Fact, ...]


class PlannedRule:
    """A rule with its bodies planned: immutable, shared by all robots of a program."""

    __slots__ = ("drawn", "head", "slots", "steps", "taken")

    def __init__(self, rule: Rule, predicates: tuple[Predicate, ...]) -> None:
        self.drawn = any(map(draws_in, codes(rule.head)))
        """Whether the head calls random(): then the last of its slots holds the `Draws` of the firing."""
        self.slots = rule.slots + self.drawn
        self.steps = plan(rule.body, predicates)
        self.taken = consumed_places(self.steps)
        bound = bound_slots(rule.body)
        scope = Scope()
        scope.grow(rule.body, predicates)
        planned: list[PlannedHead] = []
        for head in rule.head:
            if isinstance(head, HeadValue):
                bound.append(head.slot)
                scope.bind(head.slot, UNKNOWN)
                planned.append(head)
            elif isinstance(head, When):
                planned.append(PlannedWhen(head.slot, _part(head.item, predicates, bound, scope)))
            else:
                planned.append(_part(head, predicates, bound, scope))
        self.head = tuple(planned)

    def derive(
        self,
        store: Store,
        env: Env,
        found: Sequence[Fact],
        now: Instant,
        on_failure: OnFailure,
        matches: list[InnerMatch] | None = None,
    ) -> FiringEffect | None:
        """Return the effect of the match `found` with slots `env`; None if an expression of the head has no value.

        The matches of comprehensions and aggregates are appended to `matches`.
        """
        if self.drawn:
            draws: Any = env[-1]
            draws.restart()
        firing = _Firing(store, env, found, now, on_failure, self.taken, matches)
        for part, item in enumerate(self.head):
            try:
                firing.add(part, item)
            except NoValue as reason:
                on_failure(HEAD_PART, part, found, str(reason))
                return None
        return firing.result


class _Firing:
    """Accumulator of one firing's effect."""

    def __init__(
        self,
        store: Store,
        env: Env,
        found: Sequence[Fact],
        now: Instant,
        on_failure: OnFailure,
        taken: tuple[int, ...],
        matches: list[InnerMatch] | None,
    ) -> None:
        self.result = FiringEffect([found[place] for place in taken], [])
        self._store = store
        self._env = env
        self._found = found
        self._now = now
        self._on_failure = on_failure
        self._found_inside = matches
        self._matches = 0
        """Matches of comprehensions and aggregates so far, weighted by the items that each derives (`MATCHES_MAX`)."""

    def add(self, part: int, item: "PlannedHead") -> None:
        """Add the effect of the head's item at place `part`. Raises NoValue."""
        if isinstance(item, HeadValue):
            self._env[item.slot] = evaluate(item.code, self._env, self._now)
        elif isinstance(item, PlannedWhen):
            if truth(self._env[item.slot]):
                self.add(part, item.item)
        elif not isinstance(item, Inner):
            self.result.derived.append(tuple([self._value(step, self._env) for step in item]))
        elif isinstance(item.head, Comprehension):
            for _, derived in self._each(part, item, lambda env: [(self._value(each, env),) for each in item.items]):
                self.result.derived.extend(derived)
        else:
            env = self._aggregated(part, item, item.head)
            if env is not None:
                self.result.derived.extend([(self._value(each, env),) for each in item.items])

    def _aggregated(self, part: int, inner: Inner, aggregate: Aggregate) -> Env | None:
        """Return the slots for an aggregate's head, or None if it derives nothing."""
        term = aggregate.term
        result = aggregate.result
        values = self._each(part, inner, lambda env: evaluate(term, env, self._now) if term is not None else 1)
        if aggregate.operator in (Operator.MIN, Operator.MAX):
            best: Env | None = None
            # MIN and MAX keep the slots of the match with the extreme value: the head may name them (the witness).
            for env, value in values:
                if better(aggregate.operator, value, None if best is None else best[result]):
                    best = env.copy()  # `env` is reused by the search
                    best[result] = value
            return best
        outer = self._env.copy()
        outer[result] = FOLDS[aggregate.operator]([value for _, value in values])
        return outer

    def _each(self, part: int, inner: Inner, work: Callable[[Env], T]) -> Iterator[tuple[Env, T]]:
        """Yield the slots of each match of an inner body and the value of `work` for it; consume its temporary facts.

        Raises NoValue if there are too many matches.
        """
        env = self._env.copy()
        consumed = self.result.consumed
        # Facts consumed before this part are invisible to it. Facts that its own matches take stay visible to ``not``
        # and ``$``: all matches of one comprehension see the same snapshot.
        gone = {fact.serial for fact in consumed}
        taken: set[int] = set()

        def failed(step: int, found: Found, reason: str) -> None:
            self._on_failure(part, step, (*self._found, *found), reason)

        for found in Search(inner.steps, self._store, env, self._now, failed, gone, taken).matches():
            # A match that derives nothing still costs time and memory.
            self._matches += len(inner.items) or 1 if isinstance(inner.head, Comprehension) else 1
            if self._matches > MATCHES_MAX:
                raise NoValue(f"more than {MATCHES_MAX} matches in one firing")
            try:
                value = work(env)
            except NoValue as reason:
                failed(HEAD_PART, found, str(reason))
                continue  # a match without value consumes nothing: its facts may serve a later match
            facts = [found[place] for place in inner.taken]
            taken.update([fact.serial for fact in facts])
            consumed.extend(facts)
            if self._found_inside is not None:
                self._found_inside.append(InnerMatch(part, tuple(found)))
            yield env, value

    def _value(self, planned: PlannedItem, env: Env) -> Derived:
        return evaluated(planned.item, env, self._now, planned.checks)


def evaluated(item: Item | Effect, env: Sequence[Value], now: Instant, checks: TypeChecks) -> Derived:
    """Return an item of a head, or an effect of an action, evaluated. Raises NoValue."""
    owner = evaluate(item.owner, env, now)
    if type(owner) is not Robot:  # an open type may hold any value, and 1 == @1 in Python
        raise NoValue("an owner that is no robot")
    args = tuple([evaluate(code, env, now) for code in item.args])
    check_types(checks, args)
    return Derived(_ROLES[type(item)], item.predicate, owner, args)


def _planned(items: Sequence[Item], predicates: Sequence[Predicate], scope: Scope) -> Planned:
    return tuple(PlannedItem(item, type_checks(item, predicates, scope)) for item in items)


def _part(
    head: Comprehension | Aggregate | Steps | Item,
    predicates: tuple[Predicate, ...],
    bound: Sequence[int],
    scope: Scope,
) -> Planned | Inner:
    """Return the plan of an item of a head behind which the slots `bound` are bound."""
    if isinstance(head, Comprehension | Aggregate):
        return _inner(head, plan(head.body, predicates, bound, scope), predicates, scope)
    return _planned(head.steps if isinstance(head, Steps) else (head,), predicates, scope)


def draws_in(code: Code) -> bool:
    """Return whether an expression calls a function of chance."""
    return any(i.op is Op.CALL and isinstance(i.operand, int) and FUNCTIONS[i.operand].drawn for i in code)


def _inner(head: Comprehension | Aggregate, steps: Plan, predicates: Sequence[Predicate], outer: Scope) -> Inner:
    """Return the plan of a comprehension or aggregate in a rule whose own body has bound `outer`."""
    scope = Scope(outer)
    scope.grow(head.body, predicates)
    return Inner(head, steps, consumed_places(steps), _planned(head.head, predicates, scope))


def bound_slots(body: tuple[Conjunct, ...]) -> list[int]:
    """Return the slots that are bound once the body matches."""
    bound = [SELF_SLOT]
    for item in body:
        if isinstance(item, Atom):
            if item.mode is not Mode.ABSENT:  # ``not`` compares, it binds nothing
                bound.extend(pattern.index for pattern in item.args if isinstance(pattern, Slot))
        elif isinstance(item, Bind):
            bound.append(item.slot)
        elif isinstance(item, Fold):
            bound.append(item.result)
    return bound


class Draws:
    """The numbers that `random()` gives in one firing: SplitMix64, as `Choices`, but with 53 bits of each number.

    A machine evaluates a head when it finds the match. The rule may fire much later, or never. A number must therefore
    not depend on numbers that are drawn in the meantime: the stream of a firing is a function of the robot's seed, the
    rule, and the number of times that the rule has fired. Engines that evaluate at other times, or twice, draw the same
    numbers. So does a replay.
    """

    __slots__ = ("_first", "_state")

    SCALE: ClassVar = 1 << 53

    def __init__(self, seed: int, rule: int, firing: int) -> None:
        """The stream of the firing number `firing`, from 0, of a rule on the robot with `seed`."""
        self._first = stable_hash(f"{seed}/{rule}/{firing}")
        self._state = self._first

    def restart(self) -> None:
        """Begin again with the first number."""
        self._state = self._first

    def draw(self) -> float:
        """Return the next number, from 0 up to below 1."""
        one, other = Choices.MULTIPLIERS
        self._state = mixed = (self._state + Choices.GAMMA) & Choices.MASK
        mixed = ((mixed ^ (mixed >> 30)) * one) & Choices.MASK
        mixed = ((mixed ^ (mixed >> 27)) * other) & Choices.MASK
        return ((mixed ^ (mixed >> 31)) >> 11) / self.SCALE
