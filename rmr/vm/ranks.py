"""Ranks: the number of further firings that lead from a firing to an open goal (paper III.B, figure 6).

For each goal that the program states the compiler has computed which rules lead to it, and their distance where all
firings of a rule have the same one, whatever facts hold (`InitialGoal.leads`). While only such goals are open, a known
rank costs a look-up, and a rule without a lead has no rank.

In every other case the rank is the length of the shortest way from the facts that a firing brings about to an open
goal, over the facts that hold (`rmr.vm.goal_ways`). If there is no such way, the rank is an estimate that takes all
other facts for granted (`goal_levels`); estimates come after all ways over facts. Compiled ranks and searched ones
agree: the compiler states no rank that facts could change, or for which the estimate could run out of its budget.

Work is bounded: each `run` of the machine has a budget of `RANKING_STEPS`. While the search is not finished, a firing
whose rank is not known yet has the rank PENDING. A machine that would fire such a one waits for its next run, at most
`RANKING_RUNS_MAX` times; then it goes on by estimates until the search is finished, and reports it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from operator import itemgetter
from typing import NamedTuple

from rmr.analysis.backward_chaining import HOME, Backwards, Patterns, Wanted
from rmr.analysis.goal_levels import RANKING_RUNS_MAX, RANKING_STEPS, Levels
from rmr.analysis.regressions import regressions_of
from rmr.base.identity import ByIdentity
from rmr.base.values import Robot, Value
from rmr.bytecode.heads import items
from rmr.bytecode.octets import identity
from rmr.bytecode.program import GOALS_OF, Constant, DeriveGoal, Lead, Pattern, Program
from rmr.vm.goal_graph import FAR
from rmr.vm.goal_ways import GoalWays
from rmr.vm.store import Args, Holdings

GoalKey = tuple[int, tuple[object, ...]]
RuleRanks = dict[int, int]
"""By rule: its rank, or SEARCH. A rule that is missing has none."""

SEARCH = -1
"""Placeholder for a rank that differs between the firings of a rule and must be searched for."""

PENDING = 1 << 28
"""Rank of a firing while the search for it is not finished: greater than that of any way over facts."""

ESTIMATE = 1 << 29
"""Added to a rank that is an estimate: no way over the facts that hold leads from the firing to a goal."""


def rank_text(rank: int | None) -> str:
    """Return a rank in words."""
    if rank is None:
        return "no rank"
    if rank >= ESTIMATE:
        return f"rank {rank - ESTIMATE} if facts change, for there is no way over those that hold"
    return "no rank yet, for the search for it is not finished" if rank == PENDING else f"rank {rank}"


class GoalStep(NamedTuple):
    """A firing on a way to a goal."""

    rule: int
    predicate: int
    args: tuple[Value | Pattern, ...]
    """With `predicate`: what the firing derives."""
    facts: tuple[tuple[int, tuple[Value | Pattern, ...]], ...]
    """The other facts of its body that have to hold; what the step before derives is not among them."""


class Leads:
    """The rules that lead to goals of a predicate, computed on first use."""

    __slots__ = ("_known", "_look")

    def __init__(self, look: Callable[[int], list[int]]) -> None:
        self._look = look
        self._known: dict[int, list[int]] = {}

    def to(self, predicate: int) -> list[int]:
        """Return a superset of the rules that lead to a goal of `predicate`."""
        rules = self._known.get(predicate)
        if rules is None:
            rules = self._known[predicate] = self._look(predicate)
        return rules


class Stated:
    """The compiler's ranks for the goals that a program states for a robot."""

    __slots__ = ("leads", "ranks")

    def __init__(self, ranks: Mapping[GoalKey, RuleRanks]) -> None:
        self.ranks = ranks
        self.leads = Leads(self._lead)

    def _lead(self, predicate: int) -> list[int]:
        return sorted(merged(each for (goal, _), each in self.ranks.items() if goal == predicate))


