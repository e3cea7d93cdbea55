"""Goals: patterns of facts that a robot is to bring about (paper III.B).

A goal is open until its robot inserts a matching fact of any kind; a matching fact that already holds discharges it at
once. Deriving it again opens it again.

Goals steer the choice among satisfied rules (paper figure 6). A firing that derives an open goal has rank 0. A firing
from whose facts k further firings lead to an open goal has rank k (`rmr.vm.ranks`). A firing from which no open goal
follows has no rank. Among a rule's matches of one rank a rotor takes turns (`rmr.vm.rotor`). An action that a firing
derives counts as those of its declared effects that are facts of this robot.
"""

from collections.abc import Iterator, Sequence

from rmr.analysis.backward_chaining import Patterns
from rmr.analysis.goal_levels import EDGES_MAX, RANKING_RUNS_MAX
from rmr.base.time import Instant, in_seconds
from rmr.base.values import Robot, Value
from rmr.bytecode.program import ANY, Constant, Program
from rmr.vm.assertions import goal_text
from rmr.vm.bounds import Dropped, remember
from rmr.vm.derive import Chain, Derived, DerivedKind
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.machine_events import GoalAchieved, VmEvent
from rmr.vm.match import pattern_agrees
from rmr.vm.ranks import GoalKey, GoalStep, Ranks, goal_key, here, reading
from rmr.vm.rotor import Rotor
from rmr.vm.store import Args, Holdings

GOALS_MAX = 1024
"""Open goals of one robot; beyond that a goal is dropped. The bound is on time: every firing is compared with them."""

ACHIEVED_MAX = 1024
"""Achievements remembered for the report; beyond that the oldest are forgotten."""


GoalArgs = Patterns
"""Patterns of a goal's arguments: constants, ANY, and slots for a variable that occurs twice."""


