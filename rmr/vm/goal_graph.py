"""The graph of ways to goals: nodes, steps, and levels that are computed again only where they change.

A node is a fact that is wanted, ground or with variables. A step leads from a wanted premise to the fact that a rule
derives with it, while the rule's other premises hold. Its cost is one firing. The level of a node is the number of
firings on the shortest way from it to an open goal. The root is the set of open goals.

LPA* (Koenig, Likhachev and Furcy, "Lifelong planning A*", Artificial Intelligence 155, 2004) without a heuristic; for
changes of single edges it is the algorithm of Ramalingam and Reps, 1996. Per node, `level` is the level
that its predecessors use, and `ahead` the one that its own steps give now. A node where the two differ is queued by
the smaller one.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from heapq import heappop, heappush
from typing import Final

from rmr.analysis.regressions import Regression, Row

FAR: Final = 1 << 29
"""Level of a node from which no way leads to a goal."""

FactKey = tuple[int, Row]
"""A predicate and arguments."""


class WantedFact:
    """A node of the graph."""

    __slots__ = (
        "ahead",
        "args",
        "expanded",
        "from_here",
        "goals",
        "level",
        "narrowed",
        "predicate",
        "queued",
        "to_here",
    )

    def __init__(self, predicate: int, args: Row) -> None:
        self.predicate = predicate
        self.args = args
        """Forms of values; where it is open also slots and ANY."""
        self.goals = 0
        """1 if it is an open goal."""
        self.level = FAR
        self.ahead = FAR
        self.queued = -1
        """The key of its valid entry in the queue; -1: none."""
        self.expanded = False
        self.from_here: dict[GroundStep, None] = {}
        self.to_here: dict[GroundStep, None] = {}
        self.narrowed: list[tuple[int, Regression]] | None = None
        """Of an open node: the regressions that fit it, with their places."""


class GroundStep:
    """An edge: a firing that derives `end` from `start` and facts that hold."""

    __slots__ = ("absents", "blockers", "end", "facts", "rule", "start")

    def __init__(self, rule: int, start: WantedFact, end: WantedFact, facts: tuple[FactKey, ...]) -> None:
        self.rule = rule
        self.start = start
        self.end = end
        self.facts = facts
        """The side facts; the step exists only while all of them hold."""
        self.absents: list[tuple[dict[Row, dict[object, None]], Row]] = []
        """Where it is registered for facts that block it (`SideFacts.blocking`)."""
        self.blockers = 0
        """Facts that hold and that a ``not`` of the rule forbids."""


class GoalGraph(ABC):
    """Levels of nodes; which steps there are is left to the subclass."""

    def __init__(self) -> None:
        self._queue: list[tuple[int, int, WantedFact]] = []
        self._pushed = 0
        self._steps_with: dict[FactKey, dict[GroundStep, None]] = {}
        self._edges = 0
        """Steps and nodes."""
        self._left = 0
        """Remaining steps of the search's budget."""
        self.version = 0
        """Grows with every change of a level."""
        self.exact = -1
        """The levels up to this one are final; FAR: all are."""

    @property
    def is_done(self) -> bool:
        """Whether all levels are final."""
        return self.exact == FAR

    @abstractmethod
    def _expand(self, node: WantedFact) -> Iterator[None]:
        """Find the steps to a node that is reached for the first time; yield where the budget is used up."""

    def _settle(self) -> Iterator[None]:
        """Take the nearest node from the queue and make its two levels agree."""
        key, _, node = heappop(self._queue)
        if node.queued != key:
            return
        node.queued = -1
        self.exact = key
        self.version += 1
        if node.level > node.ahead:
            node.level = node.ahead
            if not node.expanded:
                node.expanded = True
                yield from self._expand(node)
                return
            for step in node.to_here:
                if not step.blockers:
                    self._lower(step.start, node.level + 1)
        else:
            node.level = FAR
            self._push(node)
            for step in node.to_here:
                if not step.blockers and step.start.ahead == key + 1:
                    self._look_ahead(step.start)
        self._left -= len(node.to_here)

    def _lower(self, node: WantedFact, ahead: int) -> None:
        if ahead < node.ahead:
            node.ahead = ahead
            self._push(node)

    def _look_ahead(self, node: WantedFact) -> None:
        """Compute the level that the steps from a node give it (`ahead`)."""
        ahead = FAR
        if node.goals:
            ahead = 0
        else:
            for step in node.from_here:
                if not step.blockers and step.end.level < ahead:
                    ahead = step.end.level + 1
            self._left -= len(node.from_here)
        if ahead != node.ahead:
            node.ahead = ahead
            self._push(node)

    def _push(self, node: WantedFact) -> None:
        """Queue a node by the smaller of its two levels, unless they agree."""
        if node.level == node.ahead:
            node.queued = -1
            return
        key = min(node.level, node.ahead)
        if node.queued != key:
            node.queued = key
            self._pushed += 1
            heappush(self._queue, (key, self._pushed, node))

    def _block(self, step: GroundStep, change: int) -> None:
        """Count one more or one fewer fact that blocks a step."""
        before = step.blockers
        step.blockers += change
        if not step.blockers:
            if step.end.level < FAR:
                self._lower(step.start, step.end.level + 1)
        elif not before and step.start.ahead == step.end.level + 1:
            self._look_ahead(step.start)

    def _cut(self, step: GroundStep, gone: FactKey) -> None:
        """Remove a step for which a fact is missing."""
        del step.start.from_here[step]
        del step.end.to_here[step]
        self._edges -= 1
        for fact in step.facts:
            if fact != gone and fact in self._steps_with:
                self._steps_with[fact].pop(step, None)
        for watched, key in step.absents:
            steps = watched[key]
            del steps[step]
            if not steps:
                del watched[key]
        if not step.blockers and step.start.ahead == step.end.level + 1:
            self._look_ahead(step.start)
