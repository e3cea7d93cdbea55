"""The machine over again, as naively as can be: all matches by brute force, at every firing, and nothing kept.

It says what rules mean where there is no chance: of the satisfied rules of the best rank the first in the text; of
its matches of that rank the one for whose kept facts it has fired least recently while it had a rank, then the one
with the oldest facts. There is one goal at most. Which rules lead there from farther off is told, with a rank for
where no way over the facts that hold leads there; ways are searched forwards, from what a firing derives. It shares
with the machine the value of an expression and nothing else.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from rmr.base.values import INT_MAX, INT_MIN, Robot, Value
from rmr.bytecode.arithmetic import NoValue, same
from rmr.bytecode.program import (
    Aggregate,
    Anything,
    Atom,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveAction,
    Derived,
    Guard,
    Kind,
    Mode,
    Operator,
    Program,
    Rule,
)
from rmr.vm.evaluate import evaluate

Args = tuple[Value, ...]
Env = dict[int, Value]


@dataclass(frozen=True)
class Fact:
    serial: int
    predicate: int
    args: Args


@dataclass
class Match:
    facts: list[Fact]
    env: Env
    consumed: list[Fact]

    @property
    def key(self) -> tuple[int, ...]:
        return tuple(fact.serial for fact in self.facts)

    @property
    def kept(self) -> tuple[tuple[int, Args], ...]:
        return tuple((fact.predicate, fact.args) for fact in self.facts if fact not in self.consumed)


UNRANKED = 1 << 30
ESTIMATE = 1 << 29


class Firing(NamedTuple):
    """What may happen next; the least does."""

    rank: int
    rule: int
    last: int
    key: tuple[int, ...]
    match: Match
    consumed: list[Fact]
    derived: list[tuple[Derived, Args]]


class StoppedError(Exception):
    """The firing as a whole does not happen."""


@dataclass
class Naive:
    program: Program
    facts: list[Fact] = field(default_factory=list)
    log: list[tuple[int, Args]] = field(default_factory=list)
    """The actions, in order."""
    firings: int = 0
    goal: tuple[int, Args] | None = None
    """A wanted fact; None again once it has been inserted."""
    leads: dict[int, int] = field(default_factory=dict)
    """The ranks of rules whose firings do not derive the goal."""
    _last: dict[tuple[int, object], int] = field(default_factory=dict)
    _serial: int = 0
    _fired: dict[int, set[tuple[int, ...]]] = field(default_factory=dict)

    def insert(self, predicate: int, args: Args) -> None:
        if self.program.predicates[predicate].kind is Kind.TEMPORARY or not self.holds(predicate, args):
            self._serial += 1
            self.facts.append(Fact(self._serial, predicate, args))
            if (predicate, args) == self.goal:
                self.goal = None

    def withdraw(self, predicate: int, args: Args) -> None:
        self.facts = [fact for fact in self.facts if (fact.predicate, fact.args) != (predicate, args)]

    def holds(self, predicate: int, args: Args) -> bool:
        return any(fact.predicate == predicate and fact.args == args for fact in self.facts)

    def fire(self) -> bool:
        """Fire what goes first; False if no rule is satisfied. Of every rule it is noticed which matches are gone."""
        unfired = [self.unfired(index, rule) for index, rule in enumerate(self.program.rules)]
        possible = [each for index, found in enumerate(unfired) for match in found for each in self.tried(index, match)]
        if not possible:
            return False
        best = min(possible, key=lambda each: each[:4])
        if not best.match.consumed:
            self._fired[best.rule].add(best.key)
        elif best.rank != UNRANKED:
            self._last[best.rule, best.match.kept] = 1 + max(self._last.values(), default=0)
        self.apply(best.match.consumed + best.consumed, best.derived)
        return True

    def tried(self, index: int, match: Match) -> Iterator[Firing]:
        """What comes of a match: nothing if an expression has no value."""
        try:
            consumed, derived = self.derive(self.program.rules[index], match)
        except (NoValue, StoppedError):
            return
        rank = UNRANKED
        if self.goal is not None:
            direct = self.goal in [(item.predicate, args) for item, args in derived]
            rank = 0 if direct else self.rank(index, derived)
        turns = match.consumed and rank != UNRANKED
        last = self._last.get((index, match.kept), 0) if turns else 0
        yield Firing(rank, index, last, match.key, match, consumed, derived)

    def rank(self, index: int, derived: list[tuple[Derived, Args]]) -> int:
        """The firings of the rules that lead to the goal, from what is derived there, while all other facts stay."""
        if index not in self.leads:
            return UNRANKED
        level = 0
        reached = {(item.predicate, args) for item, args in derived}
        edge = set(reached)
        while edge:
            level += 1
            edge = {after for fact in edge for rule in self.leads for after in self.after(rule, fact)} - reached
            if self.goal in edge:
                return level
            reached |= edge
        return ESTIMATE + self.leads[index]

    def after(self, index: int, given: tuple[int, Args]) -> Iterator[tuple[int, Args]]:
        """What a rule derives with a fact that need not hold, and others that do."""
        rule = self.program.rules[index]
        assumed = Fact(-1, *given)
        for match in self.matches(rule.body, Match([], {0: Robot(1)}, []), [assumed, *self.facts]):
            if assumed in match.facts:
                for item, args in self.derive(rule, match)[1]:
                    yield item.predicate, args

    def unfired(self, index: int, rule: Rule) -> list[Match]:
        found = list(self.matches(rule.body, Match([], {0: Robot(1)}, []), self.facts))
        fired = self._fired.setdefault(index, set())
        fired &= {match.key for match in found}
        return [match for match in found if match.key not in fired]

    def apply(self, consumed: list[Fact], derived: list[tuple[Derived, Args]]) -> None:
        self.firings += 1
        serials = [fact.serial for fact in consumed]
        assert len(set(serials)) == len(serials)
        self.facts = [fact for fact in self.facts if fact.serial not in serials]
        for item, args in derived:
            if isinstance(item, DeriveAction):
                self.log.append((item.predicate, args))
            else:
                self.insert(item.predicate, args)

    def matches(self, body: tuple[Conjunct, ...], so_far: Match, facts: list[Fact]) -> Iterator[Match]:
        if not body:
            yield so_far
            return
        first, rest = body[0], body[1:]
        if isinstance(first, Atom):
            fits = [(fact, env) for fact in facts if (env := self.unify(first, fact, so_far.env)) is not None]
            if first.mode is Mode.ABSENT:
                if not fits:
                    yield from self.matches(rest, so_far, facts)
                return
            for fact, env in fits:
                if first.mode is Mode.READ or fact not in so_far.facts:
                    taken = [*so_far.consumed, *([fact] if first.mode is Mode.CONSUME else [])]
                    yield from self.matches(rest, Match([*so_far.facts, fact], env, taken), facts)
            return
        try:
            value = value_of(first.code, so_far.env)
        except NoValue:
            return
        if isinstance(first, Bind):
            yield from self.matches(
                rest, Match(so_far.facts, {**so_far.env, first.slot: value}, so_far.consumed), facts
            )
        elif isinstance(first, Guard) and value is True:
            yield from self.matches(rest, so_far, facts)

    def unify(self, atom: Atom, fact: Fact, env: Env) -> Env | None:
        if fact.predicate != atom.predicate:
            return None
        bound = dict(env)
        for pattern, value in zip(atom.args, fact.args, strict=True):
            if isinstance(pattern, Anything):
                continue
            expected = pattern.value if isinstance(pattern, Constant) else bound.setdefault(pattern.index, value)
            if not same(expected, value):
                return None
        return bound

    def derive(self, rule: Rule, match: Match) -> tuple[list[Fact], list[tuple[Derived, Args]]]:
        """What the head consumes and derives. Raises NoValue or StoppedError."""
        consumed: list[Fact] = []
        derived: list[tuple[Derived, Args]] = []
        for head in rule.head:
            if isinstance(head, Comprehension | Aggregate):
                left = [fact for fact in self.facts if fact not in match.consumed and fact not in consumed]
                inner = self.inner(head, match, left)
                derived += inner[1]
                consumed += inner[0]
            else:
                assert hasattr(head, "predicate")
                derived.append(item(head, match.env))
        return consumed, derived

    def inner(
        self, head: Comprehension | Aggregate, match: Match, facts: list[Fact]
    ) -> tuple[list[Fact], list[tuple[Derived, Args]]]:
        consumed: list[Fact] = []
        derived: list[tuple[Derived, Args]] = []
        values: list[tuple[Value, Env]] = []
        for each in self.matches(head.body, Match([], match.env, []), facts):
            if any(fact in consumed for fact in each.consumed):
                continue
            try:
                if isinstance(head, Comprehension):
                    derived += [item(one, each.env) for one in head.head]
                else:
                    values.append((1 if head.term is None else value_of(head.term, each.env), each.env))
            except NoValue:
                continue
            consumed += each.consumed
        if isinstance(head, Aggregate):
            derived += aggregated(head, match.env, values)
        return consumed, derived


def aggregated(head: Aggregate, outer: Env, values: list[tuple[Value, Env]]) -> list[tuple[Derived, Args]]:
    alone = [value for value, _ in values]
    match head.operator:
        case Operator.COUNT:
            return [item(each, {**outer, head.result: len(alone)}) for each in head.head]
        case Operator.COLLECT:
            return [item(each, {**outer, head.result: tuple(alone)}) for each in head.head]
        case Operator.SUM:
            total = sum(alone)  # type: ignore[arg-type]
            if not INT_MIN <= total <= INT_MAX:
                raise StoppedError
            return [item(each, {**outer, head.result: total}) for each in head.head]
        case _:
            if not values:
                return []
            best = (min if head.operator is Operator.MIN else max)(alone)  # type: ignore[type-var]
            first = next(pair for pair in values if pair[0] == best)
            return [item(each, {**first[1], head.result: first[0]}) for each in head.head]


def item(head: Derived, env: Env) -> tuple[Derived, Args]:
    return head, tuple(value_of(code, env) for code in head.args)


def value_of(code: Code, env: Env) -> Value:
    return evaluate(code, [env.get(slot, False) for slot in range(1 + max(env))], 0)
