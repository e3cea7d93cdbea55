"""Refraction: a rule that consumes nothing fires once for each match. This module keeps the matches not yet fired.

Serial numbers grow, and a fact that is inserted again has a new one. So the key of a match, the tuple of its facts'
serial numbers, is unique over the whole run, and the order of the matches (conjunct by conjunct, the oldest facts
first) is the order of their keys.

`Growing` serves bodies whose matches arise by insertions alone. It keeps the horizon, the key up to which all matches
have been found, and the matches up to there that have not fired. When these have fired, it searches beyond the
horizon. When facts are inserted, it adds the matches up to the horizon that contain a new fact. No match is found
twice, so fired matches need not be remembered. `Changing` serves bodies with ``not``, whose matches arise by removals
too: it searches all matches anew after a change and remembers which have fired.
"""

from abc import ABC, abstractmethod
from bisect import bisect_left, insort
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from operator import itemgetter
from typing import NamedTuple

from rmr.base.time import Instant
from rmr.bytecode.program import Atom, Conjunct, Predicate, Slot
from rmr.vm.bounds import Dropped
from rmr.vm.match import AtomStep, BindStep, Env, Found, OnFailure, Plan, Search, Step, agrees, bind_again, plan
from rmr.vm.store import Fact, Store


class Behind(Search):
    """A search for the matches whose keys come after a given one; (): all.

    It visits keys in ascending order and skips every prefix that cannot lead behind that key.
    """

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
    """A search for the matches in which an atom takes a fact newer than `since`, and those before it older ones.

    This is semi-naive evaluation: with one such search for each atom, each match is found exactly once, by the first
    atom that takes a new fact, and the cost depends on the new facts and their joins, not on all facts. In every order
    of the search, a variable gets the value that the textually first conjunct gives it.
    """

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


CHUNK = 512
"""Matches found by one search. Many would be wasted when a firing undoes them; few would repeat the search, which
begins at the front each time."""

MATCHES_MAX = 100_000
"""Matches of one rule that are kept because they have not fired; beyond that, matches with new facts are dropped."""

Key = tuple[int, ...]
"""The serials of a match's facts."""


class Match(NamedTuple):
    """What is kept of a match."""

    key: Key
    facts: tuple[Fact, ...]

    @property
    def held(self) -> bool:
        """Whether all facts of the match still hold."""
        return all(fact.held for fact in self.facts)


class Once(ABC):
    """The matches of one rule that have not fired."""

    def __init__(self, steps: Plan, store: Store, dropped: Dropped) -> None:
        self._steps = steps
        self._store = store
        self._dropped = dropped
        self._kept: list[Match] = []

    def each(self, env: Env, now: Instant, on_failure: OnFailure) -> Iterator[tuple[Fact, ...]]:
        """Yield the facts of the matches in their order, with their values in `env`; nothing may change meanwhile."""
        self._refresh(env, now, on_failure)
        place = 0
        while place < len(self._kept) or self._look_further(env, now, on_failure):
            match = self._kept[place]
            if match.held:
                bind_again(self._steps, match.facts, env, now)
                yield match.facts
                place += 1
            else:
                self._forget_gone(place)

    def fire(self, facts: tuple[Fact, ...]) -> None:
        """Note that a match has fired."""
        del self._kept[bisect_left(self._kept, (key_of(facts),))]

    @abstractmethod
    def touch(self) -> None:
        """Note that facts have changed."""

    @abstractmethod
    def _refresh(self, env: Env, now: Instant, on_failure: OnFailure) -> None:
        """Update the kept matches after changes of facts."""

    @abstractmethod
    def _look_further(self, env: Env, now: Instant, on_failure: OnFailure) -> bool:
        """Keep further matches, which come after all those kept so far; return False if there are none."""

    def _forget_gone(self, place: int) -> None:
        """Drop matches with removed facts, from `place` up to the next valid one."""
        end = place + 1
        while end < len(self._kept) and not self._kept[end].held:
            end += 1
        del self._kept[place:end]


