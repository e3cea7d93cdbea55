"""The run loop: look again at the rules that something has changed for, choose one, fire it, until all is quiet.

Of a program with few rules all fire in this function, found by halving; of more each has a function. A head that is
nothing but facts, goals and actions that cannot fail is written out where the rule fires; what others derive is worked
out when the match is found (`rmr.vm.generate.head_functions`).
"""

from collections.abc import Sequence

from rmr.base.streams import Choices
from rmr.bytecode.program import Aggregate, Comprehension, DeriveAction, DeriveFact, DeriveGoal, Program, Strategy
from rmr.vm.derive import Derived
from rmr.vm.generate.body import ME
from rmr.vm.generate.fact_tables import FactTable, tuple_of
from rmr.vm.generate.facts import FactWriter
from rmr.vm.generate.head_items import WrittenItem, rows_of, write_bindings, written_items
from rmr.vm.generate.lines import Lines
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.generate.source import Pool
from rmr.vm.machine_events import FactSent, RuleFired

IN_LINE_MAX = 12
"""Rules that a predicate may concern so that the insertion of its facts is written out where they are derived."""

IN_LOOP_MAX = 8
"""Rules up to which all fire in the loop itself, with the event of each, the same all through a run, in a variable."""


class LoopWriter:
    """Writes ``fire``."""

    def __init__(
        self,
        program: Program,
        lines: Lines,
        pool: Pool,
        tables: Sequence[FactTable],
        plans: Sequence[RulePlan],
        facts: FactWriter,
    ) -> None:
        self._program = program
        self._lines = lines
        self._pool = pool
        self._tables = tables
        self._plans = plans
        self._facts = facts
        for name, thing in (("RuleFired", RuleFired), ("Derived", Derived), ("FactSent", FactSent)):
            pool.helper(name, thing)

    def write(self) -> None:
        """Write the function."""
        lines = self._lines
        timed = sum(plan.bit for plan in self._plans if plan.timed and plan.valued)
        with lines.block("def fire(vm, now):"):
            lines(f"{ME} = vm.robot", "emit = vm._events.append")
            if self.is_in_loop:
                lines(*[f"e{plan.index} = None" for plan in self._plans])
            else:
                lines("events = {}")
            if timed:
                lines(f"vm.stale |= vm.ready & {timed}")
            with lines.block("for _ in range(vm._budget):"):
                with lines.block("if vm.heed:"):
                    lines("if vm.fire_heeded(now): continue", "return")
                with lines.block("if vm.stale:"):
                    lines("stale = vm.stale", "vm.stale = 0")
                    with lines.block("while stale:"):
                        lines("low = stale & -stale", "stale ^= low", "FIND[low](vm, now)")
                lines("ready = vm.ready")
                with lines.block("if ready & (ready - 1):"):
                    if self._program.strategy is Strategy.TEXTUAL:
                        lines("ready &= -ready")
                    else:
                        self._draw()
                lines("elif not ready:", " vm.busy = False", " return")
                lines("vm.firings += 1")
                if not self.is_in_loop:
                    lines(
                        "e = events.get(ready)",
                        "if e is None:",
                        " events[ready] = e = RuleFired(ready.bit_length() - 1, now)",
                    )
                    lines("emit(e)", "FIRE[ready](vm, now, emit)")
                elif self._plans:
                    self._choose(0, len(self._plans))

    @property
    def is_in_loop(self) -> bool:
        """Whether all rules fire in the loop itself."""
        return len(self._plans) <= IN_LOOP_MAX

    def write_rule(self, plan: RulePlan) -> None:
        """Write the function in which one of many rules fires."""
        with self._lines.block(f"def fire{plan.index}(vm, now, emit):"):
            self._lines(f"{ME} = vm.robot")
            self._fire(plan)

    def _draw(self) -> None:
        """Write that one of the satisfied rules is drawn: `Choices.below` in line."""
        lines = self._lines
        one, other = Choices.MULTIPLIERS
        lines("choices = vm._choices")
        lines(f"choices.state = z = choices.state + {Choices.GAMMA} & {Choices.MASK}")
        lines(f"z = (z ^ z >> 30) * {one} & {Choices.MASK}", f"z = (z ^ z >> 27) * {other} & {Choices.MASK}")
        lines("draw = (z >> 32 ^ z >> 63) * ready.bit_count() >> 32  # the upper half of z ^ z >> 31")
        lines("while draw: ready &= ready - 1; draw -= 1", "ready &= -ready")

    def _choose(self, first: int, end: int) -> None:
        """Write the firing of one of the rules from `first` up to before `end`."""
        if end - first == 1:
            self._lines(f"if e{first} is None: e{first} = RuleFired({first}, now)", f"emit(e{first})")
            self._fire(self._plans[first])
            return
        middle = (first + end) // 2
        with self._lines.block(f"if ready < {1 << middle}:"):
            self._choose(first, middle)
        with self._lines.block("else:"):
            self._choose(middle, end)

    def _fire(self, plan: RulePlan) -> None:
        """Write the firing of one rule."""
        self._take(plan)
        if plan.valued:
            self._fire_valued(plan)
        else:
            self._fire_in_line(plan)

    def _fire_valued(self, plan: RulePlan) -> None:
        """Write that what was worked out when the match was found (`value`) is consumed and derived."""
        lines = self._lines
        lines(f"consumed, out = vm.v{plan.index}")
        self._consume(plan, 0)
        if any(isinstance(head, Comprehension | Aggregate) for head in plan.rule.head):
            lines("for call, f in consumed: call(vm, now, f)")
        rows = rows_of(plan.rule)
        if rows is None:
            lines("for call in out: call[0](vm, now, *call[1:])")
            return
        names = [f"a{place}" for place in range(self._tables[rows].arity)]
        with lines.block(f"for {tuple_of(names)} in out:"):
            if len(self._facts.readers(rows)) <= IN_LINE_MAX:
                self._facts.add_if_new(rows, names)
            else:
                lines(f"add{rows}({', '.join(['vm', 'now', *names])})")

    def _fire_in_line(self, plan: RulePlan) -> None:
        """Write out what a head that cannot fail derives."""
        slots = write_bindings(self._lines, self._pool, plan.rule, self._tables, plan.facts)
        chains = written_items(plan.rule, slots, self._program, self._pool, self._tables)
        assert chains is not None
        items = [item for chain in chains for item in chain]
        made = [item for item in items if isinstance(item.item, DeriveFact)]
        plain = all(len(chain) == 1 for chain in chains) and not any(isinstance(i.item, DeriveGoal) for i in items)
        in_line = plain and all(map(self._is_in_line, made))
        roomy = in_line and len(made) <= len(plan.consumed) and all(map(self._is_temporary, made))
        self._consume(plan, len(made) if roomy else 0)
        for chain in chains:
            self._derive(chain, in_line, roomy)

    def _take(self, plan: RulePlan) -> None:
        """Write what takes the match out of what the rule keeps."""
        lines, r, names = self._lines, plan.index, plan.names()
        if plan.way is Way.SINGLE:
            lines(f"{names[0]} = vm.m{r}")
            if plan.may_break:
                note = f"; vm.fired[{r}].fire(({names[0]},))" if plan.once else ""
                lines(f"if vm.broken & {plan.bit}: vm.stale |= {plan.bit}{note}")
            lines(f"q = vm.q{r}", f"if q is None: vm.m{r} = None; vm.ready ^= {plan.bit}")
            if not plan.valued:
                lines(f"elif (h := q[0] + 1) + h <= len(q) and (f := q[h])[0]: q[0] = h; vm.m{r} = f")
            with lines.block("else:"):
                lines(f"vm.m{r} = f = next_of(q)", f"if f is None: vm.q{r} = None; vm.ready ^= {plan.bit}")
                if plan.valued:
                    lines(f"else: vm.stale |= {plan.bit}")
            return
        noted = plan.once and (plan.way is Way.AGAIN or plan.may_break)
        left = [*([", ".join(names) + ","] if names else []), *(["e"] if noted or not names else [])]
        lines(f"kept = vm.k{r}", f"{' = '.join(left)} = kept.pop()")
        if plan.once and plan.way is Way.AGAIN:
            lines(f"vm.fired[{r}].fire(e)")
        elif plan.once and plan.may_break:
            lines(f"if vm.broken & {plan.bit}: vm.fired[{r}].fire(e)")
        if plan.lasting and not plan.may_break:
            lines(f"if not kept: vm.stale |= {plan.bit}")
        elif plan.way is Way.JOIN and plan.atoms[0][0] in plan.consumed and not plan.may_break:
            self._next_top(plan)
        else:
            lines(f"vm.stale |= {plan.bit}")

    def _consume(self, plan: RulePlan, made: int) -> None:
        """Write that what the body consumes goes; so many facts will be `made` that are counted here."""
        change = made - len(plan.consumed)
        if change:
            self._lines(f"vm.count {'+' if change > 0 else '-'}= {abs(change)}")
        atoms = dict(plan.atoms)
        for place in plan.consumed:
            self._facts.remove(atoms[place].predicate, plan.facts[place], plan.bit)

    def _next_top(self, plan: RulePlan) -> None:
        """Write that a rule that consumes its top is looked at again only if there is something to look at."""
        r = plan.index
        left = ["kept", "(q and q[0] + 1 < len(q))", *[f"vm.n{r}_{place}" for place, _ in plan.atoms[1:]]]
        self._lines(f"q = vm.q{r}", f"if {' or '.join(left)}: vm.stale |= {plan.bit}")
        gone = f"vm.c{r} = vm.q{r}" if len(plan.atoms) > 1 else f"vm.q{r}"
        self._lines(f"else: {gone} = None; vm.ready ^= {plan.bit}")

    def _is_in_line(self, item: WrittenItem) -> bool:
        """Tell whether the insertion of a fact is written out."""
        return item.mine and len(self._facts.readers(item.item.predicate)) <= IN_LINE_MAX

    def _is_temporary(self, item: WrittenItem) -> bool:
        """Tell whether there is room for a fact if another one has gone: it is never too long, and always new."""
        table = self._tables[item.item.predicate]
        return table.linear and not table.long

    def _derive(self, chain: list[WrittenItem], in_line: bool, roomy: bool) -> None:
        lines, pool = self._lines, self._pool
        item = chain[0]
        if len(chain) == 1 and isinstance(item.item, DeriveAction):
            action = f"now, {item.item.predicate}, {item.owner.text}, {tuple_of([each.text for each in item.args])}"
            mine = f"emit((vm._any_actions or vm._under_way).begin({action}))"
            lines(mine if item.mine else f"vm._act({action})")
            return
        if len(chain) > 1 or not isinstance(item.item, DeriveFact):
            sources = [each.write(lines, pool) for each in chain]
            lines(f"vm._follow(now, {tuple_of(sources)})")
            return
        args = [each.text for each in item.args]
        predicate = item.item.predicate
        if item.mine and in_line:
            names = [f"a{place}" for place in range(len(args))]
            lines(*[f"{name} = {text}" for name, text in zip(names, args, strict=True)])
            if roomy:
                self._facts.add(predicate, names, "")
            else:
                self._facts.add_if_new(predicate, names)
        elif item.mine:
            lines(f"add{predicate}({', '.join(['vm', 'now', *args])})")
        else:
            with lines.block(f"if (owner := {item.owner.text}) == {ME}:"):
                lines(f"add{predicate}({', '.join(['vm', 'now', *args])})")
            lines(f"else: emit(FactSent(owner, {predicate}, {tuple_of(args)}))")
