"""Conflict resolution: which satisfied rule fires next, and for which match (paper figure 6, `selectOneRule`).

1. Rank: the number of further firings to an open goal. Rules that derive an open goal come first (rank 0), rules from
   which no open goal follows come last.
2. Urgency, with the deadline strategy only: of the firings of the best rank those for the job that is due first
   (`rmr.vm.urgency`).
3. Among the rules left one is drawn uniformly, or, with the textual strategy, the first in the text is taken. The
   robot's stream gives one draw, and only when there is a choice.
4. Among the rule's matches of that rank and urgency the oldest facts go first. While a goal ranks a rule that
   consumes, matches take turns by their kept facts: the least recently fired goes first (rotor.py).

A rule that consumes nothing fires once for each match (refraction), and again when the match has gone and come back.

Matching is incremental: a rule is matched again only after a change of a predicate that it mentions, or of a goal to
which it may lead. A quiescent machine does nothing.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from operator import attrgetter
from typing import Any

from rmr.base.identity import ByIdentity
from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.base.values import Robot
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.heads import bodies, codes, folds
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Atom, Bind, Code, Conjunct, Guard, Mode, Program, Rule, Strategy
from rmr.vm.bounds import Dropped
from rmr.vm.derive import Draws, FiringEffect, PlannedRule, draws_in
from rmr.vm.failures import Failures
from rmr.vm.goals import Goals
from rmr.vm.match import Env, OnFailure, Search
from rmr.vm.once import Changing, Growing, Once
from rmr.vm.ranks import PENDING
from rmr.vm.rotor import ROTOR_MATCHES_MAX
from rmr.vm.store import Args, Fact, Store, is_open
from rmr.vm.urgency import UNURGENT, Urgency

NEVER_FAILING = (Op.LOAD, Op.CONST, Op.INT, Op.EQ, Op.NE)
"""Instructions that have a value for all operands."""

UNRANKED = 1 << 30
"""Rank of a firing from which no open goal follows: greater than every other rank."""


plans_of: ByIdentity[Program, tuple[PlannedRule, ...]] = ByIdentity(
    lambda program: tuple([PlannedRule(rule, program.predicates) for rule in program.rules])
)
"""Returns the plans of a program's rules, the same for all robots of a process."""


class Candidate:
    """The match with which a rule would fire."""

    __slots__ = ("derivation", "facts", "last", "rank", "urgency")

    def __init__(self, facts: tuple[Fact, ...], derivation: FiringEffect, rank: int, urgency: int, last: int) -> None:
        self.facts = facts
        self.derivation = derivation
        self.rank = rank
        self.urgency = urgency
        """`UNURGENT` if the firing serves no job, or if that has no influence."""
        self.last = last
        """Turn of the rule's last firing for the same kept facts; 0: never."""


class RuleState:
    """The match state of one rule on one robot."""

    __slots__ = ("candidate", "firings", "index", "once", "planned", "stale", "timed")

    def __init__(self, index: int, planned: PlannedRule, program: Program, store: Store, dropped: Dropped) -> None:
        rule = program.rules[index]
        self.index = index
        self.planned = planned
        self.timed = any(uses_now(code) for code in codes(rule.head))
        self.once: Once | None = None
        """Of a rule that consumes nothing: the matches that have not fired."""
        if not self.planned.taken:
            self.once = (
                Growing(rule.body, program.predicates, store, dropped, may_fail=may_fail(rule))
                if is_monotone(rule, program)
                else Changing(rule.body, program.predicates, store, dropped)
            )
        self.candidate: Candidate | None = None
        self.stale = False
        self.firings = 0
        """Of a rule that draws: how often it has fired."""


