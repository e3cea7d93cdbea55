"""Ranks: the number of further firings that lead from a firing to an open goal (paper III.B, figure 6).

For each goal that the program states the compiler has computed which rules lead to it, and their distance where all
firings of a rule have the same one (`InitialGoal.leads`). While only such goals are open, a known rank costs a look-up,
and a rule without a lead has no rank. In every other case a backward search from all open goals (`goal_levels`) finds
the level of the facts that a firing brings about; its result is kept until the goals change. Both ways agree: the
compiler states no rank where the search could run out of its budget.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping

from rmr.analysis.backward_chaining import HOME, Backwards, Patterns, Wanted
from rmr.analysis.goal_levels import Levels
from rmr.base.identity import ByIdentity
from rmr.base.values import Robot
from rmr.bytecode.octets import identity
from rmr.bytecode.program import Constant, Lead, Program
from rmr.vm.store import Args

GoalKey = tuple[int, tuple[object, ...]]
RuleRanks = dict[int, int]
"""By rule: its rank, or SEARCH. A rule that is missing has none."""

SEARCH = -1
"""Placeholder for a rank that differs between the firings of a rule and must be searched for."""


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
    """The ranks of one robot's firings; backward chaining is used only for goals without ranks from the compiler."""

    __slots__ = ("_goals", "_levels", "_nearest", "_ranks", "_reading", "_robot", "_stale", "_stated", "_unstated")

    def __init__(self, program: Program, robot: Robot, goals: Mapping[int, Mapping[GoalKey, Patterns]]) -> None:
        """`goals` are the open ones, by predicate."""
        self._robot = robot
        self._goals = goals
        self._reading = reading(program)
        self._stated = self._reading.stated(robot)
        self._unstated = False
        """Whether a goal without ranks from the compiler has ever been open."""
        self._ranks: RuleRanks | None = None
        self._nearest: dict[int, int] | None = None
        self._levels: Levels | None = None
        self._stale = True

    def change(self, key: GoalKey) -> None:
        """Note that a goal has been opened or discharged."""
        self._stale = True
        if key not in self._stated.ranks:
            self._unstated = True

    def leading(self, predicate: int) -> list[int]:
        """Return the rules whose firings may get another rank when the goals of `predicate` change."""
        return (self._reading if self._unstated else self._stated).leads.to(predicate)

    def nearest(self, rule: int) -> int | None:
        """Return the lowest rank that a firing of `rule` can have; None if no open goal follows from any."""
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
        if self._levels is None:
            self._levels = Levels(self._reading.backwards, self._wanted(), self._robot)
        return self._levels.lowest(near)

    def _wanted(self) -> Iterator[Wanted]:
        return ((predicate, args) for predicate, goals in self._goals.items() for args in goals.values())

    def _known(self, rule: int) -> int | None:
        """Return the rank of all firings of a rule, given the open goals; SEARCH if the compiler has not found it."""
        if self._stale:
            # Computed on demand: between two questions goals may change many times.
            self._stale = False
            self._nearest = self._levels = None
            leads = [self._stated.ranks.get(key) for goals in self._goals.values() for key in goals]
            known = [each for each in leads if each is not None]
            # One open goal without leads is enough to make the leads of the others useless.
            self._ranks = merged(known) if len(known) == len(leads) else None
        return SEARCH if self._ranks is None else self._ranks.get(rule)

    def _distances(self) -> dict[int, int]:
        """Return, by predicate from which rules lead to an open goal, a lower bound on the rank."""
        if self._nearest is None:
            self._nearest = {}
            for goal in self._goals:
                for predicate, distance in self._reading.backwards.distances(goal).items():
                    self._nearest[predicate] = min(distance, self._nearest.get(predicate, distance))
        return self._nearest
