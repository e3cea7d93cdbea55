"""Goals: what the robot wants to hold (paper III.B).

A goal is open until its robot inserts a matching fact of any kind, or at once if it holds one; deriving it
again opens it again. Goals steer the choice among satisfied rules (paper figure 6): a firing that derives an
open goal has rank 0, one from whose facts k further firings lead to one has rank k (ranks.py), and one from
which no open goal follows has none.
"""

from collections import deque
from collections.abc import Iterator

from rmr.base.time import Instant, in_seconds
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Anything, Constant, Program
from rmr.bytecode.wire import identity
from rmr.vm.assertions import goal_text
from rmr.vm.derive import Chain, Derived, Role
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.events import GoalAchieved
from rmr.vm.match import pattern_agrees
from rmr.vm.ranks import Ranks
from rmr.vm.store import Args, Store

ACHIEVED_MAX = 1024
"""Achievements remembered for the report; beyond that the oldest are forgotten."""

GoalArgs = tuple[Anything | Constant, ...]


class Goals:
    """The goals of one robot."""

    def __init__(self, program: Program, robot: Robot, store: Store) -> None:
        self._program = program
        self._robot = robot
        self._store = store
        self._open: dict[int, dict[object, GoalArgs]] = {}
        self._ranks = Ranks(program, robot)
        self._achieved: deque[tuple[str, float]] = deque(maxlen=ACHIEVED_MAX)

    def wanted(self, predicate: int) -> bool:
        """Tell whether a goal of `predicate` is open."""
        return predicate in self._open

    def want(self, now: Instant, predicate: int, args: GoalArgs) -> list[GoalAchieved]:
        """Open a goal, or discharge it at once if a fact holds that matches."""
        goals = self._open.setdefault(predicate, {})
        key = tuple(identity(p.value) if isinstance(p, Constant) else "_" for p in args)
        if key not in goals:
            goals[key] = args
            self._ranks.forget()
        for fact in self._store.tables[predicate].facts.values():
            if pattern_agrees(args, fact.args):
                return self.inserted(now, predicate, fact.args)
        return []

    def inserted(self, now: Instant, predicate: int, args: Args) -> list[GoalAchieved]:
        """Discharge the goals that a fact fulfils."""
        goals = self._open.get(predicate, {})
        met = [key for key, goal in goals.items() if pattern_agrees(goal, args)]
        events = []
        for key in met:
            goal = goals.pop(key)
            self._ranks.forget()
            self._achieved.append((self._text(predicate, goal), in_seconds(now)))
            events.append(GoalAchieved(predicate, tuple(p.value if isinstance(p, Constant) else p for p in goal), now))
        if not goals:
            self._open.pop(predicate, None)
        return events

    def report(self) -> dict[str, list[list[object]] | list[str]]:
        """Return the goals achieved, each with the time in seconds, and those open, as the report lists them."""
        still = [self._text(predicate, goal) for predicate, goals in self._open.items() for goal in goals.values()]
        return {"achieved": [[text, at] for text, at in self._achieved], "open": sorted(still)}

    def nearest(self, predicates: tuple[int, ...]) -> int | None:
        """Return the lowest rank that a firing can have which derives `predicates`; None if no open goal follows."""
        if not self._open:
            return None
        distances = self._ranks.nearest(self._open)
        return min([distances[each] for each in predicates if each in distances], default=None)

    def leading(self, predicate: int) -> dict[int, int]:
        """Return the predicates from which rules may lead to a goal of `predicate`."""
        return self._ranks.leading(predicate)

    def rank(self, derived: list[Chain], now: Instant) -> int | None:
        """Return how many firings lie between this one and an open goal: 0 if it derives one, None if none follows."""
        distances = self._ranks.nearest(self._open)
        items = [item for chain in derived for item in chain]
        facts = [fact for item in items for fact in self._facts(item, now) if fact[0] in distances]
        return self._ranks.of(facts, self._wanted()) if facts else None

    def _wanted(self) -> Iterator[tuple[int, GoalArgs]]:
        return ((predicate, args) for predicate, goals in self._open.items() for args in goals.values())

    def _facts(self, item: Derived, now: Instant) -> Iterator[tuple[int, Args]]:
        """Yield the facts of this robot that an item of a head is or, being an action, brings about."""
        if item.owner != self._robot or item.role is Role.GOAL:
            return
        if item.role is Role.FACT:
            yield item.predicate, item.args
            return
        env: list[Value] = [self._robot, *item.args]
        for effect in self._program.predicates[item.predicate].effects:
            try:
                yield effect.predicate, tuple([evaluate(code, env, now) for code in effect.args])
            except NoValue:
                continue

    def _text(self, predicate: int, goal: GoalArgs) -> str:
        return goal_text(self._program.predicates[predicate].name, self._robot, goal)
