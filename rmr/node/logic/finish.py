"""Whether the lab's finish fact holds for a robot, which ends its part of the run."""

from rmr.base.time import Instant
from rmr.bytecode.program import Anything, Program
from rmr.node.config import FinishPattern
from rmr.node.logic.sensed_facts import SensedFacts
from rmr.vm.machine import Machine


class FinishFact:
    """Watches one robot's finish fact."""

    def __init__(self, pattern: FinishPattern | None, program: Program, machine: Machine, senses: SensedFacts) -> None:
        self._pattern = pattern
        self._index = None if pattern is None else program.index(pattern[0])
        self._machine = machine
        self._senses = senses
        self._looked: Instant = 0
        self.holds = False
        """As of the last call of the runtime system."""
        self.at: Instant | None = None
        """When it held first."""

    def update(self, now: Instant) -> bool:
        """Look again if facts may have changed; return whether the finish fact holds for the first time."""
        # Neither the machine nor the senses have changed a fact since: nothing to search.
        if self._looked <= self._machine.called_at or self._looked <= self._senses.changed:
            self._looked = now
            self.holds = self._search()
        if self.at is not None or not self.holds:
            return False
        self.at = now
        return True

    def _search(self) -> bool:
        if self._pattern is None:
            return False
        name, patterns = self._pattern
        for args in self._senses.of(name):
            if all(isinstance(p, Anything) or p.value == a for p, a in zip(patterns, args, strict=False)):
                return True
        return self._index is not None and self._machine.holds(self._index, patterns)
