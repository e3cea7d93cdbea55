"""Finding a part of the matches of a body without ``not``: those with a new fact, those between two keys.

A key is the serials of a match's facts. The search visits the keys in ascending order, so what lies before or
behind is passed over without looking deeper.
"""

from collections.abc import Iterator

from rmr.base.time import Instant
from rmr.vm.match import AtomStep, Env, OnFailure, Plan, Search, agrees, candidates
from rmr.vm.store import Fact, Store


class Ordered(Search):
    """A search for the matches that have a fact newer than `since`, and come after `after` and not after `upto`."""

    def __init__(
        self,
        steps: Plan,
        store: Store,
        env: Env,
        now: Instant,
        on_failure: OnFailure,
        *,
        since: int = 0,
        after: tuple[int, ...] = (),
        upto: tuple[int, ...] = (),
    ) -> None:
        """`since` is a serial, 0: any fact; `after` and `upto` are keys, (): no bound."""
        super().__init__(steps, store, env, now, on_failure)
        self._since = since
        self._after = after
        self._upto = upto
        predicates = [step.predicate for step in steps if isinstance(step, AtomStep)]
        fresh = [level for level, predicate in enumerate(predicates) if store.tables[predicate].newest > since]
        self._last_fresh = max(fresh, default=-1)
        """The last atom that can take a new fact."""

    def matches(self) -> Iterator[list[Fact]]:
        """Yield the facts of each match, in order."""
        if self._since and self._last_fresh < 0:
            return iter(())
        return super().matches()

    def facts(self, step: AtomStep) -> Iterator[Fact]:
        """Yield the facts within the bounds that match the atom alone, oldest first."""
        level, key = len(self.found), tuple([fact.serial for fact in self.found])
        first, last = self._bounds(level, key)
        some = candidates(step, self.store, self.env)
        if self._since and level == self._last_fresh and max(key, default=0) <= self._since:
            newest = []
            for fact in reversed(some):
                if fact.serial <= self._since:
                    break
                newest.append(fact)
            some = newest[::-1]
        for fact in some:
            if fact.serial < first:
                continue
            if last is not None and fact.serial > last:
                return
            if agrees(step, fact.args, self.env):
                yield fact

    def _bounds(self, level: int, key: tuple[int, ...]) -> tuple[int, int | None]:
        """Return the serials between which the fact at `level` of a match that begins with `key` must lie."""
        first, last = 0, None
        if self._after and self._after[:level] == key:
            first = self._after[level] + (level + 1 == len(self._after))
        if self._upto and self._upto[:level] == key:
            last = self._upto[level]
        return first, last
