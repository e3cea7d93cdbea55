"""The longest satisfied part of a body: the match that satisfies most conjuncts, where none satisfies all.

Depth-first search with a bound: each atom takes a fact that holds or is left out, and a branch that cannot satisfy more
conjuncts than the best match so far is not followed. Of equally good matches the first one counts: it satisfies the
earlier conjuncts, with the older facts.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from rmr.base.time import Instant
from rmr.base.values import Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Atom, Bind, Code, Conjunct, Constant, Fold, Guard, Mode, Pattern, Slot
from rmr.vm.evaluate import NoValue, evaluate, same
from rmr.why.past_items import PastFact

STEPS_MAX: Final = 20_000
"""Branches of one search; beyond that the best match so far counts."""

FACTS_MAX: Final = 200
"""Facts tried for one atom, the oldest ones."""

Env = list[Value | None]


class ConjunctVerdict(NamedTuple):
    """Whether a conjunct is satisfied."""

    holds: bool | None
    """None: it cannot be decided, because it needs the value of a conjunct that is not satisfied."""
    fact: PastFact | None = None
    """The fact that an atom has taken, or that blocks a ``not``."""
    reason: str = ""
    """Why an expression has no value."""


class PartialMatch(NamedTuple):
    """The best match of a body."""

    verdicts: tuple[ConjunctVerdict, ...]
    env: tuple[Value | None, ...]

    @property
    def satisfied(self) -> int:
        """Number of satisfied conjuncts."""
        return len([each for each in self.verdicts if each.holds])

    @property
    def complete(self) -> bool:
        """Whether the whole body is satisfied."""
        return self.satisfied == len(self.verdicts)


class PartialSearch:
    """One search."""

    def __init__(
        self, body: Sequence[Conjunct], facts: Callable[[int], Sequence[PastFact]], env: Env, now: Instant
    ) -> None:
        """`facts` returns those of a predicate that hold; `env` has the values that are known beforehand."""
        self._body = body
        self._facts = facts
        self._now = now
        self._steps = STEPS_MAX
        self._verdicts: list[ConjunctVerdict] = []
        self._best: PartialMatch | None = None
        self._search(env)

    @property
    def best(self) -> PartialMatch:
        """The best match."""
        assert self._best is not None
        return self._best

    def _search(self, env: Env) -> None:
        place = len(self._verdicts)
        count = len([each for each in self._verdicts if each.holds])
        self._steps -= 1
        hopeless = self._best is not None and count + len(self._body) - place <= self._best.satisfied
        if hopeless or (self._steps < 0 and self._best is not None):
            return
        if place == len(self._body):
            self._best = PartialMatch(tuple(self._verdicts), tuple(env))
            return
        conjunct = self._body[place]
        if isinstance(conjunct, Atom) and conjunct.mode is not Mode.ABSENT:
            self._take(conjunct, env)
            self._go_on(ConjunctVerdict(False), env)
        elif isinstance(conjunct, Atom):
            blocking = next((fact for fact in self._facts(conjunct.predicate) if matched(conjunct, fact, env)), None)
            self._go_on(ConjunctVerdict(blocking is None, blocking), env)
        elif isinstance(conjunct, Fold):
            # Its value at that time would need all facts of then, so it is left open, and what depends on it, too.
            self._go_on(ConjunctVerdict(None), env)
        else:
            own = env.copy()
            self._go_on(self._decided(conjunct, own), own)

    def _go_on(self, verdict: ConjunctVerdict, env: Env) -> None:
        self._verdicts.append(verdict)
        self._search(env)
        self._verdicts.pop()

    def _take(self, atom: Atom, env: Env) -> None:
        taken = [each.fact for each in self._verdicts]
        for fact in self._facts(atom.predicate)[:FACTS_MAX]:
            if atom.mode is not Mode.READ and fact in taken:
                continue
            bound = matched(atom, fact, env)
            if bound is not None:
                self._go_on(ConjunctVerdict(True, fact), bound)

    def _decided(self, conjunct: Guard | Bind, env: Env) -> ConjunctVerdict:
        """Return whether a condition holds; a binding is put into `env`."""
        if not _is_bound(conjunct.code, env):
            return ConjunctVerdict(None)
        try:
            value = evaluate(conjunct.code, env, self._now)  # type: ignore[arg-type]
        except NoValue as reason:
            return ConjunctVerdict(False, reason=str(reason))
        if isinstance(conjunct, Guard):
            return ConjunctVerdict(value is True)
        wanted = env[conjunct.slot]
        if wanted is None:
            env[conjunct.slot] = value
        return ConjunctVerdict(wanted is None or same(wanted, value))


def matched(atom: Atom, fact: PastFact, env: Env) -> Env | None:
    """Return `env` with what `fact` binds, or None if it does not match."""
    return bound_by(atom.args, fact.args, env)


def bound_by(patterns: Sequence[Pattern], args: Sequence[Value], env: Env) -> Env | None:
    """Return `env` with what `args` bind, or None if they do not match."""
    bound = env.copy()
    for pattern, value in zip(patterns, args, strict=True):
        if isinstance(pattern, Constant):
            known: Value | None = pattern.value
        elif isinstance(pattern, Slot):
            known = bound[pattern.index]
            if known is None:
                bound[pattern.index] = value
        else:
            continue
        if known is not None and not same(known, value):
            return None
    return bound


def _is_bound(code: Code, env: Env) -> bool:
    return all(each.op is not Op.LOAD or env[each.operand] is not None for each in code)  # type: ignore[index]
