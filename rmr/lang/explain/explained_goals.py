"""Which rules lead to which goals, step by step."""

from collections.abc import Sequence
from dataclasses import dataclass

from rmr.analysis.backward_chaining import HOME, resolved
from rmr.analysis.goal_levels import EDGES_MAX, RANKING_RUNS_MAX, RANKING_STEPS, STEPS_MAX
from rmr.bytecode.program import Constant, InitialFact, InitialGoal, Kind, Program, Slot
from rmr.lang.explain.texts import PredicateNames, Spot, Texts
from rmr.lang.lower.goal_paths import GoalPaths, LeadingRank, TooMuch, agrees
from rmr.lang.read.syntax import GoalItem

WAYS_MAX = 10_000
"""Largest number of listed rules for all goals of a program; of further ones only the number."""

COMPILED = "compiled"
"""The rank is in the byte-code: the same for every match, whatever facts hold."""
SEARCHED = "searched"
"""A robot searches for the rank of each match: the shortest way over its facts, else an estimate."""


@dataclass(frozen=True, slots=True)
class RankingBudget:
    """Bounds on a robot's search for ranks."""

    steps_per_tick: int = RANKING_STEPS
    """Steps of the search in one tick."""
    ticks_waited: int = RANKING_RUNS_MAX
    """Ticks in a row for which the robot fires nothing while ranks are not known; then it takes estimates."""
    steps_kept: int = EDGES_MAX
    """Steps and facts that the search keeps; beyond that there are only estimates."""
    estimate_steps: int = STEPS_MAX
    """Steps of the estimates for one set of goals; what lies beyond has no rank."""


@dataclass(frozen=True, slots=True)
class LeadingRule:
    """A rule that leads to a goal."""

    rule: int
    """Index into the program's rules."""
    rank: int | None
    """Number of further firings after one of this rule; None: it depends on the match or the robot."""
    rank_min: int
    """Least number of further firings."""
    ranked_by: str
    """`COMPILED` or `SEARCHED`."""
    derives: str
    """The fact that leads there."""
    owner: str | None
    """The term that must equal the robot itself for the fact to stay at home; None if it always does."""
    action: str | None
    """The action with the fact as declared effect; None if the head derives the fact."""
    needed_by: int | None
    """The rule that needs the fact; None if the fact is the goal."""


@dataclass(frozen=True, slots=True)
class ExplainedGoal:
    """A goal that the program states."""

    goal: str
    place: Spot
    robot: int | None
    """The robot that has the goal; None: every robot."""
    worked_out: bool
    """False if the search budget was exhausted: robots then search at run time."""
    stated: bool
    """True if a stated fact fulfils it at the start."""
    sensed: bool
    """True if its predicate is sensed."""
    rules: tuple[LeadingRule, ...]
    """The leading rules, nearest first."""
    rules_left_out: int


class GoalExplainer:
    """Explains the goals of one program, within one budget for all of them."""

    def __init__(self, program: Program, rules: Sequence[PredicateNames], texts: Texts) -> None:
        """`rules` are the names of their variables."""
        self._program = program
        self._rules = rules
        self._texts = texts
        self._reach = GoalPaths(program)
        self._left = WAYS_MAX

    def explain(self, item: GoalItem, goal: InitialGoal) -> ExplainedGoal:
        """Return which rules lead to a goal."""
        ways = self._ways(goal)
        nearest = sorted(ways or (), key=lambda way: way.wanted.level)
        listed = nearest[: self._left]
        self._left -= len(listed)
        return ExplainedGoal(
            goal="?" + self._texts.line(item.fact.span).removeprefix("?"),
            place=self._texts.spot(item.span),
            robot=goal.owner,
            worked_out=ways is not None,
            stated=any(_fulfils(fact, goal) for fact in self._program.facts),
            sensed=self._program.predicates[goal.predicate].kind is Kind.SENSED,
            rules=tuple([self._leading(way) for way in listed]),
            rules_left_out=len(nearest) - len(listed),
        )

    def _ways(self, goal: InitialGoal) -> list[LeadingRank] | None:
        try:
            return self._reach.ways(goal)
        except TooMuch:
            return None

    def _leading(self, way: LeadingRank) -> LeadingRule:
        brought = way.brought
        wanted = way.wanted
        owner, *args = [resolved(term, brought.known) for term in (brought.owner, *brought.args)]
        predicates = self._program.predicates
        names = self._rules[way.rule]
        return LeadingRule(
            rule=way.rule,
            rank=way.rank,
            rank_min=wanted.level,
            ranked_by=SEARCHED if way.rank is None else COMPILED,
            derives=names.fact(predicates[brought.predicate], owner, tuple(args)),
            owner=None if owner == resolved(HOME, brought.known) else names.term(owner),
            action=None if brought.action is None else predicates[brought.action].name,
            needed_by=None if wanted.derivation is None else wanted.derivation.rule,
        )


def _fulfils(fact: InitialFact, goal: InitialGoal) -> bool:
    """Tell whether every robot that has the goal is given the fact, and the fact fulfils it."""
    if fact.predicate != goal.predicate or fact.owner not in (None, goal.owner):
        return False
    return agrees(goal.args, tuple([arg if isinstance(arg, Slot) else Constant(arg) for arg in fact.args]))
