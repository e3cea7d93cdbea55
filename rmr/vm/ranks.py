"""Ranks: how many further firings lead from a fact to an open goal (paper III.B, figure 6).

What is wanted at level 0 are the open goals; at level k + 1 the premises of the derivations of what is wanted
at level k. A fact has the lowest level at which it is wanted, and a firing the lowest of the facts that it
derives, the declared effects of its actions among them. So the levels are a breadth-first search backwards
from the goals over patterns, and a loop among rules ends where it comes upon a pattern again.

A level is worked out when a fact is asked for that is wanted at no lower one, and kept until the goals
change. Facts of predicates from which no rules lead to a goal are never looked for.
"""

from collections.abc import Iterable

from rmr.base.values import Robot
from rmr.bytecode.program import Constant, Program
from rmr.vm.backwards import Backwards, Patterns, Wanted, premises, value_key
from rmr.vm.match import pattern_agrees
from rmr.vm.store import Args

STEPS_MAX = 10_000
"""Derivations and premises looked at for one set of goals, the nearest first; what lies beyond has no rank."""


class Ranks:
    """The ranks of one robot's facts; costs nothing before the first goal."""

    def __init__(self, program: Program, robot: Robot) -> None:
        self._program = program
        self._robot = robot
        self._backwards: Backwards | None = None
        self._levels: Levels | None = None
        self._nearest: dict[int, int] | None = None

    def forget(self) -> None:
        """Note that the goals have changed."""
        self._levels = None
        self._nearest = None

    def nearest(self, goals: Iterable[int]) -> dict[int, int]:
        """Return for each predicate from which rules lead to one of `goals` (predicates) the lowest rank possible."""
        if self._nearest is None:
            self._nearest = {}
            for goal in goals:
                for predicate, distance in self.leading(goal).items():
                    self._nearest[predicate] = min(distance, self._nearest.get(predicate, distance))
        return self._nearest

    def leading(self, predicate: int) -> dict[int, int]:
        """Return the predicates from which rules lead to `predicate`, with how many at least."""
        return self._reading.distances(predicate)

    def of(self, facts: list[tuple[int, Args]], goals: Iterable[Wanted]) -> int | None:
        """Return the lowest rank among `facts`, given all open goals; None if no goal follows from any."""
        if self._levels is None:
            self._levels = Levels(self._reading, goals)
        return self._levels.lowest(facts)

    @property
    def _reading(self) -> Backwards:
        if self._backwards is None:
            self._backwards = Backwards(self._program, self._robot)
        return self._backwards


class Levels:
    """What is wanted at each level, worked out as far as anybody has asked."""

    def __init__(self, backwards: Backwards, goals: Iterable[Wanted]) -> None:
        self._backwards = backwards
        self._steps = 0
        self._depth = 0
        self._exact: dict[int, dict[tuple[object, ...], int]] = {}
        self._open: dict[int, dict[tuple[object, ...], tuple[int, Patterns]]] = {}
        self._frontier: list[Wanted] = []
        for predicate, args in goals:
            self._add(predicate, args, self._frontier)

    def lowest(self, facts: list[tuple[int, Args]]) -> int | None:
        """Return the lowest level at which one of `facts` is wanted."""
        while True:
            found = [level for predicate, args in facts if (level := self._level(predicate, args)) is not None]
            if found:
                return min(found)
            if not self._frontier:
                return None
            self._deepen()

    def _level(self, predicate: int, args: Args) -> int | None:
        """Return the lowest level so far at which a fact is wanted."""
        exact = self._exact.get(predicate)
        lowest = exact.get(tuple([value_key(value) for value in args])) if exact else None
        for level, patterns in self._open.get(predicate, {}).values():
            if lowest is not None and level >= lowest:
                return lowest
            if pattern_agrees(patterns, args):
                return level
        return lowest

    def _deepen(self) -> None:
        """Work out the next level."""
        frontier, self._frontier = self._frontier, []
        self._depth += 1
        for predicate, args in frontier:
            for derivation in self._backwards.deriving(predicate, args):
                self._steps += 1 + len(derivation.premises)
                if self._steps > STEPS_MAX:
                    self._frontier.clear()
                    return
                for earlier in premises(args, derivation):
                    self._add(*earlier, self._frontier)

    def _add(self, predicate: int, args: Patterns, frontier: list[Wanted]) -> None:
        """Note what is wanted at the present depth, unless it has been wanted before."""
        constants = [each.value for each in args if isinstance(each, Constant)]
        if len(constants) == len(args):
            key = tuple([value_key(value) for value in constants])
            known = self._exact.setdefault(predicate, {})
            if key in known:
                return
            known[key] = self._depth
        else:
            key = tuple([value_key(each.value) if isinstance(each, Constant) else (repr(each),) for each in args])
            patterns = self._open.setdefault(predicate, {})
            if key in patterns:
                return
            patterns[key] = (self._depth, args)
        frontier.append((predicate, args))
