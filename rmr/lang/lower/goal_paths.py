"""Goal distances of rules (paper III.B), by backward chaining at compile time.

The rank of a firing is the lowest level at which one of the facts that it produces is wanted
(`rmr.analysis.goal_levels`). At compile time only the rule's patterns are known, neither the facts nor the robot. So a
lower and an upper bound are computed. Lower: the lowest level at which a fact that the rule may produce is possibly
wanted. Upper: the lowest level at which a fact that every firing produces is wanted for certain, on every robot that
has the goal and whatever facts it holds: through rules that need no other fact and no condition. Equal bounds are the
rank of every firing. Without a lower bound the rule never leads to the goal. In all other cases the rank depends on the
firing or on facts, and the robot computes it.

The result equals that of the robot's own search: that one visits no more than this one, so its budget suffices where
this one's did.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from rmr.analysis.backward_chaining import (
    HOME,
    Backwards,
    Brought,
    Patterns,
    brings,
    derived_by,
    resolved,
    unified,
    unifier,
    value_key,
)
from rmr.analysis.goal_levels import STEPS_MAX, Levels, Reached
from rmr.analysis.regressions import is_unconditional
from rmr.base.values import Robot
from rmr.bytecode.program import Anything, Constant, InitialGoal, Lead, Program

COMPARISONS_MAX = 100_000
"""Budget of comparisons of a produced fact with a wanted one, for all goals of a program."""


class LeadingRank(NamedTuple):
    """A rule that leads to a goal."""

    rule: int
    rank: int | None
    """The rank of every firing; None if it depends on the firing."""
    brought: Brought
    """The produced fact that starts a shortest possible path."""
    wanted: Reached
    """The wanted fact that it matches; its level is the lowest possible rank."""


class TooMuch(Exception):  # noqa: N818  (an outcome, not a fault)
    """The compile-time search budget is exhausted."""


def with_leads(program: Program) -> Program:
    """Return `program` with the rules that lead to each goal, unless they are too many.

    A partial list saves nothing: a robot with one open goal without leads has to search anyway.
    """
    if not program.goals:
        return program
    reach = GoalPaths(program)
    leads = [reach.leads(goal) for goal in program.goals]
    # Leads in the byte-code for each rule of the program, on average: one takes two octets, a rule about a dozen.
    if sum(len(each or ()) for each in leads) > 2 * len(program.rules):
        return program
    goals = [replace(goal, leads=each) for goal, each in zip(program.goals, leads, strict=True)]
    return replace(program, goals=tuple(goals))


class GoalPaths:
    """The rules of one program and the facts that they produce."""

    def __init__(self, program: Program) -> None:
        self._backwards = Backwards(program)
        self._unconditional = Backwards(program, is_unconditional)
        self._brought = [tuple(brings(rule, program)) for rule in program.rules]
        self._bringing: dict[int, list[int]] = {}
        """Rules by the predicates that they produce."""
        for rule, brought in enumerate(self._backwards.brought):
            for predicate in brought:
                self._bringing.setdefault(predicate, []).append(rule)
        self._steps_left = STEPS_MAX
        self._comparisons_left = COMPARISONS_MAX

    def leads(self, goal: InitialGoal) -> tuple[Lead, ...] | None:
        """Return the rules that lead to `goal`, or None if more of them depend on the firing than do not."""
        try:
            leads = tuple([Lead(way.rule, way.rank) for way in self.ways(goal)])
        except TooMuch:
            return None
        candidates = sum(1 for _ in self._candidates(goal))
        dependent = sum(1 for lead in leads if lead.rank is None)
        return leads if dependent <= candidates - dependent else None

    def ways(self, goal: InitialGoal) -> list[LeadingRank]:
        """Return the rules that lead to `goal`, in their order.

        Raises:
            TooMuch: this goal, or one before it, takes too much work.
        """
        if self._steps_left == 0:
            raise TooMuch
        robot = None if goal.owner is None else Robot(goal.owner)
        wanted = [(goal.predicate, goal.args)]
        possible = Levels(self._backwards, wanted, robot)
        sure = Levels(self._unconditional, wanted, robot, sure=robot is None)
        if not possible.finish(self._steps_left) or not sure.finish(STEPS_MAX):
            self._steps_left = 0
            raise TooMuch
        self._steps_left -= possible.steps
        found = [self._way(rule, robot, possible, sure) for rule in self._candidates(goal)]
        return [way for way in found if way is not None]

    def _candidates(self, goal: InitialGoal) -> Iterator[int]:
        """Yield the candidate rules, by predicates alone: those that produce one on a path to the goal's."""
        distances = self._backwards.distances(goal.predicate)
        yield from sorted({rule: None for predicate in distances for rule in self._bringing.get(predicate, ())})

    def _way(self, rule: int, robot: Robot | None, possible: Levels, sure: Levels) -> LeadingRank | None:
        """Return how a rule leads to the goal, None if it never does."""
        best: LeadingRank | None = None
        bound: int | None = None
        for brought in self._brought[rule]:
            wanted = self._possibly(rule, brought, robot, possible)
            if wanted is not None and (best is None or wanted.level < best.wanted.level):
                best = LeadingRank(rule, None, brought, wanted)
            certain = self._certainly(brought, robot, sure) if wanted is not None else None
            if certain is not None and (bound is None or certain.level < bound):
                bound = certain.level
        return best if best is None or best.wanted.level != bound else best._replace(rank=bound)

    def _possibly(self, rule: int, brought: Brought, robot: Robot | None, levels: Levels) -> Reached | None:
        """Return as what of the lowest level the fact may be wanted, if it may be this robot's."""
        known = dict(brought.known)
        if not unified(HOME, brought.owner, known):
            return None
        derivation = derived_by(rule, brought, known, brought.args)

        def fits(wanted: Patterns) -> bool:
            self._compare()
            return unifier(wanted, derivation, robot) is not None

        return levels.nearest(brought.predicate, derivation.derives, fits)

    def _certainly(self, brought: Brought, robot: Robot | None, levels: Levels) -> Reached | None:
        """Return as what of the lowest level the fact is wanted whatever the firing, if every firing brings it."""
        known = dict(brought.known)
        if robot is not None:
            unified(HOME, Constant(robot), known)
        if not brought.always or resolved(brought.owner, known) != resolved(HOME, known):
            return None
        args = tuple([resolved(arg, known) for arg in brought.args])

        def fits(wanted: Patterns) -> bool:
            self._compare()
            return agrees(wanted, args)

        return levels.nearest(brought.predicate, args, fits)

    def _compare(self) -> None:
        self._comparisons_left -= 1
        if self._comparisons_left < 0:
            self._steps_left = 0
            raise TooMuch


def agrees(wanted: Patterns, args: Patterns) -> bool:
    """Tell whether whatever `args` stand for is what is `wanted`; a variable that stands twice wants one constant."""
    values: dict[object, object] = {}
    for one, other in zip(wanted, args, strict=True):
        if isinstance(one, Anything) or (one == other == HOME):
            continue
        if one == HOME or not isinstance(other, Constant):
            return False
        key = value_key(other.value)
        if key != (value_key(one.value) if isinstance(one, Constant) else values.setdefault(one, key)):
            return False
    return True
