"""Expressions without value, each told once and with its place (``1 / 0`` in a rule).

A match that fails is looked at again whenever its rule is; it is known by its facts. What has failed is forgotten
when room is needed and its facts are gone.
"""

from collections.abc import Sequence

from rmr.base.time import Instant
from rmr.bytecode.program import Program
from rmr.vm.bounds import Dropped
from rmr.vm.machine_events import ExpressionFailed, VmEvent
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

    __slots__ = ("_dropped", "_events", "_known", "_program", "_wait", "count")

    def __init__(self, program: Program, events: list[VmEvent], dropped: Dropped) -> None:
        """Tell `events`."""
        self.count = 0
        self._program = program
        self._events = events
        self._dropped = dropped
        self._known: dict[Key, tuple[Fact, ...]] | None = None
        """The failures of matches that are remembered; made with the first."""
        self._wait = 0
        """How many failures to pass over before room is made again."""

    def tell(self, now: Instant, where: str, reason: str) -> None:
        """Count and tell a failure."""
        self.count += 1
        self._events.append(ExpressionFailed(where, reason, now))

    def match(self, now: Instant, rule: int, part: int, step: int, facts: Sequence[Fact], reason: str) -> None:
        """Count and tell, once, that a `step` in a part of a rule failed for `facts`."""
        key = (rule, part, step, *[fact.serial for fact in facts])
        known = self._known
        if known is None:
            known = self._known = {}
        if key in known:
            return
        if len(known) >= FAILURES_MAX and not self._make_room(known):
            self._dropped.add("failures", FAILURES_MAX, now)
            return
        known[key] = tuple(facts)
        self.tell(now, rule_place(self._program, rule), reason)

    def _make_room(self, known: dict[Key, tuple[Fact, ...]]) -> bool:
        """Forget failures of which facts are gone; seldom while that leaves many, for it takes as long as there are."""
        if self._wait:
            self._wait -= 1
            return False
        for key in [key for key, facts in known.items() if not all(fact.held for fact in facts)]:
            del known[key]
        if len(known) > FAILURES_MAX // 2:
            self._wait = FAILURES_MAX
        return len(known) < FAILURES_MAX
