"""Expressions without value, each told once and with its place (``1 / 0`` in a rule).

A match that fails is looked at again whenever its rule is; it is known by its facts. What has failed is forgotten
when room is needed and its facts are gone.
"""

from collections.abc import Sequence

from rmr.base.time import Instant
from rmr.bytecode.program import Program
from rmr.vm.bounds import Dropped
from rmr.vm.events import ExpressionFailed, VmEvent
from rmr.vm.store import Fact

FAILURES_MAX = 1024
"""Failures of matches that are remembered; beyond that new ones are counted as dropped and not told."""

Key = tuple[int, ...]


def rule_place(program: Program, index: int) -> str:
    """Return where a rule stands: ``rule at corridor.rmr:12``, or ``rule 3`` without the debug section."""
    places = program.debug.rules if program.debug is not None else ()
    return f"rule at {places[index].file}:{places[index].line}" if index < len(places) else f"rule {index}"


class Failures:
    """What has failed on one robot."""

    def __init__(self, program: Program, events: list[VmEvent], dropped: Dropped) -> None:
        """Tell `events`."""
        self.count = 0
        self._program = program
        self._events = events
        self._dropped = dropped
        self._known: dict[Key, tuple[Fact, ...]] = {}
        self._wait = 0
        """How many failures to pass over before room is made again."""

    def tell(self, now: Instant, where: str, reason: str) -> None:
        """Count and tell a failure."""
        self.count += 1
        self._events.append(ExpressionFailed(where, reason, now))

    def match(self, now: Instant, rule: int, part: int, step: int, facts: Sequence[Fact], reason: str) -> None:
        """Count and tell, once, that a `step` in a part of a rule failed for `facts`."""
        key = (rule, part, step, *[fact.serial for fact in facts])
        if key in self._known:
            return
        if len(self._known) >= FAILURES_MAX and not self._make_room():
            self._dropped.add("failures", FAILURES_MAX, now)
            return
        self._known[key] = tuple(facts)
        self.tell(now, rule_place(self._program, rule), reason)

    def _make_room(self) -> bool:
        """Forget failures of which facts are gone; seldom while that leaves many, for it takes as long as there are."""
        if self._wait:
            self._wait -= 1
            return False
        self._known = {key: facts for key, facts in self._known.items() if all(fact.held for fact in facts)}
        if len(self._known) > FAILURES_MAX // 2:
            self._wait = FAILURES_MAX
        return len(self._known) < FAILURES_MAX
