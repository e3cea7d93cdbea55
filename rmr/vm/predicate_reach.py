"""Which predicates can follow from which, by rules and effects of actions, read off the program without values."""

from functools import reduce
from operator import or_

from rmr.base.identity import ByIdentity
from rmr.bytecode.heads import bodies, items
from rmr.bytecode.program import Atom, Mode, Program


class Reach:
    """Which predicates can follow from which, by one rule or action after another, as bit sets."""

    __slots__ = ("_begun", "_from")

    def __init__(self, program: Program) -> None:
        steps = [1 << index for index in range(len(program.predicates))]
        for rule in program.rules:
            heads = 0
            for item in items(rule.head):
                heads |= 1 << item.predicate
            for body in bodies(rule):
                for conjunct in body:
                    if isinstance(conjunct, Atom) and conjunct.mode is not Mode.ABSENT:
                        steps[conjunct.predicate] |= heads
        for index, predicate in enumerate(program.predicates):
            for effect in (*predicate.effects, *predicate.else_effects):
                steps[index] |= 1 << effect.predicate
        # Warshall's algorithm on rows of bits.
        for middle, through in enumerate(steps):
            bit = 1 << middle
            for index, row in enumerate(steps):
                if row & bit:
                    steps[index] = row | through
        self._from = steps
        self._begun = {start: reduce(or_, [steps[one] for one in beside]) for start, beside in _beside(program).items()}
        """What can follow from what one rule derives together with a job's start fact, by that fact's predicate."""

    def leads(self, one: int, other: int) -> bool:
        """Return whether `other` can follow from `one`; each follows from itself."""
        return bool(self._from[one] >> other & 1)

    def begun(self, start: int, other: int) -> bool:
        """Return whether `other` can follow from a job's `start`, or from what the firing derives that starts it."""
        return bool(self._begun[start] >> other & 1)


def _beside(program: Program) -> dict[int, set[int]]:
    """Return what one rule derives together with a start fact, that fact among it, by its predicate."""
    beside = {each.start.predicate: {each.start.predicate} for each in program.assertions}
    for rule in program.rules if beside else ():
        heads = {item.predicate for item in items(rule.head)}
        for start in heads & beside.keys():
            beside[start] |= heads
    return beside


reach_of: ByIdentity[Program, Reach] = ByIdentity(Reach)
"""Returns the reach of a program's predicates, the same for all robots of a process."""
