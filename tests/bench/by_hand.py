"""The bound below which no engine in Python comes: workloads written out by hand, with nothing that is not needed.

Facts are kept as RMR keeps them, for the oldest are to go first and a fact that is gone must be known to be gone; each
firing is noted. There is no choice, no budget, no bound, no time, no goal: what an engine is for is left out.
"""

from collections.abc import Callable
from typing import Any

from systems import Lap, System, clock
from workloads import Facts, Row, Workload

HAND = "Python by hand"

Held = dict[str, list[Row]]


def closure(facts: Facts) -> tuple[Held, int]:
    onward: dict[int, list[Any]] = {}
    table: dict[Row, Any] = {}
    queue: list[Any] = []
    events: list[int] = []
    serial = 0
    for _, (start, end) in facts:
        onward.setdefault(start, []).append([True, serial, start, end])
        events.append(0)
        if (start, end) not in table:
            serial += 1
            fact = table[start, end] = [True, serial, start, end]
            queue.append(fact)
    for path in queue:
        kept = [(path, edge) for edge in onward.get(path[3], ())]
        kept.reverse()
        while kept:
            first, second = kept.pop()
            events.append(1)
            key = first[2], second[3]
            if key not in table:
                serial += 1
                fact = table[key] = [True, serial, first[2], second[3]]
                queue.append(fact)
    return {"path": list(table)}, len(events)


def gradient(facts: Facts) -> tuple[Held, int]:
    onward: dict[int, list[int]] = {}
    back: dict[int, list[int]] = {}
    hops: dict[int, list[Any]] = {}
    queue: list[list[Any]] = []
    events: list[int] = []
    for name, (one, other) in facts:
        if name == "edge":
            onward.setdefault(one, []).append(other)
            back.setdefault(other, []).append(one)
        else:
            hops[one] = [True, one, other]
            queue.append(hops[one])
    for fact in queue:
        again = fact[0]
        while again:
            again = False
            for node in onward.get(fact[1], ()):
                if hops[node][2] > fact[2] + 1:
                    events.append(0)
                    hops[node][0] = False
                    hops[node] = nearer = [True, node, fact[2] + 1]
                    queue.append(nearer)
                    for neighbour in back[node]:  # the facts before it could be nearer still
                        again = nearer[2] > hops[neighbour][2] + 1 or again
                    again = True
                    break
    return {"hops": [(node, fact[2]) for node, fact in hops.items()]}, len(events)


def join(facts: Facts) -> tuple[Held, int]:
    tables: dict[str, dict[int, list[Any]]] = {name: {} for name in "abc"}
    for serial, (name, row) in enumerate(facts):
        tables[name][serial] = [True, serial, *row]
    one, two, three = tables.values()
    by_two = {fact[2]: fact for fact in two.values()}
    by_three = {fact[2]: fact for fact in three.values()}
    made: dict[int, list[Any]] = {}
    for first in list(one.values()):
        second = by_two.get(first[3])
        third = by_three.get(second[3]) if second is not None else None
        if second is None or third is None:
            continue
        for fact, table in ((first, one), (second, two), (third, three)):
            fact[0] = False
            del table[fact[1]]
        del by_two[second[2]], by_three[third[2]]
        made[len(made)] = [True, len(facts) + len(made), first[2], third[3]]
    left = {name: [(fact[2], fact[3]) for fact in tables[name].values()] for name in "abc"}
    return {**left, "d": [(fact[2], fact[3]) for fact in made.values()]}, len(made)


RULES: dict[str, Callable[[Facts], tuple[Held, int]]] = {"closure": closure, "gradient": gradient, "join": join}
"""By the name of the workload."""


class HandSystem(System):
    """A workload as a Python function."""

    name = HAND

    def __init__(self, workload: Workload) -> None:
        self._work = RULES[workload.name]
        self._facts = workload.facts
        self._held: Held = {}
        self.expected_firings = workload.firings

    def once(self) -> Lap:
        """Run it; loading cannot be told apart."""
        began = clock()
        self._held, self.firings = self._work(self._facts)
        return Lap(0.0, clock() - began)

    def held(self, predicate: str) -> list[Row]:
        """Return the facts without the owner."""
        return self._held[predicate]
