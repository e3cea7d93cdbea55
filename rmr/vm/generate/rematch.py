"""The search as the specification does it: all conjuncts in the order of the text, each failure reported.

``each{rule}`` yields the matches one after another, the oldest facts first, conjunct by conjunct.
"""

from collections.abc import Sequence

from rmr.bytecode.heads import folds
from rmr.bytecode.program import Atom
from rmr.vm.generate.body import ME, Body, BoundSlots, begun, loads
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.form import Assign, Evaluate, Return, Yield, tuple_of
from rmr.vm.generate.plan import RulePlan
from rmr.vm.generate.source import Pool


class ReportingBody(Body):
    """A search that reports each failure of an expression."""

    def __init__(
        self,
        build: FormBuilder,
        pool: Pool,
        tables: Sequence[FactTable],
        plan: RulePlan,
        *,
        may_index: bool,
        counted: bool,
    ) -> None:
        super().__init__(build, pool, tables, BoundSlots(), Return(), may_index=may_index, counted=counted)
        self._plan = plan

    def report(self, place: int) -> Evaluate:
        """Return the call that reports a failure."""
        part = len(self._plan.rule.head)
        return Evaluate(f"vm.failed(now, {self._plan.index}, {part}, {place}, {tuple_of(self.found)}, reason)")


class RematchWriter:
    """Writes ``each{rule}``."""

    def __init__(
        self, plan: RulePlan, build: FormBuilder, pool: Pool, tables: Sequence[FactTable], *, index: bool
    ) -> None:
        """Use new indices only if `index` says that the layout of the indices is still open."""
        self._plan = plan
        self._build = build
        self._pool = pool
        self._tables = tables
        self._index = index

    def write(self) -> None:
        """Write the function."""
        build = self._build
        plan = self._plan
        with build.function(plan.functions.each, "vm", "now"):
            build(Assign(ME, "vm.robot"))
            counted = sum(isinstance(each, Atom) for each in plan.rule.body) > 1 or any(folds(plan.rule.body))
            if counted:
                build(*begun(self._pool, (plan.index, len(plan.rule.head), len(plan.rule.body))))
            mark = build.mark()
            body = ReportingBody(build, self._pool, self._tables, plan, may_index=self._index, counted=counted)
            entry = plan.entry() if plan.facts else "()"
            body.seek(list(enumerate(plan.rule.body)), lambda: build(Yield(entry)))
            build.insert(mark, loads(body))
