"""Which rule goes next (paper figure 6, `selectOneRule`), as the paper says it.

Satisfied rules are ranked by how near their firing brings an open goal: first those that derive one, then
those from which one more firing leads there, and so on, last those from which none follows. Among those of
the best rank one is drawn uniformly (one draw from the robot's stream, and only when there is a choice), or
the first in the text is taken; of that rule's matches of that rank the oldest facts go first. A rule that
consumes nothing would be satisfied for ever, so it fires once for each match, and again when the match has
gone and come back.

A rule is matched again only when a predicate that it mentions has changed since (or a goal to which it may
lead); a quiet machine does nothing.
"""

from collections.abc import Iterator
from random import Random

from rmr.base.time import Instant
from rmr.base.values import Robot
from rmr.bytecode.heads import bodies, codes
from rmr.bytecode.opcodes import FUNCTIONS, Op
from rmr.bytecode.program import Atom, Code, Mode, Program, Rule, Strategy
from rmr.vm.derive import Derivation, PlannedRule
from rmr.vm.events import ExpressionFailed, VmEvent
from rmr.vm.goals import Goals
from rmr.vm.match import Env, Found, matches
from rmr.vm.store import Store

FAILURES_MAX = 1024
"""Failed expressions remembered, so that each match without value is reported and counted once."""

UNRANKED = 1 << 30
"""Comes after every rank."""

Key = tuple[int, ...]


class Candidate:
    """The match with which a rule would fire."""

    __slots__ = ("derivation", "key", "rank")

    def __init__(self, key: Key, derivation: Derivation, rank: int) -> None:
        self.key = key
        self.derivation = derivation
        self.rank = rank


class RuleState:
    """What one robot knows about one of its rules."""

    __slots__ = ("candidate", "consumes", "fired", "index", "negative", "planned", "stale", "timed")

    def __init__(self, index: int, rule: Rule, program: Program) -> None:
        self.index = index
        self.planned = PlannedRule(rule, program.predicates)
        self.consumes = bool(self.planned.taken)
        self.negative = any(isinstance(item, Atom) and item.mode is Mode.ABSENT for item in rule.body)
        self.timed = any(uses_now(code) for code in codes(rule.head))
        self.fired: set[Key] = set()
        self.candidate: Candidate | None = None
        self.stale = False


