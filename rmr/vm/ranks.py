"""Ranks: how many further firings lead from a firing to an open goal (paper III.B, figure 6).

The compiler has worked out, for the goals that the program states, which rules lead there and how far they are
where every firing of a rule is equally far (`InitialGoal.leads`). While only such goals are open, a rule that
is not among them has no rank, and one whose rank is known costs nothing. In every other case the facts that a
firing brings about are looked for backwards from all open goals (levels.py), until the goals change. Both say
the same: the compiler is silent where the search might be cut short.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping

from rmr.base.identity import ByIdentity
from rmr.base.values import Robot
from rmr.bytecode.backwards import HOME, Backwards, Patterns, Wanted
from rmr.bytecode.levels import Levels
from rmr.bytecode.program import Constant, Lead, Program
from rmr.bytecode.wire import identity
from rmr.vm.store import Args

GoalKey = tuple[int, tuple[object, ...]]
RuleRanks = dict[int, int]
"""By rule: its rank, or SEARCH. A rule that is missing has none."""

SEARCH = -1
"""In the place of a rank: it depends on the firing."""

reading = ByIdentity(Backwards)
"""A program read backwards; all robots share it."""


class Stated:
    """What the compiler has worked out for the goals that a program states."""

    def __init__(self, program: Program) -> None:
        self._leads = [(goal, _ranks(goal.leads)) for goal in program.goals if goal.leads is not None]
        alike = all(goal.owner is None and HOME not in goal.args for goal, _ in self._leads)
        self._alike = self._work_out(Robot(0)) if alike else None
        """What is the same for all robots."""

    def of(self, robot: Robot) -> Mapping[GoalKey, RuleRanks]:
        """Return it for the goals of `robot`."""
        return self._work_out(robot) if self._alike is None else self._alike

    def _work_out(self, robot: Robot) -> dict[GoalKey, RuleRanks]:
        return {
            goal_key(goal.predicate, here(goal.args, robot)): ranks
            for goal, ranks in self._leads
            if goal.owner in (None, robot)
        }


def _ranks(leads: Iterable[Lead]) -> RuleRanks:
    return {lead.rule: SEARCH if lead.rank is None else lead.rank for lead in leads}


stated = ByIdentity(Stated)
"""Returns what a program's compiler has worked out; all robots share it."""


def merged(leads: Iterable[RuleRanks]) -> RuleRanks:
    """Return the ranks of rules, given those for each goal."""
    ranks: RuleRanks = {}
    for each in leads:
        for rule, rank in each.items():
            ranks[rule] = nearer(ranks.get(rule, rank), rank)
    return ranks


def nearer(one: int, other: int) -> int:
    """Return the nearer rank; nothing is nearer than 0."""
    return min(one, other) if SEARCH not in (one, other) or 0 not in (one, other) else 0


def goal_key(predicate: int, args: Patterns) -> GoalKey:
    """Return a key that two goals share if they are written the same."""
    return predicate, tuple([identity(arg.value) if isinstance(arg, Constant) else repr(arg) for arg in args])


def here(args: Patterns, robot: Robot) -> Patterns:
    """Return a goal's arguments with `robot` in the place of the robot itself."""
    return tuple([Constant(robot) if arg == HOME else arg for arg in args]) if HOME in args else args


class Ranks:
    """The ranks of one robot's firings; nothing is read backwards before it has to be."""

    __slots__ = (
        "_goals",
        "_leading",
        "_levels",
        "_nearest",
        "_program",
        "_ranks",
        "_robot",
        "_stale",
        "_stated",
        "_unstated",
    )

    def __init__(self, program: Program, robot: Robot, goals: Callable[[], Iterable[Wanted]]) -> None:
        """`goals` returns the open ones."""
        self._program = program
        self._robot = robot
        self._goals = goals
        self._stated = stated(program).of(robot)
        self._unstated = False
        """A goal has been open of which the compiler says nothing."""
        self._leading: dict[int, list[int]] = {}
        self._ranks: RuleRanks | None = None
        self._nearest: dict[int, int] | None = None
        self._levels: Levels | None = None
        self._stale = True

    def change(self, predicate: int, args: Patterns) -> None:
        """Note that a goal has been opened or discharged."""
        self._stale = True
        if not self._unstated and goal_key(predicate, args) not in self._stated:
            self._unstated = True
            self._leading.clear()

    def leading(self, predicate: int) -> list[int]:
        """Return the rules whose firings may get another rank when the goals of `predicate` change."""
        rules = self._leading.get(predicate)
        if rules is None:
            rules = self._leading[predicate] = list(self._lead(predicate))
        return rules

    def nearest(self, rule: int) -> int | None:
        """Return the lowest rank that a firing of `rule` can have; None if no open goal follows from any."""
        rank = self._known(rule)
        if rank != SEARCH:
            return rank
        distances = self._distances()
        return min([distances[each] for each in self._reading.brought[rule] if each in distances], default=None)

    def of(self, rule: int, facts: Iterable[tuple[int, Args]]) -> int | None:
        """Return the rank of a firing of `rule` that brings about `facts`; None if no open goal follows."""
        rank = self._known(rule)
        if rank != SEARCH:
            return rank
        distances = self._distances()
        near = [fact for fact in facts if fact[0] in distances]
        if not near:
            return None
        if self._levels is None:
            self._levels = Levels(self._reading, self._goals(), self._robot)
        return self._levels.lowest(near)

    def _known(self, rule: int) -> int | None:
        """Return the rank of all firings of a rule, given the open goals; SEARCH if nobody has worked it out."""
        if self._stale:
            self._stale = False
            self._nearest = self._levels = None
            leads = [self._stated.get(goal_key(*goal)) for goal in self._goals()]
            known = [each for each in leads if each is not None]
            self._ranks = merged(known) if len(known) == len(leads) else None
        return SEARCH if self._ranks is None else self._ranks.get(rule)

    def _lead(self, predicate: int) -> Iterator[int]:
        """Yield the rules from which something leads, or seems to lead, to a goal of `predicate`."""
        if not self._unstated:
            ranks = merged(each for (goal, _), each in self._stated.items() if goal == predicate)
            yield from sorted(ranks)
            return
        distances = self._reading.distances(predicate)
        for rule, brought in enumerate(self._reading.brought):
            if any(each in distances for each in brought):
                yield rule

    def _distances(self) -> dict[int, int]:
        """Return for each predicate from which rules lead to an open goal the lowest rank possible."""
        if self._nearest is None:
            self._nearest = {}
            for goal in dict.fromkeys(predicate for predicate, _ in self._goals()):
                for predicate, distance in self._reading.distances(goal).items():
                    self._nearest[predicate] = min(distance, self._nearest.get(predicate, distance))
        return self._nearest

    @property
    def _reading(self) -> Backwards:
        return reading(self._program)
