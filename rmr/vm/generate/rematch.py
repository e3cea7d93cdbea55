"""The search as the specification does it: all conjuncts in the order of the text, each failure told.

``each{rule}`` yields the matches one after another, the oldest facts first, conjunct by conjunct.
"""

from collections.abc import Sequence

from rmr.bytecode.program import Atom
from rmr.vm.generate.body import ME, Body, BoundSlots, begun, loads
from rmr.vm.generate.fact_tables import FactTable, tuple_of
from rmr.vm.generate.lines import Lines
from rmr.vm.generate.plan import RulePlan
from rmr.vm.generate.source import Pool


class TellingBody(Body):
    """A search that tells what fails in it."""

    def __init__(
        self, lines: Lines, pool: Pool, tables: Sequence[FactTable], plan: RulePlan, *, may_index: bool, counted: bool
    ) -> None:
        super().__init__(lines, pool, tables, BoundSlots(), "return", may_index=may_index, counted=counted)
        self._plan = plan

    def told(self, place: int) -> str:
        """Return the call that tells of a failure."""
        part = len(self._plan.rule.head)
        return f"vm.failed(now, {self._plan.index}, {part}, {place}, {tuple_of(self.found)}, reason)"


class AgainWriter:
    """Writes ``each{rule}``."""

    def __init__(self, plan: RulePlan, lines: Lines, pool: Pool, tables: Sequence[FactTable], *, index: bool) -> None:
        """Use new indices only if `index` says that all are not laid out yet."""
        self._plan = plan
        self._lines = lines
        self._pool = pool
        self._tables = tables
        self._index = index

    def write(self) -> None:
        """Write the function."""
        lines, plan = self._lines, self._plan
        with lines.block(f"def each{plan.index}(vm, now):"):
            lines(f"{ME} = vm.robot")
            counted = sum(isinstance(each, Atom) for each in plan.rule.body) > 1
            if counted:
                lines(begun(self._pool, (plan.index, len(plan.rule.head), len(plan.rule.body))))
            mark = lines.mark()
            body = TellingBody(lines, self._pool, self._tables, plan, may_index=self._index, counted=counted)
            entry = plan.entry() if plan.atoms else "()"
            body.seek(list(enumerate(plan.rule.body)), lambda: lines(f"yield {entry}"))
            lines.insert(mark, loads(body))
        lines("")
