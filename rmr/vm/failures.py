"""Failures of expressions (``1 / 0`` has no value), each reported once with its place.

A match that fails is found again whenever its rule is matched. It is recognised by its facts, so it is reported once. A
remembered failure is forgotten when room is needed and one of its facts is gone.
"""

from collections.abc import Sequence

from rmr.base.time import Instant
from rmr.bytecode.program import Program
from rmr.vm.bounds import Dropped
from rmr.vm.machine_events import ExpressionFailed, VmEvent
from rmr.vm.store import Fact

FAILURES_MAX = 1024
"""Remembered failures of matches; beyond that new ones are counted as dropped and not reported."""

Key = tuple[int, ...]


def rule_place(program: Program, index: int) -> str:
    """Return where a rule stands: ``rule at corridor.rmr:12``, or ``rule 3`` without the debug section."""
    places = program.debug.rules if program.debug is not None else ()
    return f"rule at {places[index].file}:{places[index].line}" if index < len(places) else f"rule {index}"


class Failures:
    """The failures of one robot."""

    __slots__ = ("_dropped", "_events", "_known", "_program", "_wait", "count")

    def __init__(self, program: Program, events: list[VmEvent], dropped: Dropped) -> None:
        """Report failures to `events`."""
        self.count = 0
        self._program = program
        self._events = events
        self._dropped = dropped
        self._known: dict[Key, tuple[Fact, ...]] | None = None
        """The failures of matches that are remembered; made with the first."""
        self._wait = 0
        """Failures to drop before the next attempt to make room."""

    def report(self, now: Instant, where: str, reason: str) -> None:
        """Count and report a failure."""
        self.count += 1
        self._events.append(ExpressionFailed(where, reason, now))

    def match(self, now: Instant, rule: int, part: int, step: int, facts: Sequence[Fact], reason: str) -> None:
        """Count and report, once, that a `step` in a part of a rule failed for `facts`."""
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
        self.report(now, rule_place(self._program, rule), reason)

    def _make_room(self, known: dict[Key, tuple[Fact, ...]]) -> bool:
        """Forget failures with a fact that is gone; False if that leaves no room.

        A pass takes time in proportion to the failures remembered. After a pass that freed less than half, the next one
        waits for `FAILURES_MAX` failures, so its cost is amortised.
        """
        if self._wait:
            self._wait -= 1
            return False
        for key in [key for key, facts in known.items() if not all(fact.held for fact in facts)]:
            del known[key]
        if len(known) > FAILURES_MAX // 2:
            self._wait = FAILURES_MAX
        return len(known) < FAILURES_MAX
