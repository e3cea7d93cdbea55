"""Which rules lead to which goals, step by step."""

from collections.abc import Sequence
from dataclasses import dataclass

from rmr.analysis.backward_chaining import HOME, resolved
from rmr.bytecode.program import Constant, InitialFact, InitialGoal, Kind, Program, Slot
from rmr.lang.explain.texts import PredicateNames, Spot, Texts
from rmr.lang.lower.goal_paths import GoalPaths, LeadingRank, TooMuch, agrees
from rmr.lang.read.syntax import GoalItem

WAYS_MAX = 10_000
"""Rules that are listed for all goals of a program; of more only the number is given."""


@dataclass(frozen=True, slots=True)
class LeadingRule:
    """A rule that leads to a goal."""

    rule: int
    """Index into the program's rules."""
    rank: int | None
    """How many further firings are needed after one of this rule; None: it depends on the match or the robot."""
    rank_min: int
    """How many at least."""
    derives: str
    """The fact that leads there."""
    owner: str | None
    """What must be the robot itself for the fact to stay at home; None: it is."""
    action: str | None
    """The action of the head of which this fact is the declared effect; None: the head says it."""
    needed_by: int | None
    """The rule that needs the fact; None: it is the goal."""


@dataclass(frozen=True, slots=True)
class ExplainedGoal:
    """A goal that the program states."""

    goal: str
    place: Spot
    robot: int | None
    """Whose it is; None: every robot's."""
    worked_out: bool
    """False: too many ways lead there, robots find them as they go."""
    stated: bool
    """A stated fact fulfils it at the start."""
    sensed: bool
    """The robots sense whether it holds."""
    rules: tuple[LeadingRule, ...]
    """The nearest first."""
    rules_left_out: int


class GoalExplainer:
    """Explains the goals of one program, within bounds for all of them."""

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
        told = nearest[: self._left]
        self._left -= len(told)
        return ExplainedGoal(
            goal="?" + self._texts.line(item.fact.span).removeprefix("?"),
            place=self._texts.spot(item.span),
            robot=goal.owner,
            worked_out=ways is not None,
            stated=any(_fulfils(fact, goal) for fact in self._program.facts),
            sensed=self._program.predicates[goal.predicate].kind is Kind.SENSED,
            rules=tuple([self._leading(way) for way in told]),
            rules_left_out=len(nearest) - len(told),
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