class Reading:
    """The data shared by all robots of a program: the compiler's ranks, and the index for backward chaining."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._read: Backwards | None = None
        self._stated = [(goal, _ranks(goal.leads)) for goal in program.goals if goal.leads is not None]
        alike = all(goal.owner is None and HOME not in goal.args for goal, _ in self._stated)
        self._alike = self._work_out(Robot(0)) if alike else None
        """The compiler's ranks if they are the same for all robots, else None."""
        self.leads = Leads(self._lead)
        self.goal_tables = {
            index: program.index(each.name.removeprefix(GOALS_OF)) or 0
            for index, each in enumerate(program.predicates)
            if each.name.startswith(GOALS_OF)
        }
        """By predicate that stands for the open goals of another one: that one."""
        self.withdrawing: dict[int, frozenset[int]] = {}
        """By rule that withdraws goals: their predicates."""
        for rule, each in enumerate(program.rules if self.goal_tables else ()):
            wanted = [item.predicate for item in items(each.head) if isinstance(item, DeriveGoal)]
            tables = frozenset(self.goal_tables[table] for table in wanted if table in self.goal_tables)
            if tables:
                self.withdrawing[rule] = tables

    @property
    def backwards(self) -> Backwards:
        """The index for backward chaining, made on first use."""
        if self._read is None:
            self._read = Backwards(self._program)
        return self._read

    def stated(self, robot: Robot) -> Stated:
        """Return the compiler's ranks for the goals of `robot`."""
        return self._work_out(robot) if self._alike is None else self._alike

    def _work_out(self, robot: Robot) -> Stated:
        return Stated(
            {
                goal_key(goal.predicate, here(goal.args, robot)): ranks
                for goal, ranks in self._stated
                if goal.owner in (None, robot)
            }
        )

    def _lead(self, predicate: int) -> list[int]:
        distances = self.backwards.distances(predicate)
        brought = enumerate(self.backwards.brought)
        return [rule for rule, each in brought if any(fact in distances for fact in each)]


def _ranks(leads: Iterable[Lead]) -> RuleRanks:
    return {lead.rule: SEARCH if lead.rank is None else lead.rank for lead in leads}


reading = ByIdentity(Reading)
"""Returns the data shared by the robots of a program."""


def merged(leads: Iterable[RuleRanks]) -> RuleRanks:
    """Return the ranks of rules, given those for each goal."""
    ranks: RuleRanks = {}
    for each in leads:
        for rule, rank in each.items():
            ranks[rule] = nearer(ranks.get(rule, rank), rank)
    return ranks


def nearer(one: int, other: int) -> int:
    """Return the lower rank; SEARCH if it must be searched for, unless one of the two is 0, the lowest possible."""
    # SEARCH is -1: the minimum is SEARCH if either is, which is right unless the other one is 0, the best rank.
    return min(one, other) if SEARCH not in (one, other) or 0 not in (one, other) else 0


def goal_key(predicate: int, args: Patterns) -> GoalKey:
    """Return a key that is equal for identical goals only."""
    return predicate, tuple([identity(arg.value) if isinstance(arg, Constant) else repr(arg) for arg in args])


def here(args: Patterns, robot: Robot) -> Patterns:
    """Return a goal's arguments with `robot` in the place of the robot itself."""
    return tuple([Constant(robot) if arg == HOME else arg for arg in args]) if HOME in args else args