class Interpreter:
    """Keeps for each rule the match with which it would fire, and chooses among them."""

    def __init__(
        self,
        program: Program,
        robot: Robot,
        store: Store,
        goals: Goals,
        choices: Choices,
        failures: Failures,
        dropped: Dropped,
        urgency: Urgency | None = None,
    ) -> None:
        self.busy = False
        """Whether a rule may be satisfied."""
        self._store = store
        self._robot = robot
        self._goals = goals
        self._choices = choices
        self._seed = choices.state
        self._failures = failures
        self._urgency = urgency
        self._urgency_seen = 0
        """Version of the jobs at the last selection."""
        self._textual = program.strategy is Strategy.TEXTUAL
        plans = enumerate(plans_of(program))
        self._states = [RuleState(index, planned, program, store, dropped) for index, planned in plans]
        self._stale: list[RuleState] = []
        self._readers: list[list[RuleState]] = [[] for _ in program.predicates]
        for state, rule in zip(self._states, program.rules, strict=True):
            for predicate in dict.fromkeys(mentioned(rule)):
                self._readers[predicate].append(state)
            self._mark(state)

    def touch(self, predicate: int) -> None:
        """Note that the facts of `predicate` have changed."""
        for state in self._readers[predicate]:
            if state.once is not None:
                state.once.touch()
            self._mark(state)

    def touch_goal(self, predicate: int) -> None:
        """Note that the goals of `predicate` have changed."""
        for rule in self._goals.leading(predicate):
            state = self._states[rule]
            if state.candidate is not None:
                self._mark(state)

    def _touch_ranks(self) -> None:
        """Note that ranks have changed that differ between the firings of a rule."""
        for state in self._states:
            if state.candidate is not None and not self._goals.is_settled(state.index):
                self._mark(state)

    def resume(self) -> None:
        """Begin a run at another instant: heads that call now() are evaluated again."""
        for state in self._states:
            if state.timed and state.candidate is not None:
                self._mark(state)

    def select(self, now: Instant) -> tuple[int, FiringEffect] | None:
        """Return the next firing (the rule's index, its effect), or None at quiescence, or to wait for ranks."""
        if self._goals.settle():
            self._touch_ranks()
        if self._urgency is not None and self._urgency.version != self._urgency_seen:
            self._urgency_seen = self._urgency.version
            for state in self._states:
                if state.candidate is not None:
                    self._mark(state)
        # In program order: matching reports failures, and their order is part of the result.
        for state in sorted(self._stale, key=attrgetter("index")):
            state.stale = False
            self._refresh(state, now)
        self._stale.clear()
        best = self._best()
        if not best:
            self.busy = False
            return None
        # A choice of one draws nothing: the stream must advance alike in every engine.
        assert best[0].candidate is not None
        if best[0].candidate.rank == PENDING:
            if self._goals.wait():
                return None
            self._touch_ranks()
            return self.select(now)
        state = best[0] if self._textual or len(best) == 1 else best[self._choices.below(len(best))]
        candidate = state.candidate
        assert candidate is not None
        if state.once is not None:
            state.once.fire(candidate.facts)
        elif candidate.rank != UNRANKED:
            self._goals.fire(now, state.index, args_of(candidate.facts))
        state.firings += 1
        self._mark(state)  # its match is used up
        return state.index, candidate.derivation

    def slots_of(self, rule: int, ago: int = 0) -> Env:
        """Return the slots for a match of a rule that would fire next, or that has fired `ago` firings of it ago."""
        state = self._states[rule]
        env: Env = [self._robot] * state.planned.slots
        if state.planned.drawn:
            draws: Any = Draws(self._seed, rule, state.firings - ago)
            env[-1] = draws
        return env

    def planned(self, rule: int) -> PlannedRule:
        """Return the plan of a rule."""
        return self._states[rule].planned

    def chosen(self, rule: int) -> Candidate:
        """Return the match with which `rule` fires, which `select` has just returned."""
        candidate = self._states[rule].candidate
        assert candidate is not None
        return candidate

    def rivals(self, rule: int) -> list[tuple[int, int, int]]:
        """Return the other rules that were satisfied when `select` returned `rule`, with their ranks and urgencies."""
        found = [(state.index, state.candidate) for state in self._states if state.index != rule]
        return [(index, candidate.rank, candidate.urgency) for index, candidate in found if candidate is not None]

    def _mark(self, state: RuleState) -> None:
        if not state.stale:
            state.stale = True
            self._stale.append(state)
            self.busy = True

    def _best(self) -> list[RuleState]:
        """Return the satisfied rules that have the best rank, and of these the most urgent, in program order."""
        lowest = UNRANKED
        most = UNURGENT
        best: list[RuleState] = []
        for state in self._states:
            candidate = state.candidate
            if candidate is None or candidate.rank > lowest or (candidate.rank == lowest and candidate.urgency > most):
                continue
            if candidate.rank < lowest or candidate.urgency < most:
                lowest = candidate.rank
                most = candidate.urgency
                best.clear()
            best.append(state)
        return best

    def _refresh(self, state: RuleState, now: Instant) -> None:
        """Find the match with which a rule would fire: best rank, most urgent, least recently fired, oldest."""
        state.candidate = best = None
        nearest = self._goals.nearest(state.index)  # lower bound on the rank; None: no match can have a rank
        turns = nearest is not None and state.once is None and self._goals.rotor.turns(state.index)
        urgency = self._urgency
        first = UNURGENT if urgency is None else urgency.first(state.index)  # lower bound on the urgency
        compared = 0
        env = self.slots_of(state.index)
        failed = partial(self._failures.match, now, state.index)
        for facts in self._matches(state, env, now, partial(failed, len(state.planned.head))):
            derivation = state.planned.derive(self._store, env, facts, now, failed)
            if derivation is None:
                continue
            ranked = self._goals.rank(state.index, derivation.derived, now) if nearest is not None else None
            rank = UNRANKED if ranked is None else ranked
            urgent = UNURGENT if urgency is None or first == UNURGENT else urgency.of(derivation.derived, now)
            last = self._goals.rotor.last(state.index, args_of(facts)) if turns and ranked is not None else 0
            if best is None or rank < best.rank or (rank == best.rank and urgent < best.urgency):
                state.candidate = best = Candidate(tuple(facts), derivation, rank, urgent, last)
                compared = 1
            elif rank == best.rank and urgent == best.urgency and compared < ROTOR_MATCHES_MAX:
                compared += 1
                if last < best.last:
                    state.candidate = best = Candidate(tuple(facts), derivation, rank, urgent, last)
            # No later match is better: without ranks the oldest wins; else the rank is the best possible, and this
            # match's kept facts have never fired or enough were compared. None is more urgent than `first`.
            if best.urgency <= first and (
                nearest is None or (best.rank <= nearest and (not best.last or compared >= ROTOR_MATCHES_MAX))
            ):
                return

    def _matches(self, state: RuleState, env: Env, now: Instant, on_failure: OnFailure) -> Iterator[Sequence[Fact]]:
        """Yield the matches with which a rule may fire, with their values in `env`."""
        if state.once is not None:
            return state.once.each(env, now, on_failure)
        return Search(state.planned.steps, self._store, env, now, on_failure).matches()


