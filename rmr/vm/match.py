"""Depth-first search for the matches of a rule's body.

The search tries the conjuncts in their textual order, and for each atom the facts oldest first. Matches therefore
come in the order that the language defines: conjunct by conjunct, the oldest facts go first (paper III.D gives the
conjunction, figure 6 the choice). Two conjuncts never match the same temporary fact. The facts do not change during a
search. The search of a comprehension excludes the facts that the rule's own body consumes (`gone`). A fact that an
earlier match of the comprehension has consumed (`taken`) still counts for ``not`` and ``$``, but no later match
consumes it again.

The slots that are bound at each atom are known from the text, so each atom is planned once: constants to test, bound
slots to compare with, slots to bind.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any

from rmr.base.record import record
from rmr.base.time import Instant
from rmr.base.values import Value
from rmr.bytecode.conform import comparable
from rmr.bytecode.octets import identity
from rmr.bytecode.program import (
    SELF_SLOT,
    Anything,
    Atom,
    Bind,
    Code,
    Conjunct,
    Fold,
    Guard,
    Mode,
    Operator,
    Pattern,
    Predicate,
    Slot,
    Type,
)
from rmr.bytecode.scope import UNKNOWN, Scope
from rmr.vm.aggregate import reduced
from rmr.vm.evaluate import NoValue, evaluate, same
from rmr.vm.store import Args, Fact, Facts, Store, is_open

Env = list[Value]
Found = list[Fact]
TypeAt = Callable[[int], Type | None]
OnFailure = Callable[[int, Found, str], None]
"""Called with (step, facts matched so far, reason) when an expression of a body has no value."""


LOOKS_MAX = 1 << 20
"""Search budget: facts that one search may examine. A body of several atoms may have millions of combinations."""


@record
class AtomStep:
    """An atom, planned."""

    predicate: int
    mode: Mode
    tests: tuple[tuple[int, Value], ...]
    """(position, constant)"""
    joins: tuple[tuple[int, int], ...]
    """(position, slot bound before)"""
    binds: tuple[tuple[int, int], ...]
    """(position, slot bound here)"""
    twins: tuple[tuple[int, int], ...]
    """(position, earlier position) of a variable that the atom has twice."""
    strict: bool
    """Whether values of types that differ may meet: then they are compared strictly, for 1 == @1 == True in Python."""


@record
class GuardStep:
    """A condition."""

    code: Code


@record
class BindStep:
    """A variable that an expression binds."""

    slot: int
    code: Code
    again: bool = False
    """Whether the slot has a value already, which must be the same. The expression's value replaces it: an equal value
    may be of another type (1 and 1.0)."""


@record
class FoldStep:
    """A value that all matches of an inner body are reduced to."""

    operator: Operator
    term: Code | None
    result: int
    steps: "Plan"


Step = AtomStep | GuardStep | BindStep | FoldStep
Plan = tuple[Step, ...]

FOLDED = -1
"""The predicate of the pseudo-fact that stands for the value of a fold among the facts of a match.

