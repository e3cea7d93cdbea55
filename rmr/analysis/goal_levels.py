"""How many firings lie between a fact and a goal (paper III.B, figure 6).

The levels are a breadth-first search backwards from the goals, over patterns. Level 0 has the goals, level k + 1 the
premises of the derivations of level k. A fact has the lowest level at which it is wanted, and a firing the lowest of
the facts that it derives. A cycle of rules ends where a pattern occurs again.

A level is computed on the first request beyond the last one. The virtual machine asks for the facts that it holds; the
compiler, which knows no facts, reads all patterns. The bounds of a robot's search for ranks (`rmr.vm.ranks`) stand here
because `rmr check --explain` tells them.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from rmr.analysis.backward_chaining import (
    HOME,
    Backwards,
    Derivation,
    Patterns,
    Wanted,
    first_key,
    groups_at_first,
    premises,
    value_key,
)
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Anything, Constant, Slot

RANKING_STEPS = 5_000
"""Steps of the search that one `run` may take: a few milliseconds of a tick of 16."""

RANKING_RUNS_MAX = 600
"""Runs in a row for which a machine waits for its ranks, 10 s of ticks: enough for a map of a million facts."""

EDGES_MAX = 500_000
"""Steps and nodes of one robot's graph, some 300 bytes each; beyond that nothing further is explored."""

STEPS_MAX = 10_000
"""Search budget for one set of goals: derivations and premises, nearest first. Patterns beyond it have no rank."""


Key = tuple[object, ...]
"""Arguments: constants by what they share with those that are the same, others as they are."""


class Reached(NamedTuple):
    """Something that is wanted."""

    level: int
    predicate: int
    args: Patterns
    derivation: Derivation | None
    """Of what it is wanted for; None: it is a goal."""
    towards: "Reached | None"
    """What it is wanted for."""


class Levels:
    """The patterns wanted at each level, computed as far as they have been requested."""

    def __init__(
        self, backwards: Backwards, goals: Iterable[Wanted], robot: Robot | None = None, *, sure: bool = False
    ) -> None:
        self.steps = 0
        """Derivations and premises looked at."""
        self._backwards = backwards
        self._robot = robot
        self._sure = sure
        self._depth = 0
        self._ground: dict[int, dict[Key, int]] = {}
        self._open: dict[int, dict[Key, int]] = {}
        self._reached: dict[int, dict[object, list[Reached]]] = {}
        self._frontier: list[Reached] = []
        for predicate, args in goals:
            here = [Constant(robot) if robot is not None and arg == HOME else arg for arg in args]
            self._add(predicate, tuple(here), None, None)

    def lowest(self, facts: Iterable[tuple[int, tuple[Value, ...]]]) -> int | None:
        """Return the lowest level at which one of `facts` is wanted; None if none is."""
        asked = [(predicate, tuple([value_key(value) for value in args])) for predicate, args in facts]
        while True:
            found = [level for predicate, key in asked if (level := self._level(predicate, key)) is not None]
            if found:
                return min(found)
            if not self._frontier:
                return None
            self._deepen()

    def finish(self, steps_max: int) -> bool:
        """Work out all levels; False if that takes more than `steps_max` steps."""
        while self._frontier and self.steps <= min(steps_max, STEPS_MAX):
            self._deepen()
        return self.steps <= min(steps_max, STEPS_MAX)

    def nearest(self, predicate: int, args: Patterns, fits: Callable[[Patterns], bool]) -> Reached | None:
        """Return what of the lowest level so far `fits`, among all that may have the first argument of `args`."""
        best: Reached | None = None
        for group in groups_at_first(self._reached.get(predicate, {}), args):
            for reached in group:
                if best is not None and reached.level >= best.level:
                    break
                if fits(reached.args):
                    best = reached
                    break
        return best

    def _level(self, predicate: int, key: Key) -> int | None:
        """Return the lowest level so far at which a fact is wanted."""
        ground = self._ground.get(predicate)
        lowest = ground.get(key) if ground else None
        for wanted, level in self._open.get(predicate, {}).items():
            if lowest is not None and level >= lowest:
                return lowest
            if _agrees(wanted, key):
                return level
        return lowest

    def _deepen(self) -> None:
        """Work out the next level."""
        frontier = self._frontier
        self._frontier = []
        self._depth += 1
        for reached in frontier:
            for derivation in self._backwards.deriving(reached.predicate, reached.args):
                self.steps += 1 + len(derivation.premises)
                if self.steps > STEPS_MAX:
                    self._frontier.clear()
                    return
                for predicate, args in premises(reached.args, derivation, self._robot, self._sure):
                    self._add(predicate, args, derivation, reached)

    def _add(self, predicate: int, args: Patterns, derivation: Derivation | None, towards: Reached | None) -> None:
        """Note what is wanted at the present depth, unless it has been wanted before."""
        key = tuple([value_key(arg.value) if isinstance(arg, Constant) else arg for arg in args])
        open_ = any(not isinstance(arg, Constant) for arg in args)
        known = (self._open if open_ else self._ground).setdefault(predicate, {})
        if key in known:
            return
        known[key] = self._depth
        reached = Reached(self._depth, predicate, args, derivation, towards)
        self._reached.setdefault(predicate, {}).setdefault(first_key(args), []).append(reached)
        self._frontier.append(reached)


def _agrees(wanted: Key, key: Key) -> bool:
    """Return whether a fact of this key is what is wanted; the same variable is the same value."""
    values: dict[object, object] = {}
    for one, other in zip(wanted, key, strict=True):
        if isinstance(one, Anything):
            continue
        expected = values.setdefault(one, other) if isinstance(one, Slot) else one
        if expected != other:
            return False
    return True
