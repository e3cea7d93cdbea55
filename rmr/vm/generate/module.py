"""The module made from a program: its source, and what Python makes of it.

Source is made of verified programs only, on the machine that runs it, and never read from anywhere.
"""

from typing import Any

from rmr.bytecode.program import Program
from rmr.vm.generate.again import AgainWriter
from rmr.vm.generate.facts import FactWriter, mask
from rmr.vm.generate.heads import HeadWriter, write_bindings, written_items
from rmr.vm.generate.layout import Table, column, tables_of, write_probes
from rmr.vm.generate.lines import Lines
from rmr.vm.generate.loop import LoopWriter
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.generate.search import SearchWriter
from rmr.vm.generate.body import Slots
from rmr.vm.generate.source import Pool


def follow(vm: Any, now: int, chain: Any) -> None:
    """Derive the items of a chain."""
    vm._follow(now, chain)


class Module:
    """The generated code of one program, shared by all its machines."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.pool = Pool()
        self.pool.globals.update(NO={}, NONE=(), follow=follow)
        self.tables = tables_of(program)
        self.plans = [RulePlan(program, index, self.tables) for index in range(len(program.rules))]
        for plan in self.plans:
            plan.valued = self._is_valued(plan)
        for table in self.tables:
            table.log = self._is_log(table)
        self.source = self._write()
        self.names: dict[str, Any] = self.pool.globals
        self.names["FIND"] = find = {}
        exec(compile(self.source, "<rules>", "exec"), self.names)
        for plan in self.plans:
            find[plan.bit] = self.names[f"find{plan.index}"]
        count = len(program.predicates)
        self.add = [self.names[f"add{predicate}"] for predicate in range(count)]
        self.remove = [self.names[f"remove{predicate}"] for predicate in range(count)]
        self.fire = self.names["fire"]
        self.reset = self.names["reset"]
        self.at_first = mask([plan for plan in self.plans if plan.way is Way.AGAIN])
        self.all_rules = mask(self.plans)
        self.timed = mask([plan for plan in self.plans if plan.timed])
        self.slots: list[str] = self._slots
        self._slow: set[int] = set()

    def slow(self, rule: int) -> None:
        """Make the functions that enumerate a rule's matches as the specification does, unless they are there."""
        if rule in self._slow:
            return
        self._slow.add(rule)
        lines = Lines()
        if self.plans[rule].way is not Way.AGAIN:
            AgainWriter(self.plans[rule], lines, self.pool, self.tables, index=False).write()
        HeadWriter(self.program, rule, lines, self.pool, self.tables, index=False).write()
        exec(compile(lines.text, "<rules>", "exec"), self.names)

    def _is_valued(self, plan: RulePlan) -> bool:
        if plan.way is Way.AGAIN:
            return True
        lines, pool = Lines(), Pool()
        slots = write_bindings(lines, pool, plan.rule, self.tables, plan.facts)
        chains = written_items(plan.rule, slots, self.program, pool, self.tables)
        return chains is None or any(item.fails for chain in chains for item in chain)

    def _is_log(self, table: Table) -> bool:
        """Tell whether only queues, and the host, ask for the facts of a predicate."""
        readers = [plan for plan in self.plans if table.index in plan.read()]
        single = all(
            plan.way is Way.SINGLE and not plan.may_break and table.index not in plan.inner for plan in readers
        )
        return table.linear and not table.dated and single

    def _write(self) -> str:
        lines = Lines()
        facts = FactWriter(lines, self.pool, self.tables, self.plans)
        for plan in self.plans:
            search = SearchWriter(plan, lines, self.pool, self.tables)
            search.write()
            if plan.way is Way.AGAIN:
                AgainWriter(plan, lines, self.pool, self.tables, index=True).write()
                lines(f"def find{plan.index}(vm, now): vm.again({plan.index}, now)")
            else:
                place, atom = plan.atoms[0]
                columns = [column("f", i) for i in range(self.tables[atom.predicate].arity)]
                search.write_restart(facts.tests(atom, columns))
            if plan.valued:
                HeadWriter(self.program, plan.index, lines, self.pool, self.tables, index=True, calls=True).write()
        for predicate in range(len(self.program.predicates)):
            facts.functions(predicate)
        LoopWriter(self.program, lines, self.pool, self.tables, self.plans, facts).write()
        write_probes(lines, self.tables)
        self._write_reset(lines)
        return lines.text

    def _write_reset(self, lines: Lines) -> None:
        nothing: list[str] = []
        zero = []
        for plan in self.plans:
            r = plan.index
            if plan.way is Way.SINGLE:
                nothing += [f"m{r}", f"q{r}"]
            else:
                nothing.append(f"k{r}")
            if plan.valued:
                nothing.append(f"v{r}")
            if plan.way is Way.JOIN:
                nothing += [f"q{r}", f"c{r}", *[f"n{r}_{place}" for place, _ in plan.atoms[1:]]]
                zero += [f"l{r}", f"w{r}"]
        nothing += [name for table in self.tables for name in table.indices.values()]
        self._slots = [*nothing, *zero, *[f"t{table.index}" for table in self.tables]]
        with lines.block("def reset(vm):"):
            lines("pass", *[f"vm.{name} = None" for name in nothing], *[f"vm.{name} = 0" for name in zero])
            lines(*[f"{table.name} = {'[]' if table.log else '{}'}" for table in self.tables])