Its serial is what identifies the value. So a match in which the value has changed is another match."""


def plan(
    body: Iterable[Conjunct],
    predicates: tuple[Predicate, ...],
    bound: Iterable[int] = (SELF_SLOT,),
    outer: Scope | None = None,
) -> Plan:
    """Return the steps of `body`, before which the slots `bound` are bound, with the types that `outer` knows."""
    known = set(bound)
    scope = Scope(outer)
    steps: list[Step] = []
    for conjunct in body:
        if isinstance(conjunct, Guard):
            steps.append(GuardStep(conjunct.code))
        elif isinstance(conjunct, Bind):
            steps.append(BindStep(conjunct.slot, conjunct.code))
            known.add(conjunct.slot)
        elif isinstance(conjunct, Fold):
            inner = plan(conjunct.body, predicates, known, scope)
            steps.append(FoldStep(conjunct.operator, conjunct.term, conjunct.result, inner))
            known.add(conjunct.result)
        else:
            steps.append(plan_atom(conjunct, predicates, known, scope.type_at))
            if conjunct.mode is not Mode.ABSENT:
                known.update(pattern.index for pattern in conjunct.args if isinstance(pattern, Slot))
        scope.grow([conjunct], predicates)
    return tuple(steps)


def plan_atom(
    atom: Atom, predicates: tuple[Predicate, ...], bound: Collection[int], type_at: TypeAt | None = None
) -> AtomStep:
    """Return the plan of an atom; slots that are not `bound` are bound by it (by ABSENT only compared).

    `type_at` returns the static type of a bound slot, None if it is not known; without it slots have the types of the
    arguments with which they are compared.
    """
    tests: list[tuple[int, Value]] = []
    joins: list[tuple[int, int]] = []
    binds: dict[int, int] = {}
    twins: list[tuple[int, int]] = []
    for position, pattern in enumerate(atom.args):
        if isinstance(pattern, Anything):
            continue
        if not isinstance(pattern, Slot):
            tests.append((position, pattern.value))
        elif pattern.index in bound:
            joins.append((position, pattern.index))
        elif pattern.index in binds:
            twins.append((position, binds[pattern.index]))
        else:
            binds[pattern.index] = position
    types = predicates[atom.predicate].types
    compared = [(types[position], types[other]) for position, other in twins]
    if type_at is not None:
        compared += [(types[position], type_at(slot) or UNKNOWN) for position, slot in joins]
    return AtomStep(
        atom.predicate,
        atom.mode,
        tuple(tests),
        tuple(joins),
        tuple([(position, slot) for slot, position in binds.items()]),
        tuple(twins),
        any(map(is_open, types)) or not all(comparable(one, other) for one, other in compared),
    )


def agrees(step: AtomStep, args: Args, env: Env) -> bool:
    """Return whether `args` match the atom; binds nothing."""
    if step.strict:
        return (
            all(same(args[position], value) for position, value in step.tests)
            and all(same(args[position], env[slot]) for position, slot in step.joins)
            and all(same(args[position], args[other]) for position, other in step.twins)
        )
    for position, value in step.tests:
        if args[position] != value:
            return False
    for position, slot in step.joins:
        if args[position] != env[slot]:
            return False
    return all(args[position] == args[other] for position, other in step.twins)


def candidates(step: AtomStep, store: Store, env: Env) -> Facts:
    """Return a superset of the facts that match the atom, oldest first."""
    table = store.tables[step.predicate]
    # One column is enough to narrow the facts; the first constant is as good a guess as any, and needs no binding.
    if step.tests:
        position, value = step.tests[0]
        return table.probe(position, value)
    if step.joins:
        position, slot = step.joins[0]
        return table.probe(position, env[slot])
    return table.facts.values()


def consumed_places(steps: Plan) -> tuple[int, ...]:
    """Return which of a match's facts are consumed."""
    modes = [step.mode for step in steps if isinstance(step, AtomStep) and step.mode is not Mode.ABSENT]
    return tuple(place for place, mode in enumerate(modes) if mode is Mode.CONSUME)


def bind_again(steps: Plan, facts: Sequence[Fact], env: Env, now: Instant) -> None:
    """Put the values of a match into `env`, given its facts: one for each atom that is not ABSENT and each fold."""
    rest = iter(facts)
    for step in steps:
        if isinstance(step, BindStep):
            env[step.slot] = evaluate(step.code, env, now)
        elif isinstance(step, FoldStep):
            env[step.result] = next(rest).args[0]
        elif isinstance(step, AtomStep) and step.mode is not Mode.ABSENT:
            args = next(rest).args
            for position, slot in step.binds:
                env[slot] = args[position]


