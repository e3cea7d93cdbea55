"""What happens when a fact comes or goes: the tables, and which rules it concerns.

A fact that comes is shown to each rule that has an atom for it. What the text alone demands of the fact (constants,
a variable that stands twice, for a rule of one atom all its conditions) is tested here, so that most rules never hear
of it.
"""

import re
from collections.abc import Sequence

from rmr.base.values import Robot, Symbol
from rmr.bytecode.arithmetic import same
from rmr.bytecode.conform import length
from rmr.bytecode.program import Atom, Bind, Guard
from rmr.vm import machine
from rmr.vm.generate.body import ME, BoundSlots, slots_of
from rmr.vm.generate.expression_source import condition, narrowed
from rmr.vm.generate.fact_tables import FactTable, column, tuple_of, write_forgetting, write_indexing
from rmr.vm.generate.lines import Lines
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.generate.source import Pool
from rmr.vm.match import plan_atom


class FactWriter:
    """Writes ``add{predicate}`` and ``remove{predicate}``, and the same in line."""

    def __init__(self, lines: Lines, pool: Pool, tables: Sequence[FactTable], plans: Sequence[RulePlan]) -> None:
        self._lines = lines
        self._pool = pool
        self._tables = tables
        self._plans = plans
        self._predicates = tuple(table.predicate for table in tables)
        pool.helper("length", length)

    def functions(self, predicate: int) -> None:
        """Write the functions for the facts of a predicate."""
        lines, table = self._lines, self._tables[predicate]
        args = [f"a{place}" for place in range(table.arity)]
        with lines.block(f"def add{predicate}({', '.join(['vm', 'now', *args])}):"):
            self.insertion(predicate, args)
        with lines.block(f"def remove{predicate}(vm, now, f):"):
            lines("vm.count -= 1")
            if self.readers(predicate):
                lines("vm.busy = True")
            self.remove(predicate, "f")
            readers = mask(self.readers(predicate))
            lines(f"if vm.heed: vm.went(now, {predicate}, {table.args('f')}, {readers})")

    def several(self, predicate: int) -> None:
        """Write the function that inserts facts of a predicate, given all their arguments."""
        lines, table = self._lines, self._tables[predicate]
        args = [f"a{place}" for place in range(table.arity)]
        readers = mask(self.readers(predicate))
        with lines.block(f"def several{predicate}(vm, now, rows):"):
            lines(f"{ME} = vm.robot", *(["vm.busy = True"] if readers else []))
            each = f"for {tuple_of(args) if args else '_'} in rows:"
            if table.linear and not table.long and not table.concerned:
                with lines.block(f"if not vm.heed and vm.count + len(rows) <= {machine.FACTS_MAX}:"):
                    lines("vm.count += len(rows)", "s = vm.s")
                    with lines.block(each):
                        self.add(predicate, args, "", serial="s += 1")
                    lines("vm.s = s", "return")
            with lines.block(each):
                lines(f"if {self._unwanted(predicate, args)}: continue", "vm.count += 1")
                self.add(predicate, args, "key")
                lines(f"if vm.heed: vm.came(now, {predicate}, {tuple_of(args)}, {readers})")

    def insertion(self, predicate: int, args: Sequence[str]) -> None:
        """Write the rest of a function, which inserts a fact."""
        lines = self._lines
        lines(f"{ME} = vm.robot")
        lines(f"if {self._unwanted(predicate, args)}: return", "vm.count += 1")
        if self.readers(predicate):
            lines("vm.busy = True")
        self.add(predicate, args, "key")
        lines(f"if vm.heed: vm.came(now, {predicate}, {tuple_of(args)}, {mask(self.readers(predicate))})")

    def add_if_new(self, predicate: int, args: Sequence[str]) -> None:
        """Write that a fact is inserted, if there is room and it is not one of a set that holds already."""
        with self._lines.block(f"if not ({self._unwanted(predicate, args)}):"):
            self._lines("vm.count += 1")
            self.add(predicate, args, "key")

    def _unwanted(self, predicate: int, args: Sequence[str]) -> str:
        """Return the condition on which a fact is not inserted."""
        table = self._tables[predicate]
        most = f"vm.count >= {machine.FACTS_MAX}"
        if any(each.long for each in self._tables):
            most = f"({most} or vm.length >= {machine.FACTS_LENGTH_MAX})"
        full = f"{most} and vm.is_full(now)"
        return full if table.linear else f"(key := {table.key(self._pool, args)}) in {table.name} or {full}"

    def add(self, predicate: int, args: Sequence[str], key: str, serial: str = "s = vm.s = vm.s + 1") -> None:
        """Write that a fact is inserted, for which there is room, that holds not yet and is counted already.

        `serial` is the statement that takes the next serial.
        """
        lines, table = self._lines, self._tables[predicate]
        lines(*[f"vm.length += length({args[place]})" for place in table.long])
        lines(serial, f"f = {table.fact('s', args)}")
        if not table.queued:
            lines(f"{table.name}[{'s' if table.linear else key}] = f")
        write_indexing(lines, table, "f")
        self._show(predicate, args)
        if table.concerned:
            lines(f"vm.concern(now, {predicate}, {tuple_of(args)})")

    def remove(self, predicate: int, fact: str, but: int = 0) -> None:
        """Write that a fact that holds is removed, but for counting it; the rules `but` know of it."""
        lines, table = self._lines, self._tables[predicate]
        lines(f"{fact}[0] = False")
        if not table.queued:
            lines(f"del {table.name}[{table.fact_key(self._pool, fact)}]")
        lines(*[f"vm.length -= length({column(fact, place)})" for place in table.long])
        write_forgetting(lines, table, fact)
        self.removed(predicate, but)
        if table.dated:
            lines(f"vm._removed(now, {predicate}, {table.args(fact)}, {fact}[-1])")

    def removed(self, predicate: int, but: int = 0) -> None:
        """Write which rules are looked at again, except those in the mask `but`."""
        lines = self._lines
        again = [plan for plan in self._plans if plan.way is Way.AGAIN and predicate in plan.read()]
        free = mask([plan for plan in again if plan.once or predicate in (*plan.absent, *plan.inner)])
        if free:
            lines(f"vm.stale |= {free}", f"vm.changed |= {free}")
        if_ready = mask(self.readers(predicate)) & ~free & ~but
        if if_ready:
            lines(f"vm.stale |= vm.ready & {if_ready}")
        inner = mask([plan for plan in self.readers(predicate) if predicate in plan.inner]) & ~free
        if inner:
            lines(f"if vm.broken: vm.stale |= vm.broken & {inner}")

    def readers(self, predicate: int) -> list[RulePlan]:
        """Return the rules that name a predicate in a body."""
        return [plan for plan in self._plans if predicate in plan.read()]

    def is_queued(self, predicate: int) -> bool:
        """Tell whether the facts of a predicate need no table: one queue at most has each, and nobody else asks."""
        table, readers = self._tables[predicate], self.readers(predicate)
        gates = Gates(self._lines, self._pool)
        for plan in readers:
            if plan.way is not Way.SINGLE or plan.once or plan.may_break or predicate in plan.inner:
                return False
            self._gate(plan, *plan.atoms[0], [f"a{place}" for place in range(table.arity)], gates)
        return bool(readers) and table.linear and not table.dated and gates.is_exclusive

    def _show(self, predicate: int, args: Sequence[str]) -> None:
        """Write what each rule makes of a new fact."""
        lines = self._lines
        inner = 0
        gates = Gates(lines, self._pool)
        for plan in self.readers(predicate):
            if plan.way is Way.AGAIN:
                lines(f"vm.stale |= {plan.bit}", *([f"vm.changed |= {plan.bit}"] if plan.once else []))
                continue
            if predicate in plan.inner:
                inner |= plan.bit
            for place, atom in plan.atoms:
                if atom.predicate == predicate:
                    self._gate(plan, place, atom, args, gates)
            if plan.once and plan.may_break:
                lines(f"if vm.broken & {plan.bit}: vm.stale |= {plan.bit}; vm.changed |= {plan.bit}")
        if inner:
            lines(f"vm.stale |= (vm.ready | vm.broken) & {inner}")
        gates.write(f"{self._tables[predicate].name}.append(f)" if self._tables[predicate].queued else None)

    def _gate(self, plan: RulePlan, place: int, atom: Atom, args: Sequence[str], gates: "Gates") -> None:
        """Add that a rule takes notice of a fact for one of its atoms."""
        r = plan.index
        if plan.way is Way.SINGLE:
            taken = [f"if vm.m{r} is None: vm.m{r} = f; vm.{'stale' if plan.valued else 'ready'} |= {plan.bit}"]
            taken += [f"elif vm.q{r} is None: vm.q{r} = [0, f]", f"else: vm.q{r}.append(f)"]
            self._conditions(plan, atom, args, taken, gates)
            return
        first = place == plan.atoms[0][0]
        tests = self._top_tests(plan, atom, args) if first else [*self.tests(atom, args), f"vm.l{r}"]
        queue = f"vm.q{r}" if first else f"vm.n{r}_{place}"
        taken = [f"if {queue} is None: {queue} = [{'0, ' if first else ''}f]", f"else: {queue}.append(f)"]
        lazy = first and not plan.is_eager and not plan.valued
        gates.add(tests, [*taken, f"{f'if not vm.ready & {plan.bit}: ' if lazy else ''}vm.stale |= {plan.bit}"])

    def _top_tests(self, plan: RulePlan, atom: Atom, args: Sequence[str]) -> list[str]:
        """Return what a rule demands of the fact of its first atom, whatever there is for the others."""
        slots = BoundSlots()
        tests = self.tests(atom, args, slots)
        slots.bind(plan_atom(atom, self._predicates, slots.names), self._tables[atom.predicate], args.__getitem__)
        for conjunct in () if plan.failing else plan.rule.body:
            if isinstance(conjunct, Guard) and slots_of(conjunct) <= slots.names.keys():
                tests.append(condition(conjunct.code, slots.names, slots.known, self._pool).text)
                slots.known.update(narrowed(conjunct.code, slots.known))
        return tests

    def _conditions(
        self, plan: RulePlan, atom: Atom, args: Sequence[str], taken: Sequence[str], gates: "Gates"
    ) -> None:
        """Add all the conditions of a rule of one atom, none of which can fail."""
        slots = BoundSlots()
        conditions: list[str] = []
        for conjunct in plan.rule.body:
            if isinstance(conjunct, Atom):
                conditions += self.tests(atom, args, slots)
                step = plan_atom(atom, self._predicates, slots.names)
                slots.bind(step, self._tables[atom.predicate], lambda position: args[position])
            elif isinstance(conjunct, Guard):
                conditions.append(condition(conjunct.code, slots.names, slots.known, self._pool).text)
                slots.known.update(narrowed(conjunct.code, slots.known))
            else:
                assert isinstance(conjunct, Bind)
                source = slots.expression(conjunct.code, self._pool)
                name = f"c{plan.index}_{conjunct.slot}"  # the rule that derives the fact has variables of its own
                conditions.append(f"(({name} := {source.text}), True)")
                slots.names[conjunct.slot], slots.known[conjunct.slot] = name, source.known
        gates.add(conditions, taken)

    def tests(self, atom: Atom, args: Sequence[str], slots: BoundSlots | None = None) -> list[str]:
        """Return what the text of an atom alone demands of a fact."""
        names = (slots or BoundSlots()).names
        step = plan_atom(atom, self._predicates, names)
        pairs = [(args[position], self._pool.constant(value)) for position, value in step.tests]
        pairs += [(args[position], names[slot]) for position, slot in step.joins]
        pairs += [(args[position], args[other]) for position, other in step.twins]
        if step.strict:
            return [f"{self._pool.helper('same', same)}({one}, {other})" for one, other in pairs]
        return [f"{one} == {other}" for one, other in pairs]


