"""What a match derives (paper III.D), worked out without changing anything.

The head's own facts, goals and actions are evaluated with the match's bindings. Each comprehension, left to
right, is matched against the facts as they stand after the body and the comprehensions before it have
consumed theirs; each of its matches takes its temporary facts, the oldest first, so that none serves two.
What an expression without value would derive is left out: of a comprehension the one match, else the firing.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from rmr.base.time import Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import (
    SELF_SLOT,
    Atom,
    Bind,
    Comprehension,
    Conjunct,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Mode,
    Predicate,
    Rule,
    Slot,
)
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.match import Env, Found, Plan, matches, plan
from rmr.vm.store import Fact, Store

OnFailure = Callable[[tuple[int, ...], str], None]
"""Told (what failed: part, step, serials of the facts matched; reason)."""

HEAD_PART = -1
"""The part of a rule that the head's own expressions are; comprehensions have their place in the head."""


class Role(IntEnum):
    """What a derived item is."""

    FACT = 0
    GOAL = 1
    ACTION = 2


class Derived(NamedTuple):
    """One item of a head, evaluated."""

    role: Role
    predicate: int
    owner: Robot
    """The owner or executor."""
    args: tuple[Value, ...]


class Derivation(NamedTuple):
    """All that a firing does."""

    consumed: list[Fact]
    derived: list[Derived]
    """In textual order; a comprehension's at its place."""


Simple = DeriveFact | DeriveGoal | DeriveAction
_ROLES: dict[type, Role] = {DeriveFact: Role.FACT, DeriveGoal: Role.GOAL, DeriveAction: Role.ACTION}


class PlannedComprehension(NamedTuple):
    """A comprehension with its body planned."""

    steps: Plan
    taken: tuple[int, ...]
    """Which of a match's facts are consumed."""
    head: tuple[Simple, ...]


class PlannedRule:
    """A rule with its bodies planned; shared by nothing, changed by nobody."""

    __slots__ = ("head", "slots", "steps", "taken")

    def __init__(self, rule: Rule, predicates: tuple[Predicate, ...]) -> None:
        self.slots = rule.slots
        self.steps = plan(rule.body, predicates)
        self.taken = consumed_places(rule.body)
        bound = bound_slots(rule.body)
        self.head = tuple(
            PlannedComprehension(
                plan(item.body, predicates, bound),
                consumed_places(item.body),
                tuple(inner for inner in item.head if not isinstance(inner, Comprehension)),
            )
            if isinstance(item, Comprehension)
            else item
            for item in rule.head
        )

    def derive(self, store: Store, env: Env, found: Found, now: Instant, on_failure: OnFailure) -> Derivation | None:
        """Return what the match `found` with `env` derives; None if an expression of the head has no value."""
        result = Derivation([found[place] for place in self.taken], [])
        for part, item in enumerate(self.head):
            if isinstance(item, PlannedComprehension):
                _comprehend(item, part, store, env, found, now, on_failure, result)
                continue
            try:
                result.derived.append(_item(item, env, now))
            except NoValue as reason:
                on_failure((HEAD_PART, part, *(fact.serial for fact in found)), str(reason))
                return None
        return result


def _comprehend(
    item: PlannedComprehension,
    part: int,
    store: Store,
    outer: Env,
    outer_found: Found,
    now: Instant,
    on_failure: OnFailure,
    result: Derivation,
) -> None:
    """Add to `result` what a comprehension derives and consumes."""
    env = outer.copy()
    gone = {fact.serial for fact in result.consumed}
    taken: set[int] = set()

    def failed(step: int, found: Found, reason: str) -> None:
        serials = [fact.serial for fact in (*outer_found, *found)]
        on_failure((part, step, *serials), reason)

    for found in matches(item.steps, store, env, now, failed, gone):
        facts = [found[place] for place in item.taken]
        if any(fact.serial in taken for fact in facts):
            continue
        try:
            derived = [_item(head, env, now) for head in item.head]
        except NoValue as reason:
            failed(HEAD_PART, found, str(reason))
            continue
        taken.update(fact.serial for fact in facts)
        result.consumed.extend(facts)
        result.derived.extend(derived)


def _item(head: Simple, env: Env, now: Instant) -> Derived:
    """Return a head item's value. Raises NoValue."""
    owner = evaluate(head.owner, env, now)
    if type(owner) is not Robot:
        raise NoValue("an owner that is no robot")
    return Derived(_ROLES[type(head)], head.predicate, owner, tuple([evaluate(code, env, now) for code in head.args]))


def consumed_places(body: tuple[Conjunct, ...]) -> tuple[int, ...]:
    """Return which of a match's facts the body consumes."""
    positive = [item for item in body if isinstance(item, Atom) and item.mode is not Mode.ABSENT]
    return tuple(place for place, atom in enumerate(positive) if atom.mode is Mode.CONSUME)


def bound_slots(body: tuple[Conjunct, ...]) -> list[int]:
    """Return the slots that are bound once the body matches."""
    bound = [SELF_SLOT]
    for item in body:
        if isinstance(item, Atom):
            if item.mode is not Mode.ABSENT:
                bound.extend(pattern.index for pattern in item.args if isinstance(pattern, Slot))
        elif isinstance(item, Bind):
            bound.append(item.slot)
    return bound