class Ranks:
    """The ranks of one robot's firings."""

    __slots__ = (
        "_budget",
        "_estimating",
        "_full",
        "_goals",
        "_holdings",
        "_levels",
        "_nearest",
        "_program",
        "_ranks",
        "_reading",
        "_robot",
        "_rooted",
        "_seen",
        "_stale",
        "_stated",
        "_unstated",
        "_waited",
        "_ways",
    )

    def __init__(
        self,
        program: Program,
        robot: Robot,
        goals: Mapping[int, Mapping[GoalKey, Patterns]],
        holdings: Holdings,
        full: Callable[[], None],
    ) -> None:
        """`goals` are the open ones, by predicate; `full` is called when a search has reached its bound."""
        self._program = program
        self._robot = robot
        self._goals = goals
        self._holdings = holdings
        self._full = full
        self._reading = reading(program)
        self._stated = self._reading.stated(robot)
        self._unstated = False
        """Whether a goal without ranks from the compiler has ever been open."""
        self._ranks: RuleRanks | None = None
        self._nearest: dict[int, int] | None = None
        self._levels: Levels | None = None
        self._stale = True
        self._ways: GoalWays | None = None
        """The search over facts; None if no rank depends on them."""
        self._rooted: dict[GoalKey, Patterns] = {}
        """The goals that the search knows."""
        self._seen = (0, -1)
        """State of the search at the last `settle`."""
        self._budget = RANKING_STEPS
        self._waited = 0
        self._estimating = False
        """Whether firings whose rank is not known yet have an estimate: the machine has waited for too long."""

    def change(self, key: GoalKey) -> None:
        """Note that a goal has been opened or discharged."""
        self._stale = True
        if key not in self._stated.ranks:
            self._unstated = True
        if not any(self._goals.values()):
            self._forget()  # while no goal is open, changes of facts are not reported

    def fact_changed(self, predicate: int, args: Args, holds: bool) -> None:
        """Note that a fact has been inserted or removed."""
        if self._ways is not None and not self._ways.changed(predicate, args, holds):
            self._forget()

    def begin(self) -> None:
        """Renew the budget: a run begins."""
        self._budget = RANKING_STEPS

    def settle(self) -> bool:
        """Bring the search up to date with goals and facts, within the budget; return whether a rank may differ."""
        if self._stale:
            self._refresh()
        ways = self._ways
        if ways is None:
            return False
        if self._budget:
            self._budget = ways.work(self._budget)
        if self._estimating and ways.is_done:
            self._estimating = False
            self._seen = (-1, -1)
        seen = ways.version, ways.exact
        differs = seen != self._seen
        self._seen = seen
        return differs

    def wait(self) -> bool:
        """Return whether the machine is to wait for the search; False if it has waited for too long."""
        self._waited += 1
        if self._waited <= RANKING_RUNS_MAX:
            return True
        self._waited = 0
        self._estimating = True
        return False

    def leading(self, predicate: int) -> list[int]:
        """Return the rules whose firings may get another rank when the goals of `predicate` change."""
        return (self._reading if self._unstated else self._stated).leads.to(predicate)

    def nearest(self, rule: int) -> int | None:
        """Return a lower bound on the rank of a firing of `rule`; None if no open goal follows from any."""
        rank = self._known(rule)
        if rank != SEARCH:
            return rank
        distances = self._distances()
        brought = self._reading.backwards.brought[rule]
        return min([distances[each] for each in brought if each in distances], default=None)

    def is_settled(self, rule: int) -> bool:
        """Return whether all firings of `rule` have the same rank."""
        return self._known(rule) != SEARCH

    def of(self, rule: int, facts: Iterable[tuple[int, Args]]) -> int | None:
        """Return the rank of a firing of `rule` that brings about `facts`; None if no open goal follows."""
        rank = self._known(rule)
        if rank != SEARCH:
            return rank
        # Distances by predicate are a cheap lower bound; facts that no goal can need are left out of the search.
        distances = self._distances()
        near = [fact for fact in facts if fact[0] in distances]
        if not near:
            return None
        assert self._ways is not None
        levels = [self._ways.level(*fact) for fact in near]
        lowest = min([level for level in levels if level is not None], default=FAR)
        if lowest < FAR:
            return lowest
        if None in levels and not self._estimating:
            return PENDING
        estimate = self.estimated(near)
        return None if estimate is None else ESTIMATE + estimate

    def way(self, facts: Iterable[tuple[int, Args]]) -> list[GoalStep]:
        """Return a shortest way from one of `facts` to an open goal, over the facts that hold; empty: none is known."""
        ways = self._ways
        if ways is None:
            return []
        known = [(level, each) for each in facts if (level := ways.level(*each)) is not None and level < FAR]
        nearest = min(known, key=itemgetter(0), default=None)
        return [
            GoalStep(
                step.rule,
                step.end.predicate,
                ways.shown(step.end.args),
                tuple([(predicate, ways.shown(row)) for predicate, row in step.facts]),
            )
            for step in ([] if nearest is None else ways.way(*nearest[1]))
        ]

    def estimated(self, facts: Iterable[tuple[int, Args]]) -> int | None:
        """Return the number of firings from one of `facts` to a goal if all else holds; None: no rule leads there."""
        if self._levels is None:
            self._levels = Levels(self._reading.backwards, self._wanted(), self._robot)
        return self._levels.lowest(facts)

    def _wanted(self) -> Iterator[Wanted]:
        return ((predicate, args) for predicate, goals in self._goals.items() for args in goals.values())

    def _known(self, rule: int) -> int | None:
        """Return the rank of all firings of a rule, given the open goals; SEARCH if it depends on the firing."""
        if self._stale:
            self._refresh()
        return SEARCH if self._ranks is None else self._ranks.get(rule)

    def _refresh(self) -> None:
        """Take note of the open goals. Done on demand: between two questions they may change many times."""
        self._stale = False
        self._nearest = self._levels = None
        self._waited = 0
        leads = [self._stated.ranks.get(key) for goals in self._goals.values() for key in goals]
        known = [each for each in leads if each is not None]
        # One open goal without leads is enough to make the leads of the others useless.
        self._ranks = merged(known) if len(known) == len(leads) else None
        if not leads or (self._ranks is not None and SEARCH not in self._ranks.values()):
            self._forget()
            self._stale = False
            return
        if self._ways is None:
            self._ways = GoalWays(regressions_of(self._program), self._robot, self._holdings.each, self._full)
            self._seen = (-1, -1)
        opened = {key: args for goals in self._goals.values() for key, args in goals.items()}
        for key, args in self._rooted.items():
            if key not in opened:
                self._ways.goal(key[0], args, wanted=False)
        for key, args in opened.items():
            if key not in self._rooted:
                self._ways.goal(key[0], args, wanted=True)
        self._rooted = opened

    def _forget(self) -> None:
        """Drop the graph; it is explored anew when it is next needed."""
        self._ways = None
        self._rooted = {}
        self._stale = True

    def _distances(self) -> dict[int, int]:
        """Return, by predicate from which rules lead to an open goal, a lower bound on the rank."""
        if self._nearest is None:
            self._nearest = {}
            for goal in self._goals:
                for predicate, distance in self._reading.backwards.distances(goal).items():
                    self._nearest[predicate] = min(distance, self._nearest.get(predicate, distance))
        return self._nearest