def args_of(facts: Sequence[Fact]) -> list[Args]:
    """Return the arguments of each fact."""
    return [fact.args for fact in facts]


def mentioned(rule: Rule) -> Iterator[int]:
    """Yield the predicates in the rule's bodies: they decide whether it is satisfied and what it derives."""
    for body in bodies(rule):
        for conjunct in body:
            if isinstance(conjunct, Atom):
                yield conjunct.predicate


def may_fail(rule: Rule) -> bool:
    """Return whether an expression of the body may have no value."""
    return any(each.op not in NEVER_FAILING for code in _codes(rule.body) for each in code)


def is_monotone(rule: Rule, program: Program) -> bool:
    """Return whether the body's matches depend on the presence of facts alone, in any order of search.

    The body has no ``not``, no fold, and nothing that depends on time or chance. It joins no atom with an open type:
    there the order of the atoms decides how strictly values are compared.
    """
    atoms = [each for each in rule.body if isinstance(each, Atom)]
    if any(folds(rule.body)) or any(atom.mode is Mode.ABSENT for atom in atoms):
        return False
    mixed = len(atoms) > 1 and any(is_open(kind) for atom in atoms for kind in program.predicates[atom.predicate].types)
    found = [*_codes(rule.body), *[function.code for function in program.functions]]
    return not mixed and not any(uses_now(code) or draws_in(code) for code in found)


def _codes(body: Sequence[Conjunct]) -> Iterator[Code]:
    return (each.code for each in body if isinstance(each, Guard | Bind))


def uses_now(code: Code) -> bool:
    """Return whether an expression depends on the time."""
    return any(i.op is Op.CALL and isinstance(i.operand, int) and FUNCTIONS[i.operand].timed for i in code)