class Interpreter:
    """Keeps for each rule whether it is satisfied, and chooses."""

    def __init__(self, program: Program, robot: Robot, store: Store, goals: Goals, rng: Random) -> None:
        self.busy = False
        """Whether a rule may be satisfied."""
        self.failures = 0
        """Matches that did not fire because an expression had no value."""
        self.failed: list[VmEvent] = []
        """The events of those that are new."""
        self._store = store
        self._robot = robot
        self._goals = goals
        self._rng = rng
        self._textual = program.strategy is Strategy.TEXTUAL
        self._states = [RuleState(index, rule, program) for index, rule in enumerate(program.rules)]
        self._stale: list[RuleState] = []
        self._readers: list[list[RuleState]] = [[] for _ in program.predicates]
        self._known_failures: dict[Key, None] = {}
        for state, rule in zip(self._states, program.rules, strict=True):
            for predicate in dict.fromkeys(mentioned(rule)):
                self._readers[predicate].append(state)
            self._mark(state)

    def touch(self, predicate: int) -> None:
        """Note that the facts of `predicate` have changed."""
        for state in self._readers[predicate]:
            self._mark(state)

    def touch_goal(self, predicate: int) -> None:
        """Note that the goals of `predicate` have changed."""
        for rule in self._goals.leading(predicate):
            state = self._states[rule]
            if state.candidate is not None:
                self._mark(state)

    def resume(self) -> None:
        """Begin a run at another instant: what a head says of now() is to be said anew."""
        for state in self._states:
            if state.timed and state.candidate is not None:
                self._mark(state)

    def select(self, now: Instant) -> tuple[int, Derivation] | None:
        """Return the next firing (the rule's index, what it does), or None at quiescence."""
        for state in self._stale:
            state.stale = False
            self._refresh(state, now)
        self._stale.clear()
        best = self._best()
        if not best:
            self.busy = False
            return None
        state = best[0] if self._textual or len(best) == 1 else best[self._rng.randrange(len(best))]
        candidate = state.candidate
        assert candidate is not None
        if not state.consumes:
            state.fired.add(candidate.key)
        self._mark(state)
        return state.index, candidate.derivation

    def _mark(self, state: RuleState) -> None:
        if not state.stale:
            state.stale = True
            self._stale.append(state)
            self.busy = True

    def _best(self) -> list[RuleState]:
        """Return the satisfied rules that have the best rank, in program order."""
        lowest = UNRANKED
        best: list[RuleState] = []
        for state in self._states:
            candidate = state.candidate
            if candidate is None or candidate.rank > lowest:
                continue
            if candidate.rank < lowest:
                lowest = candidate.rank
                best.clear()
            best.append(state)
        return best

    def _refresh(self, state: RuleState, now: Instant) -> None:
        """Look for the match with which a rule would fire: the best rank, then the oldest facts."""
        state.candidate = None
        nearest = self._goals.nearest(state.index)
        whole = state.negative and not state.consumes
        seen: set[Key] = set()
        for key, env, found in self._matches(state, now):
            if not state.consumes:
                seen.add(key)
                if key in state.fired:
                    continue
            best = self._better(state, key, env, found, now, nearest)
            if best is not None and not whole and (nearest is None or best.rank <= nearest):
                return
        state.fired &= seen

    def _matches(self, state: RuleState, now: Instant) -> Iterator[tuple[Key, Env, Found]]:
        """Yield the rule's matches with the serials of their facts."""
        env: Env = [self._robot] * state.planned.slots

        def failed(step: int, found: Found, reason: str) -> None:
            self._fail(state, (len(state.planned.head), step, *(fact.serial for fact in found)), reason, now)

        for found in matches(state.planned.steps, self._store, env, now, failed):
            yield tuple([fact.serial for fact in found]), env, found

    def _better(
        self, state: RuleState, key: Key, env: Env, found: Found, now: Instant, nearest: int | None
    ) -> Candidate | None:
        """Make a match the rule's candidate if it derives something and no other is as good; return the candidate."""
        best = state.candidate
        if best is not None and (nearest is None or best.rank <= nearest):
            return best
        derivation = state.planned.derive(
            self._store, env, found, now, lambda what, reason: self._fail(state, what, reason, now)
        )
        if derivation is None:
            return best
        rank = self._goals.rank(state.index, derivation.derived, now) if nearest is not None else None
        number = UNRANKED if rank is None else rank
        if best is None or number < best.rank:
            state.candidate = best = Candidate(key, derivation, number)
        return best

    def _fail(self, state: RuleState, what: Key, reason: str, now: Instant) -> None:
        """Count a match whose expression has no value, once."""
        key = (state.index, *what)
        if key in self._known_failures:
            return
        if len(self._known_failures) >= FAILURES_MAX:
            del self._known_failures[next(iter(self._known_failures))]
        self._known_failures[key] = None
        self.failures += 1
        self.failed.append(ExpressionFailed(f"rule {state.index}", reason, now))


def mentioned(rule: Rule) -> Iterator[int]:
    """Yield the predicates on which it depends whether the rule is satisfied and what it does."""
    for body in bodies(rule):
        for conjunct in body:
            if isinstance(conjunct, Atom):
                yield conjunct.predicate


def uses_now(code: Code) -> bool:
    """Tell whether an expression depends on the time."""
    return any(i.op is Op.CALL and isinstance(i.operand, int) and FUNCTIONS[i.operand].name == "now" for i in code)
