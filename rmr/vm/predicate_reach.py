"""Which predicates can follow from which, by rules and effects of actions, read off the program without values."""

from rmr.base.identity import ByIdentity
from rmr.bytecode.heads import bodies, items
from rmr.bytecode.program import Atom, Mode, Program


class Reach:
    """Which predicates can follow from which, by one rule or action after another, as bit sets."""

    __slots__ = ("_beside", "_from")

    def __init__(self, program: Program) -> None:
        steps = [1 << index for index in range(len(program.predicates))]
        self._beside = _beside(program)
        """What one rule derives together with what starts a job, as bit sets, by the start fact's predicate."""
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

    def leads(self, one: int, other: int) -> bool:
        """Return whether `other` can follow from `one`; each follows from itself."""
        return bool(self._from[one] >> other & 1)

    def begun(self, start: int, other: int) -> bool:
        """Return whether `other` can follow from a job's `start`, or from what the firing derives that starts it."""
        if self.leads(start, other):
            return True
        beside = self._beside[start]
        return any(beside >> one & 1 and self.leads(one, other) for one in range(beside.bit_length()))


def _beside(program: Program) -> dict[int, int]:
    beside = {each.start.predicate: 1 << each.start.predicate for each in program.assertions}
    for rule in program.rules if beside else ():
        heads = dict.fromkeys([item.predicate for item in items(rule.head)])
        for start in heads:
            if start in beside:
                beside[start] |= sum(1 << head for head in heads if not beside[start] >> head & 1)
    return beside


reach_of: ByIdentity[Program, Reach] = ByIdentity(Reach)
"""Returns the reach of a program's predicates, the same for all robots of a process."""