class Gates:
    """The conditions on which rules take notice of a fact.

    Where several rules demand that one expression equals different constants, it is worked out once, and the rest of
    a rule's conditions is looked at only where it does.
    """

    def __init__(self, lines: Lines, pool: Pool) -> None:
        self._lines = lines
        self._pool = pool
        self._gates: list[tuple[Sequence[str], Sequence[str]]] = []

    def add(self, conditions: Sequence[str], taken: Sequence[str]) -> None:
        """Add what is done with a fact that meets all `conditions`."""
        self._gates.append((conditions, taken))

    @property
    def is_exclusive(self) -> bool:
        """Whether a fact meets the conditions of one rule at most."""
        if len(self._gates) == 1:
            return True
        cases = list(self._cases().values())
        return len(cases) == 1 and len({value for value, _ in cases[0]}) == len(self._gates)

    def write(self, left: str | None = None) -> None:
        """Write all that has been added, and `left` for a fact that meets no conditions, if they are exclusive."""
        done: set[int] = set()
        for what, cases in self._cases().items():
            self._choose(what, cases, left)
            done |= {number for _, number in cases}
        for number, (conditions, taken) in enumerate(self._gates):
            if number not in done:
                self._gate(conditions, taken, left)
        if left is not None and not self._gates:
            self._lines(left)

    def _cases(self) -> dict[str, list[tuple[str, int]]]:
        """Return the expressions that are compared with several constants: constants, and numbers of gates."""
        chosen: dict[str, list[tuple[str, int]]] = {}
        for number, (conditions, _) in enumerate(self._gates):
            equal = next((match for match in map(_EQUAL.fullmatch, conditions) if match and self._tells(match)), None)
            if equal is not None and not any(":=" in each for each in conditions):
                chosen.setdefault(equal["what"], []).append((equal["value"], number))
        return {what: cases for what, cases in chosen.items() if len({value for value, _ in cases}) >= CASES_FROM}

    def _tells(self, match: re.Match[str]) -> bool:
        """Tell whether an expression that equals the constant equals no other one."""
        return type(self._pool.globals.get(match["value"], 0)) in (int, Symbol, Robot) and not _WORD.search(
            match["what"]
        )

    def _choose(self, what: str, cases: Sequence[tuple[str, int]], left: str | None) -> None:
        lines, word = self._lines, "if"
        lines(f"c = {what}")
        for value in dict.fromkeys(value for value, _ in cases):
            with lines.block(f"{word} c == {value}:"):
                for number in [number for other, number in cases if other == value]:
                    conditions, taken = self._gates[number]
                    self._gate([each for each in conditions if not _is(each, what, value)], taken, left)
            word = "elif"
        if left is not None:
            lines(f"else: {left}")

    def _gate(self, conditions: Sequence[str], taken: Sequence[str], left: str | None) -> None:
        if not conditions:
            self._lines(*taken)
            return
        with self._lines.block(f"if {' and '.join(conditions)}:"):
            self._lines(*taken)
        if left is not None:
            self._lines(f"else: {left}")


CASES_FROM = 3
"""Constants with which one expression is compared from which on it is worked out once."""

_EQUAL = re.compile(r"\(?(?P<what>[^=!<>:]+?) == (?P<value>\d+|k\d+)\)?")
"""An expression that must equal a constant."""

_WORD = re.compile(r"\b(and|or|not|if|else|in|is)\b")
"""What binds looser than a comparison."""


def _is(condition: str, what: str, value: str) -> bool:
    match = _EQUAL.fullmatch(condition)
    return match is not None and (match["what"], match["value"]) == (what, value)


def mask(plans: Sequence[RulePlan]) -> int:
    """Return the bits of rules."""
    bits = 0
    for plan in plans:
        bits |= plan.bit
    return bits
