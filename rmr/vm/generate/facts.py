"""What happens when a fact comes or goes: the tables, and which rules it concerns.

A fact that comes is shown to each rule that has an atom for it. What the text alone demands of the fact (constants,
a variable that stands twice, for a rule of one atom all its conditions) is tested here, so that most rules never hear
of it.
"""

from collections.abc import Sequence

from rmr.bytecode.arithmetic import same
from rmr.bytecode.conform import length
from rmr.bytecode.program import Atom, Bind, Guard
from rmr.vm.events import FactInserted, FactRemoved
from rmr.vm.generate.body import Slots
from rmr.vm.generate.expressions import condition, narrowed
from rmr.vm.generate.layout import Table, column, write_forgetting, write_indexing
from rmr.vm.generate.lines import Lines
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.generate.source import Pool
from rmr.vm.machine import FACTS_LENGTH_MAX, FACTS_MAX
from rmr.vm.match import plan_atom


class FactWriter:
    """Writes ``add{predicate}`` and ``remove{predicate}``, and the same in line."""

    def __init__(self, lines: Lines, pool: Pool, tables: Sequence[Table], plans: Sequence[RulePlan]) -> None:
        self._lines = lines
        self._pool = pool
        self._tables = tables
        self._plans = plans
        self._predicates = tuple(table.predicate for table in tables)
        for name, thing in (("FactInserted", FactInserted), ("FactRemoved", FactRemoved), ("length", length)):
            pool.helper(name, thing)

    def functions(self, predicate: int) -> None:
        """Write the functions for the facts of a predicate."""
        lines, table = self._lines, self._tables[predicate]
        args = [f"a{place}" for place in range(table.arity)]
        with lines.block(f"def add{predicate}({', '.join(['vm', 'now', *args])}):"):
            if not table.linear:
                lines(f"key = {table.key(self._pool, args)}", f"if key in {table.name}: return")
            lines(f"if (vm.count >= {FACTS_MAX} or vm.length >= {FACTS_LENGTH_MAX}) and vm.is_full(now): return")
            lines("vm.count += 1")
            self.add(predicate, args, "key")
        with lines.block(f"def remove{predicate}(vm, now, f):"):
            lines("vm.count -= 1")
            self.remove(predicate, "f")

    def add(self, predicate: int, args: Sequence[str], key: str) -> None:
        """Write that a fact is inserted, for which there is room, that holds not yet and is counted already."""
        lines, table = self._lines, self._tables[predicate]
        if self.readers(predicate):
            lines("vm.busy = True")
        lines(*[f"vm.length += length({args[place]})" for place in table.long])
        lines("s = vm.s = vm.s + 1", f"f = {table.fact(self._pool, 's', args)}")
        lines(f"{table.name}[{'s' if table.linear else key}] = f")
        write_indexing(lines, table, "f")
        tuple_ = f"({', '.join(args)}{',' if len(args) == 1 else ''})"
        lines(f"if vm._trace: vm._events.append(FactInserted({predicate}, {tuple_}, now))")
        self._show(predicate, args)
        touched = mask(self.readers(predicate))
        lines(f"{'' if table.concerned else 'if vm.wanting: '}vm.told(now, {predicate}, {tuple_}, {touched})")

    def remove(self, predicate: int, fact: str, but: int = 0) -> None:
        """Write that a fact that holds is removed, but for counting it; the rules `but` know of it."""
        lines, table = self._lines, self._tables[predicate]
        lines(f"{fact}[0] = False", f"del {table.name}[{table.fact_key(self._pool, fact)}]")
        lines(*[f"vm.length -= length({column(fact, place)})" for place in table.long])
        write_forgetting(lines, table, fact)
        self.removed(predicate, but)
        if table.dated:
            lines(f"vm._removed(now, {predicate}, {table.args(fact)}, {fact}[-1])")
        lines(f"if vm._trace: vm._events.append(FactRemoved({predicate}, {table.args(fact)}, now))")
        if self.readers(predicate):
            lines(f"if vm.wanting: vm.touched |= {mask(self.readers(predicate))}")

    def removed(self, predicate: int, but: int = 0) -> None:
        """Write which rules are looked at again, except those in the mask `but`."""
        lines = self._lines
        if self.readers(predicate):
            lines("vm.busy = True")
        again = [plan for plan in self._plans if plan.way is Way.AGAIN and predicate in plan.read()]
        free = mask([plan for plan in again if plan.once or predicate in plan.absent])
        if free:
            lines(f"vm.stale |= {free}", f"vm.changed |= {free}")
        if_ready = mask(self.readers(predicate)) & ~free & ~but
        if if_ready:
            lines(f"vm.stale |= vm.ready & {if_ready}")

    def readers(self, predicate: int) -> list[RulePlan]:
        """Return the rules that name a predicate in a body."""
        return [plan for plan in self._plans if predicate in plan.read()]

    def _show(self, predicate: int, args: Sequence[str]) -> None:
        """Write what each rule makes of a new fact."""
        lines = self._lines
        inner = 0
        for plan in self.readers(predicate):
            if plan.way is Way.AGAIN:
                lines(f"vm.stale |= {plan.bit}", *([f"vm.changed |= {plan.bit}"] if plan.once else []))
                continue
            if predicate in plan.inner:
                inner |= plan.bit
            for place, atom in plan.atoms:
                if atom.predicate == predicate:
                    self._gate(plan, place, atom, args)
            if plan.once and plan.may_break:
                lines(f"if vm.broken & {plan.bit}: vm.stale |= {plan.bit}; vm.changed |= {plan.bit}")
        if inner:
            lines(f"vm.stale |= vm.ready & {inner}")

    def _gate(self, plan: RulePlan, place: int, atom: Atom, args: Sequence[str]) -> None:
        """Write that a rule takes notice of a fact for one of its atoms."""
        lines, r = self._lines, plan.index
        with lines.level():
            if plan.way is Way.SINGLE:
                self._conditions(plan, atom, args)
                with lines.block(f"if vm.m{r} is None:"):
                    lines(f"vm.m{r} = f", f"vm.{'stale' if plan.valued else 'ready'} |= {plan.bit}")
                lines(f"elif vm.q{r} is None: vm.q{r} = [f]", f"else: vm.q{r}.append(f)")
                return
            tests = self.tests(atom, args)
            first = place == plan.atoms[0][0]
            if not first:
                tests.insert(0, f"vm.l{r}")
            if tests:
                lines(f"if {' and '.join(tests)}:")
                lines.enter()
            queue = f"vm.q{r}" if first else f"vm.n{r}_{place}"
            lines(f"if {queue} is None: {queue} = [f]", f"else: {queue}.append(f)")
            lazy = first and not plan.is_eager and not plan.valued
            lines(f"vm.stale |= {f'{plan.bit} & ~vm.ready' if lazy else plan.bit}")

    def _conditions(self, plan: RulePlan, atom: Atom, args: Sequence[str]) -> None:
        """Write all the conditions of a rule of one atom, none of which can fail."""
        lines, pool = self._lines, self._pool
        slots = Slots("vm.robot")
        for conjunct in plan.rule.body:
            if isinstance(conjunct, Atom):
                tests = self.tests(atom, args, slots)
                if tests:
                    lines(f"if {' and '.join(tests)}:")
                    lines.enter()
                step = plan_atom(atom, self._predicates, slots.names)
                slots.bind(step, self._tables[atom.predicate], lambda position: args[position])
            elif isinstance(conjunct, Guard):
                lines(f"if {condition(conjunct.code, slots.names, slots.known, pool).text}:")
                lines.enter()
                slots.known.update(narrowed(conjunct.code, slots.known))
            else:
                assert isinstance(conjunct, Bind)
                source = slots.expression(conjunct.code, pool)
                lines(f"b{conjunct.slot} = {source.text}")
                slots.names[conjunct.slot], slots.known[conjunct.slot] = f"b{conjunct.slot}", source.known

    def tests(self, atom: Atom, args: Sequence[str], slots: Slots | None = None) -> list[str]:
        """Return what the text of an atom alone demands of a fact."""
        names = (slots or Slots("vm.robot")).names
        step = plan_atom(atom, self._predicates, names)
        pairs = [(args[position], self._pool.constant(value)) for position, value in step.tests]
        pairs += [(args[position], names[slot]) for position, slot in step.joins]
        pairs += [(args[position], args[other]) for position, other in step.twins]
        if step.strict:
            return [f"{self._pool.helper('same', same)}({one}, {other})" for one, other in pairs]
        return [f"{one} == {other}" for one, other in pairs]


def mask(plans: Sequence[RulePlan]) -> int:
    """Return the bits of rules."""
    bits = 0
    for plan in plans:
        bits |= plan.bit
    return bits


