"""The functions that find the match with which a rule fires next: the oldest facts, conjunct by conjunct.

``find{rule}`` is called when that match may have gone or an earlier one may have come, and leaves in the machine
whether the rule is satisfied. Of a rule that joins atoms the machine keeps: the tops that have not been tried, the
top that may have more matches than the one found, the serial of the last top tried, the new facts of the other atoms,
and the matches found, the oldest last. What lies behind the top that is open is not looked at before it is needed.
Matches are compared by their facts, and facts by their serials, but for those that are gone: they come to the end.
"""

from collections.abc import Sequence
from typing import Any

from rmr.bytecode.arithmetic import NoValue
from rmr.vm import once
from rmr.vm.generate.body import ME, Body, BoundSlots, begun, loads, serial
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.lines import Lines
from rmr.vm.generate.plan import RulePlan, Way, order_from
from rmr.vm.generate.source import Pool

NEW_MAX = 64
"""New facts of one atom up to which each is joined with the tops; of more the tops are rather tried again."""

FRESH_LOOKS_MAX = 1 << 12
"""Facts that may be looked at to join new facts with the tops before these are rather tried again."""

TAKEN_MAX = 64
"""Facts that have been taken out of a queue before it is made shorter, if they are the most of it."""

AT_ONCE_MAX = 32
"""Matches of a rule that nothing undoes that are enough for a while."""

KEPT_MAX = 4096
"""Matches that a rule that consumes keeps; with more the tops are rather tried again, one after another."""


def next_of(queue: list[Any]) -> list[Any] | None:
    """Take the oldest fact that holds out of a queue: its first item counts how many behind it have been taken."""
    taken, last = queue[0], len(queue) - 1
    while taken < last:
        taken += 1
        fact: list[Any] = queue[taken]
        if fact[0]:
            if taken > TAKEN_MAX and taken + taken > last:
                del queue[1 : taken + 1]
                taken = 0
            queue[0] = taken
            return fact
    return None


class FreshBody(Body):
    """A search that begins with a new fact of the atom at place `seed`."""

    def __init__(self, lines: Lines, pool: Pool, tables: Sequence[FactTable], top: int, seed: int) -> None:
        super().__init__(lines, pool, tables, BoundSlots(), "return")
        self._top = top
        self._seed = seed

    def stop(self, place: int, fact: str) -> str | None:
        """Leave out tops that have not been tried, and new facts of the atoms that have had theirs."""
        if place == self._top:
            return f"{serial(fact)} >= before"
        return f"{serial(fact)} > known" if place < self._seed else None


