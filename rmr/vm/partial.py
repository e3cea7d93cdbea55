"""Partial searches of a body without ``not``: the matches behind a key, and the matches with a new fact.

The key of a match is the tuple of its facts' serial numbers. A search visits keys in ascending order, so `Behind`
skips every prefix that cannot lead behind a given key.

`Fresh` is semi-naive evaluation: for each atom in turn, that atom takes the new facts, the atoms before it take older
facts, and the atoms behind it any. Each match is thus found exactly once, by the first atom that takes a new fact, and
the cost depends on the new facts and their joins, not on all facts. In every order of the search, a variable gets
the value that the textually first conjunct gives it.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from rmr.base.time import Instant
from rmr.bytecode.program import Atom, Conjunct, Predicate, Slot
from rmr.vm.match import AtomStep, BindStep, Env, Found, OnFailure, Plan, Search, Step, agrees, plan
from rmr.vm.store import Fact, Store


class Behind(Search):
    """A search for the matches whose keys come after a given one; (): all."""

    def __init__(
        self, steps: Plan, store: Store, env: Env, now: Instant, on_failure: OnFailure, after: tuple[int, ...]
    ) -> None:
        super().__init__(steps, store, env, now, on_failure)
        self._after = after

    def facts(self, step: AtomStep) -> Iterator[Fact]:
        """Yield the facts that match the atom alone and may lead behind the key, oldest first."""
        level = len(self.found)
        first = 0
        # Only while the facts found are a prefix of the key does the key bound the next fact; the last one must differ.
        if self._after and all(self.found[i].serial == self._after[i] for i in range(level)):
            first = self._after[level] + (level + 1 == len(self._after))
        for fact in self.candidates(step):
            if fact.serial >= first and agrees(step, fact.args, self.env):
                yield fact


class FreshPlan(NamedTuple):
    """A body's plan with one of its atoms at the front."""

    steps: Plan
    predicate: int
    """Of that atom."""
    place: int
    """Where the atom stands among the conjuncts."""
    level: int
    """Where it stands among the atoms."""


def fresh_plans(body: tuple[Conjunct, ...], predicates: tuple[Predicate, ...]) -> Iterator[FreshPlan]:
    """Yield a plan for each atom of a body without ``not``."""
    atoms = [(place, each) for place, each in enumerate(body) if isinstance(each, Atom)]
    usual = plan(body, predicates)
    for level, (place, atom) in enumerate(atoms):
        bound = {pattern.index for pattern in atom.args if isinstance(pattern, Slot)}
        first, *steps = plan([atom, *body[:place], *body[place + 1 :]], predicates)
        before = [_binding(step, own, bound) for step, own in zip(steps[:place], usual[:place], strict=True)]
        yield FreshPlan((first, *before, *steps[place:]), atom.predicate, place, level)


def _binding(step: Step, usual: Step, bound: set[int]) -> Step:
    """Return a step that compares slots that are `bound` earlier than usual, and binds its other slots as usual."""
    if isinstance(step, AtomStep) and isinstance(usual, AtomStep):
        return replace(step, binds=usual.binds)
    return replace(step, again=step.slot in bound) if isinstance(step, BindStep) else step


class Fresh(Search):
    """A search for the matches in which an atom takes a fact newer than `since`, and those before it older ones."""

    def __init__(
        self,
        plan: FreshPlan,
        store: Store,
        env: Env,
        now: Instant,
        on_failure: OnFailure,
        since: int,
        upto: tuple[int, ...],
    ) -> None:
        """Search for matches with a fact newer than the serial `since`, up to the key `upto` (): without a bound.

        `on_failure` is not called for failures that happen without the new facts: they have been reported before.
        """
        super().__init__(plan.steps, store, env, now, self._failed)
        self._plan = plan
        self._since = since
        self._upto = upto
        self._on_new_failure = on_failure

    def matches(self) -> Iterator[Found]:
        """Yield the facts of each match in the order of the body's atoms; the matches are in no order."""
        for found in super().matches():
            yield self._in_order(found)

    def facts(self, step: AtomStep) -> Iterator[Fact]:
        """Yield the facts that match the atom alone, restricted to new or to old facts as the atom's place demands."""
        level = len(self.found)
        if level == 0:  # the atom at the front of this plan: the one that takes a new fact
            for fact in self._newest(step):
                if agrees(step, fact.args, self.env):
                    yield fact
            return
        # Atoms that stand before the front atom in the text take older facts alone, or a match would be found twice.
        last = self._last(level) if level <= self._plan.level else None
        for fact in super().facts(step):
            if last is not None and fact.serial > last:
                return
            yield fact

    def _last(self, level: int) -> int:
        """Return the greatest serial that an atom before the new fact's atom may take.

        New facts are newer than all facts of the bound, so a match within the bound must be less than it at an atom
        before the new fact's.
        """
        before = level - 1  # `found` begins with the new fact, which the key does not
        if not self._upto or any(self.found[1 + i].serial != self._upto[i] for i in range(before)):
            return self._since
        return self._upto[before] - (level == self._plan.level)

    def _newest(self, step: AtomStep) -> list[Fact]:
        """Return the new facts, oldest first, without examining the others."""
        newest: list[Fact] = []
        if self._upto and self._plan.level == 0:
            return newest  # a match that begins with a new fact is greater than the bound
        # Candidates come oldest first, so the new ones are at the end.
        for fact in reversed(self.candidates(step)):
            if fact.serial <= self._since:
                break
            newest.append(fact)
        return newest[::-1]

    def _in_order(self, found: Found) -> Found:
        level = self._plan.level
        # The search puts the front atom's fact first; its place in the text is `level`.
        return [*found[1 : level + 1], *found[:1], *found[level + 1 :]]

    def _failed(self, step: int, found: Found, reason: str) -> None:
        # A conjunct before the front atom has failed without the new fact already, and was reported then.
        if step > self._plan.place:
            self._on_new_failure(step, self._in_order(found), reason)