class Search:
    """One depth-first search. Facts whose serials are `gone` are not seen, those that are `taken` not consumed."""

    def __init__(
        self,
        steps: Plan,
        store: Store,
        env: Env,
        now: Instant,
        on_failure: OnFailure,
        gone: Collection[int] = (),
        taken: set[int] | None = None,
    ) -> None:
        """`taken` may grow between two matches."""
        self.steps = steps
        self.store = store
        self.env = env
        self.now = now
        self.on_failure = on_failure
        self.gone = gone
        self.taken = taken
        self.places = consumed_places(steps) if taken is not None else ()
        self.found: Found = []
        self._looks_left = LOOKS_MAX

    def matches(self) -> Iterator[Found]:
        """Yield the facts of each match, one for each atom that is not ABSENT, with their values in `env`.

        Both lists are reused: copy them to keep them.
        """
        return self.extend(0)

    def extend(self, index: int) -> Iterator[Found]:
        """Yield the ways to satisfy the steps from `index` on."""
        if index == len(self.steps):
            yield self.found
            return
        step = self.steps[index]
        if type(step) is AtomStep:
            if step.mode is Mode.ABSENT:
                # One matching fact refutes a ``not``; it binds nothing, so the search goes on with the same slots.
                if next(self.facts(step), None) is None:
                    yield from self.extend(index + 1)
                return
            yield from self.take(step, index)
        elif type(step) is FoldStep:
            value = self.folded(step, index)
            if value is not None:
                self.env[step.result] = value
                self.found.append(value_fact(value))
                yield from self.extend(index + 1)
                self.found.pop()
        elif self.holds(step, index):  # type: ignore[arg-type]  # narrowed by `type`, which is faster here
            yield from self.extend(index + 1)

    def take(self, step: AtomStep, index: int) -> Iterator[Found]:
        """Yield the ways with each fact that the atom can take."""
        linear = step.mode is not Mode.READ  # READ (``$``) may share a fact with another atom
        taken = self.taken if step.mode is Mode.CONSUME else None
        last = index + 1 == len(self.steps)
        env = self.env
        found = self.found
        for fact in self.facts(step):
            if linear and (fact in found or (taken and fact.serial in taken)):
                continue
            # Slots need no reset on backtracking: every step that reads a slot follows the one that binds it.
            for position, slot in step.binds:
                env[slot] = fact.args[position]
            found.append(fact)
            if last:  # spares one generator for each match
                yield found
            else:
                yield from self.extend(index + 1)
            found.pop()
            # The match just yielded may have consumed a fact of an outer atom: nothing more can match with that fact.
            if self.taken and self.spent():
                return

    def spent(self) -> bool:
        """Return whether a fact found so far has been taken: no further match can contain it."""
        found = self.found
        taken = self.taken
        return taken is not None and any(found[p].serial in taken for p in self.places if p < len(found))

    def facts(self, step: AtomStep) -> Iterator[Fact]:
        """Yield the facts that match the atom alone, oldest first."""
        for fact in self.candidates(step):
            if fact.serial not in self.gone and agrees(step, fact.args, self.env):
                yield fact

    def candidates(self, step: AtomStep) -> Facts:
        """Return a superset of the facts that match the atom, oldest first; none once the search budget is used."""
        if self._looks_left < 0:
            return ()
        facts = candidates(step, self.store, self.env)
        # Counted before they are examined: a search that would exceed its budget stops at once, at the same fact on
        # every robot.
        self._looks_left -= len(facts)
        if self._looks_left < 0:
            self.on_failure(len(self.steps), [], f"the search for matches was given up after {LOOKS_MAX} facts")
            return ()
        return facts

    def folded(self, step: FoldStep, index: int) -> Value | None:
        """Return the value of a fold; None if it has none, or the search budget is used up."""

        def failed(_step: int, _found: Found, reason: str) -> None:
            self.on_failure(index, self.found, reason)

        inner = Search(step.steps, self.store, self.env, self.now, failed, self.gone)
        inner._looks_left = self._looks_left
        values: list[Value] = []
        try:
            for _ in inner.matches():
                if step.term is None:
                    values.append(1)
                    continue
                try:
                    values.append(evaluate(step.term, self.env, self.now))
                except NoValue as reason:
                    self.on_failure(index, self.found, str(reason))
            self._looks_left = inner._looks_left
            return None if self._looks_left < 0 else reduced(step.operator, values)
        except NoValue as reason:
            self.on_failure(index, self.found, str(reason))
            return None

    def holds(self, step: GuardStep | BindStep, index: int) -> bool:
        """Evaluate a condition, or bind a variable; False also if the expression has no value."""
        try:
            value = evaluate(step.code, self.env, self.now)
            if isinstance(step, BindStep):
                if step.again and not same(value, self.env[step.slot]):
                    return False
                self.env[step.slot] = value
                return True
            if type(value) is not bool:
                raise NoValue("a condition that is neither true nor false")
        except NoValue as reason:
            self.on_failure(index, self.found, str(reason))
            return False
        return value


def value_fact(value: Value) -> Fact:
    """Return the pseudo-fact of a fold's value."""
    key: Any = identity(value)
    return Fact(FOLDED, (value,), key, 0, 0)


def pattern_agrees(patterns: tuple[Pattern, ...], args: Args, bindings: tuple[Value | None, ...] = ()) -> bool:
    """Return whether `args` match `patterns`; an unbound slot matches any value, the same one at each occurrence."""
    free: dict[int, Value] = {}
    for pattern, value in zip(patterns, args, strict=True):
        if isinstance(pattern, Anything):
            continue
        if isinstance(pattern, Slot):
            bound = bindings[pattern.index] if pattern.index < len(bindings) else None
            expected = free.setdefault(pattern.index, value) if bound is None else bound
        else:
            expected = pattern.value
        if not same(expected, value):
            return False
    return True