class Goals:
    """The goals of one robot."""

    __slots__ = (
        "_achieved",
        "_achievements",
        "_count",
        "_dropped",
        "_holdings",
        "_now",
        "_program",
        "_ranks",
        "_reading",
        "_robot",
        "open",
        "rotor",
    )

    def __init__(
        self, program: Program, robot: Robot, holdings: Holdings, events: list[VmEvent], dropped: Dropped
    ) -> None:
        self._program = program
        self._robot = robot
        self._holdings = holdings
        self._dropped = dropped
        self.open: dict[int, dict[GoalKey, Patterns]] = {}
        """Open goals by predicate; a predicate without open goals is missing."""
        self._count = 0
        self._ranks = Ranks(program, robot, self.open, holdings, self._graph_full)
        self._reading = reading(program)
        self._now: Instant = 0
        self._achieved: list[tuple[str, float]] = []
        self._achievements = 0
        self.rotor = Rotor(program, events, dropped)
        """Tie-break among a rule's matches of the same rank."""

    def want(self, now: Instant, predicate: int, args: GoalArgs) -> list[GoalAchieved]:
        """Open a goal, or discharge it at once if a fact holds that matches."""
        args = here(args, self._robot)
        key = goal_key(predicate, args)
        if key not in self.open.get(predicate, {}):
            if self._count >= GOALS_MAX:
                self._dropped.add("goals", GOALS_MAX, now)
                return []
            self._count += 1
            self.open.setdefault(predicate, {})[key] = args
            self._ranks.change(key)
        # A goal that holds is opened and discharged: that it was achieved is part of the report.
        for fact in self._holdings.each(predicate):
            if pattern_agrees(args, fact):
                return self.inserted(now, predicate, fact)
        return []

    def is_open(self, predicate: int, args: GoalArgs) -> bool:
        """Return whether this very goal is open."""
        return goal_key(predicate, here(args, self._robot)) in self.open.get(predicate, {})

    def withdraw(self, now: Instant, predicate: int, args: GoalArgs) -> list[tuple[object, ...]]:
        """Close the goals that a fact of constants would fulfil, and return their arguments; all, if one is ANY."""
        del now
        values = [arg.value for arg in here(args, self._robot) if isinstance(arg, Constant)]
        goals = self.open.get(predicate, {})
        whole = len(values) == len(args)
        met = [key for key, goal in goals.items() if not whole or pattern_agrees(goal, tuple(values))]
        gone: list[tuple[object, ...]] = []
        for key in met:
            goal = goals.pop(key)
            self._count -= 1
            self._ranks.change(key)
            gone.append(tuple([each.value if isinstance(each, Constant) else ANY for each in goal]))
        if not goals:
            self.open.pop(predicate, None)
        return gone

    def end(self, key: GoalKey) -> tuple[object, ...] | None:
        """Close this very goal and return its arguments; None if it is not open."""
        goals = self.open.get(key[0], {})
        goal = goals.pop(key, None)
        if goal is None:
            return None
        self._count -= 1
        self._ranks.change(key)
        if not goals:
            del self.open[key[0]]
        return tuple([each.value if isinstance(each, Constant) else ANY for each in goal])

    def inserted(self, now: Instant, predicate: int, args: Args) -> list[GoalAchieved]:
        """Discharge the goals that a fact fulfils."""
        goals = self.open.get(predicate, {})
        met = [key for key, goal in goals.items() if pattern_agrees(goal, args)]
        events = []
        for key in met:
            goal = goals.pop(key)
            self._count -= 1
            self._achievements += 1
            self._ranks.change(key)
            remember(self._achieved, (self._text(predicate, goal), in_seconds(now)), ACHIEVED_MAX)
            values = tuple([each.value if isinstance(each, Constant) else ANY for each in goal])
            events.append(GoalAchieved(predicate, values, now))
        if not goals:
            self.open.pop(predicate, None)
        return events

    def report(self) -> dict[str, list[list[object]] | list[str]]:
        """Return the goals achieved, each with the time in seconds, and those open, as the report lists them."""
        still = [self._text(predicate, goal) for predicate, goals in self.open.items() for goal in goals.values()]
        return {"achieved": [[text, at] for text, at in self._achieved], "open": sorted(still)}

    def nearest(self, rule: int) -> int | None:
        """Return the lowest rank that a firing of `rule` can have; None if no open goal follows."""
        if not self.open:
            return None
        return 0 if self._may_withdraw(rule) else self._ranks.nearest(rule)

    def is_settled(self, rule: int) -> bool:
        """Return whether all firings of `rule` have the rank `nearest`, so that none must be searched for."""
        return not self.open or (not self._may_withdraw(rule) and self._ranks.is_settled(rule))

    def _may_withdraw(self, rule: int) -> bool:
        """Return whether a firing of `rule` may withdraw a goal that is open."""
        withdrawn = self._reading.withdrawing.get(rule)
        return withdrawn is not None and any(predicate in self.open for predicate in withdrawn)

    def begin(self, now: Instant) -> None:
        """Renew the budget of the search for ranks: a run begins."""
        self._now = now
        self._ranks.begin()

    def settle(self) -> bool:
        """Bring ranks up to date with the facts, within the budget; return whether one may differ from before."""
        return bool(self.open) and self._ranks.settle()

    def wait(self) -> bool:
        """Return whether the machine waits for the ranks of its firings; say so when it has waited for too long."""
        if self._ranks.wait():
            return True
        self._dropped.add("ranking", RANKING_RUNS_MAX, self._now)
        return False

    def fact_changed(self, predicate: int, args: Args, holds: bool) -> None:
        """Note that a fact has been inserted or removed, while goals are open."""
        self._ranks.fact_changed(predicate, args, holds)

    def _graph_full(self) -> None:
        self._dropped.add("ways", EDGES_MAX, self._now)

    def leading(self, predicate: int) -> list[int]:
        """Return the rules whose firings may get another rank when the goals of `predicate` change."""
        withdrawing = self._reading.withdrawing
        if not withdrawing:
            return self._ranks.leading(predicate)
        rules = [rule for rule, withdrawn in withdrawing.items() if predicate in withdrawn]
        return sorted({*self._ranks.leading(predicate), *rules})

    def rank(self, rule: int, derived: Sequence[Chain], now: Instant) -> int | None:
        """Return the number of firings from this one to an open goal: 0 if it derives one, None if none follows.

        A firing that withdraws an open goal has rank 0 as well: else it would wait for ever behind those for the goal.
        """
        if self._may_withdraw(rule) and any(self._withdraws(item) for chain in derived for item in chain):
            return 0
        items = (item for chain in derived for item in chain)
        return self._ranks.of(
            rule, (each for item in items for each in facts_of(self._program, self._robot, item, now))
        )

    def way(self, derived: Sequence[Chain], now: Instant) -> list[GoalStep]:
        """Return a shortest way over facts from what a firing derives to an open goal; empty if none is known."""
        items = (item for chain in derived for item in chain)
        return self._ranks.way([each for item in items for each in facts_of(self._program, self._robot, item, now)])

    def _withdraws(self, item: Derived) -> bool:
        """Return whether an item of a head withdraws a goal that is open."""
        if item.role is not DerivedKind.GOAL or item.owner != self._robot:
            return False
        goals = self.open.get(self._reading.goal_tables.get(item.predicate, -1), {})
        return any(pattern_agrees(goal, item.args) for goal in goals.values())

    def fire(self, now: Instant, rule: int, facts: Sequence[Args]) -> None:
        """Record in the rotor that a rule which consumes and has a rank fires for a match with these facts."""
        self.rotor.fire(now, rule, facts, self._achievements)

    def _text(self, predicate: int, goal: GoalArgs) -> str:
        return goal_text(self._program.predicates[predicate].name, self._robot, goal)


def facts_of(program: Program, robot: Robot, item: Derived, now: Instant) -> Iterator[tuple[int, Args]]:
    """Yield the facts of `robot` that an item of a head states, or that the action's effects insert."""
    if item.role is DerivedKind.FACT and item.owner == robot:
        yield item.predicate, item.args
    if item.role is not DerivedKind.ACTION:
        return
    env: list[Value] = [item.owner, *item.args]
    for effect in program.predicates[item.predicate].effects:
        try:
            if evaluate(effect.owner, env, now) == robot:
                yield effect.predicate, tuple([evaluate(code, env, now) for code in effect.args])
        except NoValue:
            continue  # ranking must not report it: the effect reports its failure when the action ends
