"""The ranks of matches at an instant of the past, worked out anew from the facts and goals of that instant.

A robot's log has the rank of the match that fired, and of the best match of each other rule. That of any other match
is computed here in the way of the machine (`rmr.vm.ranks`), without a bound on the work of a tick.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from rmr.analysis.goal_levels import RANKING_RUNS_MAX
from rmr.base.time import Instant
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Pattern, Program
from rmr.vm.bounds import Dropped
from rmr.vm.derive import Chain
from rmr.vm.goals import Goals
from rmr.vm.interpreter import plans_of
from rmr.vm.match import bind_again
from rmr.vm.provenance import FiringRecord
from rmr.vm.ranks import ESTIMATE, PENDING, GoalStep
from rmr.vm.store import Fact, Store
from rmr.why.past_items import PastFact
from rmr.why.rule_words import item_text, rule_name


class RankSource(StrEnum):
    """How a rank was found."""

    COMPILED = "compiled"
    """It is the same for all matches of the rule, whatever facts hold."""
    FACTS = "facts"
    """The length of the shortest way over the facts that hold."""
    ESTIMATE = "estimate"
    """No such way: all other facts are taken for granted."""
    NONE = "none"
    """No open goal follows."""
    UNKNOWN = "unknown"
    """The head draws numbers by chance, or the search was given up."""


@dataclass(slots=True, frozen=True)
class PastRank:
    """The rank of a match."""

    rank: int | None
    source: RankSource
    way: tuple[GoalStep, ...] = ()
    """Of a rank over facts: the firings after this one, up to the goal."""

    @property
    def text(self) -> str:
        """The rank in words."""
        match self.source:
            case RankSource.COMPILED:
                return f"rank {self.rank}, the same for every match"
            case RankSource.FACTS:
                return f"rank {self.rank} over the facts that held"
            case RankSource.ESTIMATE:
                return f"rank {self.rank} by estimate: there was no way over the facts that held"
            case RankSource.NONE:
                return "no rank: no open goal follows"
            case RankSource.UNKNOWN:
                return "its rank is not known"


class OpenGoal(NamedTuple):
    """A goal that was open."""

    predicate: int
    args: tuple[Pattern, ...]


class PastRanks:
    """Facts and open goals of one robot at one instant."""

    def __init__(
        self, program: Program, robot: int, now: Instant, facts: Iterable[PastFact], goals: Iterable[OpenGoal]
    ) -> None:
        """`facts` are those that held."""
        self._program = program
        self._robot = Robot(robot)
        self._now = now
        self._store = Store(program.predicates)
        self._facts: dict[int, Fact] = {
            fact.serial: self._store.insert(fact.predicate, fact.args, fact.at)
            for fact in sorted(facts, key=lambda each: each.serial)
        }
        self._goals = Goals(program, self._robot, self._store, [], Dropped([]))
        for goal in goals:
            self._goals.want(now, goal.predicate, goal.args)

    def of(self, rule: int, serials: Sequence[int]) -> PastRank:
        """Return the rank of the match of `rule` with the facts of these serial numbers, in the order of its body."""
        planned = plans_of(self._program)[rule]
        if planned.drawn:
            return PastRank(None, RankSource.UNKNOWN)
        facts = [self._facts[serial] for serial in serials]
        env: list[Value] = [self._robot] * planned.slots
        bind_again(planned.steps, facts, env, self._now)
        effect = planned.derive(self._store, env, facts, self._now, _ignored)
        return PastRank(None, RankSource.NONE) if effect is None else self._of_derived(rule, effect.derived)

    def of_firing(self, record: FiringRecord) -> PastRank:
        """Return the rank that a firing at this instant had."""
        return self._past_rank(record.rule, record.rank, [origin.chain for origin in record.derived])

    def _of_derived(self, rule: int, derived: Sequence[Chain]) -> PastRank:
        return self._past_rank(rule, self._rank(rule, derived), derived)

    def _past_rank(self, rule: int, found: int | None, derived: Sequence[Chain]) -> PastRank:
        if found is None:
            return PastRank(None, RankSource.NONE)
        if found == PENDING:
            return PastRank(None, RankSource.UNKNOWN)
        if found >= ESTIMATE:
            return PastRank(found - ESTIMATE, RankSource.ESTIMATE)
        if self._goals.is_settled(rule):
            return PastRank(found, RankSource.COMPILED)
        self._rank(rule, derived)  # runs the search to its end
        return PastRank(found, RankSource.FACTS, tuple(self._goals.way(derived, self._now)))

    def _rank(self, rule: int, derived: Sequence[Chain]) -> int | None:
        """Return the rank as the machine has it, with the search run to its end."""
        if not self._goals.open or self._goals.nearest(rule) is None:
            return None
        for _ in range(RANKING_RUNS_MAX):
            self._goals.begin(self._now)
            self._goals.settle()
            rank = self._goals.rank(rule, derived, self._now)
            if rank != PENDING:
                return rank
        return PENDING


def way_text(program: Program, robot: int, way: Sequence[GoalStep]) -> str:
    """Return the firings of a way: what each derives, by which rule, over which facts."""
    steps = []
    for step in way[:10]:  # steps of a way that an answer shows, the first ones; of the others the number
        over = ", ".join(item_text(program, predicate, robot, args) for predicate, args in step.facts)
        derives = item_text(program, step.predicate, robot, step.args)
        steps.append(f"{derives} by {rule_name(program, step.rule)}" + (f" over {over}" if over else ""))
    more = len(way) - len(steps)
    return "; ".join(steps) + (f"; and {more} more" if more else "")


def _ignored(part: int, step: int, facts: Sequence[Fact], reason: str) -> None:
    del part, step, facts, reason