class Growing(Once):
    """The unfired matches of a monotone body (without ``not``): searched incrementally."""

    def __init__(
        self,
        body: tuple[Conjunct, ...],
        predicates: tuple[Predicate, ...],
        store: Store,
        dropped: Dropped,
        *,
        may_fail: bool,
    ) -> None:
        """`may_fail`: an expression of the body may have no value."""
        super().__init__(plan(body, predicates), store, dropped)
        self._chunk = MATCHES_MAX if may_fail else CHUNK
        self._body = body
        self._predicates = predicates
        self._plans: list[FreshPlan] = []
        """Plans of the incremental searches; empty until the first one is needed."""
        self._horizon: Key = ()
        """Every match up to this key has been found; (): no search has been made."""
        self._complete = False
        """Every match has been found."""
        self._newest = 0
        """The serial of the newest fact that has been considered."""

    def touch(self) -> None:
        """Do nothing: new facts are recognised by their serial numbers, removed ones by `Fact.held`."""

    def _refresh(self, env: Env, now: Instant, on_failure: OnFailure) -> None:
        """Add the matches up to the horizon that have a new fact."""
        since = self._newest
        self._newest = self._store.newest
        if since == self._newest or not (self._complete or self._horizon):
            return
        failed: list[tuple[Key, int, Found, str]] = []

        def later(step: int, facts: Found, reason: str) -> None:
            failed.append((key_of(facts), step, facts, reason))

        if not self._plans:  # planned lazily: most rules never get a new fact after their first search
            self._plans.extend(fresh_plans(self._body, self._predicates))
        for each in self._plans:
            if self._store.tables[each.predicate].newest > since:
                upto = () if self._complete else self._horizon
                self._add(Fresh(each, self._store, env, now, later, since, upto), now)
        # In the order of a search of all facts, which comes to a match after those with older facts.
        for _, step, facts, reason in sorted(failed, key=itemgetter(0, 1)):
            on_failure(step, facts, reason)

    def _add(self, search: Search, now: Instant) -> None:
        for match in _matches(search):
            if len(self._kept) >= MATCHES_MAX and self._is_full():
                self._dropped.add("matches", MATCHES_MAX, now)
                return
            insort(self._kept, match)

    def _is_full(self) -> bool:
        self._kept = [match for match in self._kept if match.held]
        return len(self._kept) >= MATCHES_MAX

    def _look_further(self, env: Env, now: Instant, on_failure: OnFailure) -> bool:
        if self._complete or len(self._kept) >= MATCHES_MAX:
            return False
        search = Behind(self._steps, self._store, env, now, on_failure, self._horizon)
        found = list(islice(_matches(search), self._chunk))
        self._complete = len(found) < self._chunk  # a search that ends before it has seen all
        if found:
            self._horizon = found[-1].key
        self._kept += found
        return bool(found)


class Changing(Once):
    """The unfired matches of a body whose matches do not only arise by insertions: searched anew after each change."""

    def __init__(
        self, body: tuple[Conjunct, ...], predicates: tuple[Predicate, ...], store: Store, dropped: Dropped
    ) -> None:
        super().__init__(plan(body, predicates), store, dropped)
        self._fired: set[Key] = set()
        self._changed = True
        self._complete = False

    def fire(self, facts: tuple[Fact, ...]) -> None:
        """Record that a match has fired: it may fire again only after it has ceased to hold and held again."""
        super().fire(facts)
        self._fired.add(key_of(facts))

    def touch(self) -> None:
        """Note that facts have changed: matches may have come or gone."""
        self._changed = True

    def _refresh(self, env: Env, now: Instant, on_failure: OnFailure) -> None:
        if self._changed:
            self._changed = False
            self._look(env, now, on_failure)

    def _look_further(self, env: Env, now: Instant, on_failure: OnFailure) -> bool:
        if self._complete or self._kept:
            return False
        self._look(env, now, on_failure)
        return bool(self._kept)

    def _look(self, env: Env, now: Instant, on_failure: OnFailure) -> None:
        """Search all matches: forget the fired ones that no longer hold, keep the first `MATCHES_MAX` others."""
        # Fired matches that are not found again are gone; if they come back, they may fire again.
        found: set[Key] = set()
        self._kept.clear()
        self._complete = True
        for match in _matches(Search(self._steps, self._store, env, now, on_failure)):
            if match.key in self._fired:
                found.add(match.key)
            elif len(self._kept) < MATCHES_MAX:
                self._kept.append(match)
            else:
                self._complete = False
        self._fired = found


def key_of(facts: Sequence[Fact]) -> Key:
    """Return the key of a match."""
    return tuple([fact.serial for fact in facts])


def _matches(search: Search) -> Iterator[Match]:
    for found in search.matches():
        yield Match(key_of(found), tuple(found))