class SearchWriter:
    """Writes the search functions of one rule."""

    def __init__(self, plan: RulePlan, lines: Lines, pool: Pool, tables: Sequence[FactTable]) -> None:
        self._plan = plan
        self._lines = lines
        self._pool = pool
        self._tables = tables
        self._r = plan.index
        self._places = [place for place, _ in plan.atoms]
        pool.helper("next_of", next_of)
        pool.helper("NoValue", NoValue)

    def write(self) -> None:
        """Write what the rule's way needs."""
        if self._plan.way is Way.SINGLE:
            self._find_single()
        elif self._plan.way is Way.JOIN:
            self._from_top()
            for place in self._places[1:]:
                self._fresh(place)
            if self._plan.lasting and not self._plan.may_break:
                self._find_lasting()
            else:
                self._find_join()

    # One atom

    def _find_single(self) -> None:
        lines, r, bit = self._lines, self._r, self._plan.bit
        with lines.block(f"def find{r}(vm, now):"):
            self._if_broken()
            lines(f"f = vm.m{r}", f"if f is None or not f[0]: vm.m{r} = f = vm.q{r} and next_of(vm.q{r})")
            lines("if f is None:", f" vm.ready &= {~bit}", " return")
            if self._plan.valued:
                lines(f"vm.v{r} = v = value{r}(vm, now, f)", f"if v is None: return vm.break_off({r}, now)")
            lines(f"vm.ready |= {bit}")

    # Several atoms

    def _from_top(self) -> None:
        """Write the search below one top: the first match, or all of them if each fires once."""
        lines, plan, r = self._lines, self._plan, self._r
        parameters = f"vm, now, {plan.names()[0]}{', kept' if plan.once else ''}"
        with lines.block(f"def below{r}({parameters}):"):
            lines(f"{ME} = vm.robot")
            mark = lines.mark()
            body = Body(lines, self._pool, self._tables, BoundSlots(), "return")
            self._below(body, f"kept.append({plan.entry()})" if plan.once else f"return {plan.entry()}")
            lines.insert(mark, loads(body))

    def _below(self, body: Body, *leaf: str) -> None:
        """Write the search for the matches with a given top, and what is done with each of them."""
        plan = self._plan
        top, atom = plan.atoms[0]
        conjuncts = list(enumerate(plan.rule.body))
        body.seek(conjuncts[:top], lambda: None)
        body.take(top, atom, plan.facts[top])
        body.seek(conjuncts[top + 1 :], lambda: self._lines(*leaf))

    def _fresh(self, seed: int) -> None:
        """Write the search for the matches in which the atom at place `seed` takes a new fact."""
        lines, plan = self._lines, self._plan
        top = self._places[0]
        fact = plan.facts[seed]
        with lines.block(f"def fresh{self._r}_{seed}(vm, now, {fact}, before, known, kept):"):
            lines(f"{ME} = vm.robot")
            mark = lines.mark()
            body = FreshBody(lines, self._pool, self._tables, top, seed)
            body.take(seed, dict(plan.atoms)[seed], fact)
            body.seek(order_from(plan, seed), lambda: lines(f"kept.append({plan.entry()})"))
            lines.insert(mark, loads(body))

    def _find_lasting(self) -> None:
        """Write the search of a rule that fires once for facts that never go: nothing can undo what is kept."""
        lines, plan, r = self._lines, self._plan, self._r
        with lines.block(f"def find{r}(vm, now):"):
            lines(self._begin(), f"kept = vm.k{r}", f"if kept is None: vm.k{r} = kept = []")
            for place in self._places[1:]:
                self._join_new(place)
            lines(f"vm.w{r} = vm.s")
            with lines.block("if not kept:"):
                lines(f"q = vm.q{r}", f"if q is None: vm.ready &= {~plan.bit}; return")
                lines(f"{ME} = vm.robot", "taken = q[0]", "last = len(q) - 1")
                mark = lines.mark()
                with lines.block("while taken < last:"):
                    lines("taken += 1", f"{plan.names()[0]} = q[taken]")
                    body = Body(lines, self._pool, self._tables, BoundSlots(), "continue")
                    self._below(body, f"kept.append({plan.entry()})")
                    lines(f"if len(kept) > {AT_ONCE_MAX}: break")
                lines(f"vm.l{r} = q[taken][1]")
                lines(f"if taken == last: vm.q{r} = None")
                lines(f"elif taken > {TAKEN_MAX} and taken + taken > last: del q[1:taken + 1]; q[0] = 0")
                lines("else: q[0] = taken", f"if not kept: vm.ready &= {~plan.bit}; return", "kept.reverse()")
                lines.insert(mark, loads(body))
            lines(f"vm.ready |= {plan.bit}")

    def _find_join(self) -> None:
        lines, plan, r = self._lines, self._plan, self._r
        failing = bool(plan.failing)
        with lines.block(f"def find{r}(vm, now):"):
            self._if_broken()
            with lines.level():
                if failing:
                    lines("try:")
                    lines.enter()
                if plan.once:
                    lines(self._begin())
                lines(f"kept = vm.k{r}", f"if kept is None: vm.k{r} = kept = []")
                for place in self._places[1:]:
                    self._join_new(place)
                if plan.is_eager:
                    self._try_tops()
                    lines("if len(kept) > 1: kept.sort(reverse=True)")
                    lines(f"vm.w{r} = vm.s")
                    self._drop_gone()
                    with lines.block("else:"):
                        lines(f"vm.ready &= {~plan.bit}", "return")
                else:
                    lines(f"vm.w{r} = vm.s")
                    self._drop_gone()
                    with lines.block("else:"):
                        self._try_tops()
            if failing:
                lines("except NoValue:", f" return vm.break_off({r}, now)")
            if plan.valued:
                lines(f"vm.v{r} = v = value{r}(vm, now, *kept[-1])")
                lines(f"if v is None: return vm.break_off({r}, now)")
            lines(f"vm.ready |= {plan.bit}")

    def _drop_gone(self) -> None:
        """Write the loop that leaves at the end of what is kept a match that holds, or takes its else."""
        lines = self._lines
        with lines.block("while kept:"):
            lines("e = kept[-1]")
            held = " and ".join(f"e[{place}][0]" for place in range(len(self._places)))
            lines(f"if {held}: break", "kept.pop()")

    def _try_tops(self) -> None:
        """Write the search in the open top and then in the others, until there is a match."""
        lines, plan, r = self._lines, self._plan, self._r
        none = "break" if plan.is_eager else f"vm.ready &= {~plan.bit}; return"
        if not plan.once:
            lines(self._begin())
        if not plan.once and len(self._places) > 1:
            lines(f"f = vm.c{r}")
            with lines.block("if f is not None:"):
                lines(f"e = below{r}(vm, now, f) if f[0] else None")
                lines("if e is not None: kept.append(e)", f"else: vm.c{r} = None")
            with lines.level():
                lines("if not kept:")
                lines.enter()
                self._tops(none)
            return
        self._tops(none)

    def _tops(self, none: str) -> None:
        lines, plan, r = self._lines, self._plan, self._r
        lines(f"q = vm.q{r}")
        if not plan.once and not plan.valued:
            self._tops_in_line()
            return
        with lines.block("while True:"):
            lines("f = q and next_of(q)", "if not f:", f" vm.q{r} = None", *(f" {each}" for each in none.split("; ")))
            lines(f"vm.l{r} = f[1]")
            if plan.once:
                lines(f"below{r}(vm, now, f, kept)")
                if not plan.is_eager:
                    lines("if kept: kept.reverse(); break")
            else:
                lines(f"e = below{r}(vm, now, f)")
                with lines.block("if e is not None:"):
                    lines("kept.append(e)")
                    if len(self._places) > 1:
                        lines(f"vm.c{r} = f")
                    lines("break")

    def _tops_in_line(self) -> None:
        """Write the search below one top after another for the first match of a rule that consumes."""
        lines, plan, r = self._lines, self._plan, self._r
        fact = plan.names()[0]
        lines(f"{ME} = vm.robot")
        body = Body(lines, self._pool, self._tables, BoundSlots(), "continue")
        with lines.block("while True:"):
            lines(f"if q is not None and (h := q[0] + 1) + h <= len(q) and ({fact} := q[h])[0]: q[0] = h")
            lines(f"elif q is None or ({fact} := next_of(q)) is None:")
            lines(f" vm.q{r} = None", f" vm.ready &= {~plan.bit}", " return")
            lines(f"vm.l{r} = {fact}[1]")
            mark = lines.mark()
            is_open = [f"vm.c{r} = {fact}"] if len(self._places) > 1 else []
            self._below(body, f"kept.append({plan.entry()})", *is_open, f"vm.ready |= {plan.bit}", "return")
            lines.insert(mark, loads(body))  # each time anew: the first top that is tried may have made them

    def _join_new(self, place: int) -> None:
        """Write what is done with the new facts of one atom that is not the first."""
        lines, plan, r = self._lines, self._plan, self._r
        with lines.block(f"if vm.n{r}_{place} is not None:"):
            lines(f"new = vm.n{r}_{place}", f"vm.n{r}_{place} = None")
            if plan.once:
                lines(f"before = vm.l{r} + 1")
            else:
                lines(f"f = vm.c{r}", f"before = vm.l{r} + (f is None or not f[0])")
                if place != self._places[1]:
                    lines("if f is not None and kept and kept[0][0] is f: del kept[0]")
                lines(f"vm.looks = {FRESH_LOOKS_MAX} if len(new) <= {NEW_MAX} and len(kept) <= {KEPT_MAX} else -1")
                lines("vm.looking = None", "if vm.looks < 0: new = ()")
            with lines.block("for f in new:"):
                lines(f"if f[0]: fresh{r}_{place}(vm, now, f, before, vm.w{r}, kept)")
            if not plan.once:
                lines(f"if vm.looks < 0: restart{r}(vm); kept = vm.k{r}")
            lines("if len(kept) > 1: kept.sort(reverse=True)")
            if plan.once:
                lines(f"if len(kept) > {once.MATCHES_MAX}: vm.spill(kept, now)")

    def write_restart(self, top_gate: Sequence[str]) -> None:
        """Write the function that lets all tops be tried again; `top_gate` are the conditions on a top ``f``."""
        lines, plan, r = self._lines, self._plan, self._r
        if plan.way is not Way.JOIN or plan.once or len(self._places) < 2:
            return
        table = self._tables[plan.atoms[0][1].predicate]
        tests = f" if {' and '.join(top_gate)}" if top_gate else ""
        with lines.block(f"def restart{r}(vm):"):
            lines(f"{ME} = vm.robot", f"vm.k{r} = []", f"vm.c{r} = None", f"vm.l{r} = 0")
            lines(*[f"vm.n{r}_{place} = None" for place in self._places[1:]])
            lines(f"vm.q{r} = [0, *[f for f in {table.name}.values(){tests}]]")

    def _begin(self) -> str:
        """Return the statement that begins to count the facts that a search looks at."""
        rule = self._plan.rule
        return begun(self._pool, (self._r, len(rule.head), len(rule.body)))

    def _if_broken(self) -> None:
        plan = self._plan
        if plan.may_break:
            self._lines(f"if vm.broken & {plan.bit}: return vm.again({plan.index}, now)")
