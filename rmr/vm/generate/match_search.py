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
from rmr.vm.generate.body import ME, Body, BoundSlots, begun, loads
from rmr.vm.generate.builder import Builder
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.form import (
    HELD,
    Assign,
    AssignAll,
    Block,
    Break,
    Call,
    Continue,
    Delete,
    If,
    Loop,
    Return,
    Statement,
    Test,
    Update,
    While,
    every,
    held,
    serial,
)
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
        if fact[HELD]:
            if taken > TAKEN_MAX and taken + taken > last:
                del queue[1 : taken + 1]
                taken = 0
            queue[0] = taken
            return fact
    return None


class FreshBody(Body):
    """A search that begins with a new fact of the atom at place `seed`."""

    def __init__(self, lines: Builder, pool: Pool, tables: Sequence[FactTable], top: int, seed: int) -> None:
        super().__init__(lines, pool, tables, BoundSlots(), Return())
        self._top = top
        self._seed = seed

    def stop(self, place: int, fact: str) -> str | None:
        """Leave out tops that have not been tried, and new facts of the atoms that have had theirs."""
        if place == self._top:
            return f"{serial(fact)} >= before"
        return f"{serial(fact)} > known" if place < self._seed else None


class SearchWriter:
    """Writes the search functions of one rule."""

    def __init__(self, plan: RulePlan, lines: Builder, pool: Pool, tables: Sequence[FactTable]) -> None:
        self._plan = plan
        self._state = plan.state
        self._functions = plan.functions
        self._lines = lines
        self._pool = pool
        self._tables = tables
        self._places = [place for place, _ in plan.atoms]
        self._satisfied = Update("vm.ready", "|", str(plan.bit))
        self._unsatisfied: Block = (Update("vm.ready", "&", str(~plan.bit)), Return())
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
        lines, state = self._lines, self._state
        with lines.function(self._functions.find, "vm", "now"):
            self._if_broken()
            # The match may have gone: then the next fact of the queue that still holds takes its place.
            following = AssignAll((state.match, "f"), f"{state.queue} and next_of({state.queue})")
            lines(Assign("f", state.match), If(f"f is None or not {held('f')}", (following,)))
            lines(If("f is None", self._unsatisfied))
            if self._plan.valued:
                self._work_out("f")
            lines(self._satisfied)

    def _work_out(self, facts: str) -> None:
        """Write that what the next match derives is worked out; if it has no value the rule is rematched."""
        value = f"{self._functions.value}(vm, now, {facts})"
        self._lines(AssignAll((self._state.valued, "v"), value), If("v is None", (self._break_off,)))

    # Several atoms

    def _from_top(self) -> None:
        """Write the search below one top: the first match, or all of them if each fires once (refraction)."""
        lines, plan = self._lines, self._plan
        kept = ["kept"] if plan.once else []
        with lines.function(self._functions.below, "vm", "now", plan.names()[0], *kept):
            lines(Assign(ME, "vm.robot"))
            mark = lines.mark()
            body = self._body(Return())
            self._below(body, self._keep if plan.once else Return(plan.entry()))
            lines.insert(mark, loads(body))

    def _below(self, body: Body, *leaf: Statement) -> None:
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
        fact = plan.facts[seed]
        with lines.function(self._functions.fresh(seed), "vm", "now", fact, "before", "known", "kept"):
            lines(Assign(ME, "vm.robot"))
            mark = lines.mark()
            body = FreshBody(lines, self._pool, self._tables, self._places[0], seed)
            body.take(seed, dict(plan.atoms)[seed], fact)
            body.seek(order_from(plan, seed), lambda: lines(self._keep))
            lines.insert(mark, loads(body))

    def _find_lasting(self) -> None:
        """Write the search of a rule that fires once for facts that never go: nothing can undo what is kept."""
        lines, plan, state = self._lines, self._plan, self._state
        with lines.function(self._functions.find, "vm", "now"):
            lines(*self._begin())
            self._load_kept()
            for place in self._places[1:]:
                self._join_new(place)
            lines(Assign(state.joined_up_to, "vm.s"))
            with lines.when("not kept"):
                lines(Assign("q", state.queue), If("q is None", self._unsatisfied))
                lines(Assign(ME, "vm.robot"), Assign("taken", "q[0]"), Assign("last", "len(q) - 1"))
                mark = lines.mark()
                with lines.repeat("taken < last"):
                    lines(Update("taken", "+", "1"), Assign(plan.names()[0], "q[taken]"))
                    body = self._body(Continue())
                    self._below(body, self._keep)
                    lines(If(f"len(kept) > {AT_ONCE_MAX}", (Break(),)))
                lines(Assign(state.last_top, serial("q[taken]")), self._shorten_queue())
                lines(If("not kept", self._unsatisfied), Call("kept.reverse()"))
                lines.insert(mark, loads(body))
            lines(self._satisfied)

    def _shorten_queue(self) -> If:
        """Return the statement that notes how far a queue has been taken, and deletes what has been if it is the most.

        Deleting costs time in proportion to what is left, so it waits until more has been taken than is left.
        """
        shorten: Block = (Delete("q[1:taken + 1]"), Assign("q[0]", "0"))
        long = If(f"taken > {TAKEN_MAX} and taken + taken > last", shorten, (Assign("q[0]", "taken"),))
        return If("taken == last", (Assign(self._state.queue, "None"),), (long,))

    def _find_join(self) -> None:
        lines, plan, state = self._lines, self._plan, self._state
        with lines.function(self._functions.find, "vm", "now"):
            self._if_broken()
            attempt = lines.attempt("NoValue", "", self._break_off) if plan.failing else lines.level()
            with attempt:
                if plan.once:
                    lines(*self._begin())
                self._load_kept()
                for place in self._places[1:]:
                    self._join_new(place)
                if plan.is_eager:
                    self._try_tops()
                    lines(_SORT_KEPT)
                    lines(Assign(state.joined_up_to, "vm.s"), self._drop_gone())
                    with lines.otherwise():
                        lines(*self._unsatisfied)
                else:
                    lines(Assign(state.joined_up_to, "vm.s"), self._drop_gone())
                    with lines.otherwise():
                        self._try_tops()
            if plan.valued:
                self._work_out("*kept[-1]")
            lines(self._satisfied)

    def _load_kept(self) -> None:
        kept = self._state.kept
        self._lines(Assign("kept", kept), If("kept is None", (AssignAll((kept, "kept"), "[]"),)))

    def _drop_gone(self) -> While:
        """Return the loop that leaves at the end of what is kept a match that holds, or takes its else."""
        holds = " and ".join(held(f"e[{place}]") for place in range(len(self._places)))
        return While("kept", (Assign("e", "kept[-1]"), If(holds, (Break(),)), Call("kept.pop()")))

    def _try_tops(self) -> None:
        """Write the search in the open top and then in the others, until there is a match."""
        lines, plan, state = self._lines, self._plan, self._state
        none: Block = (Break(),) if plan.is_eager else self._unsatisfied
        if not plan.once:
            lines(*self._begin())
        if plan.once or len(self._places) == 1:
            self._tops(none)
            return
        with_top = f"{self._functions.below}(vm, now, f)"
        lines(Assign("f", state.current_top))
        with lines.when("f is not None"):
            lines(Assign("e", f"{with_top} if {held('f')} else None"))
            used_up = Assign(state.current_top, "None")
            lines(If("e is not None", (Call("kept.append(e)"),), (used_up,)))
        with lines.when("not kept"):
            self._tops(none)

    def _tops(self, none: Block) -> None:
        """Write the search below one top after another; `none` is done when there is no top left."""
        lines, plan, state = self._lines, self._plan, self._state
        lines(Assign("q", state.queue))
        if not plan.once and not plan.valued:
            self._tops_in_line()
            return
        below = self._functions.below
        with lines.repeat("True"):
            lines(Assign("f", "q and next_of(q)"), If("not f", (Assign(state.queue, "None"), *none)))
            lines(Assign(state.last_top, serial("f")))
            if plan.once:
                lines(Call(f"{below}(vm, now, f, kept)"))
                if not plan.is_eager:
                    lines(If("kept", (Call("kept.reverse()"), Break())))
            else:
                lines(Assign("e", f"{below}(vm, now, f)"))
                is_open = [Assign(state.current_top, "f")] if len(self._places) > 1 else []
                lines(If("e is not None", (Call("kept.append(e)"), *is_open, Break())))

    def _tops_in_line(self) -> None:
        """Write the search below one top after another for the first match of a rule that consumes."""
        lines, plan, state = self._lines, self._plan, self._state
        fact = plan.names()[0]
        lines(Assign(ME, "vm.robot"))
        body = self._body(Continue())
        with lines.repeat("True"):
            # `next_of` in line for its usual case: the next fact still holds, and the queue need not be shortened.
            usual = f"q is not None and (h := q[0] + 1) + h <= len(q) and {held(f'({fact} := q[h])')}"
            none = If(f"q is None or ({fact} := next_of(q)) is None", (Assign(state.queue, "None"), *self._unsatisfied))
            lines(If(usual, (Assign("q[0]", "h"),), (none,)), Assign(state.last_top, serial(fact)))
            mark = lines.mark()
            is_open = [Assign(state.current_top, fact)] if len(self._places) > 1 else []
            self._below(body, self._keep, *is_open, self._satisfied, Return())
            lines.insert(mark, loads(body))  # each time anew: the first top that is tried may have made them

    def _join_new(self, place: int) -> None:
        """Write what is done with the new facts of one atom that is not the first."""
        lines, plan, state = self._lines, self._plan, self._state
        new = state.new(place)
        with lines.when(f"{new} is not None"):
            lines(Assign("new", new), Assign(new, "None"))
            if plan.once:
                lines(Assign("before", f"{state.last_top} + 1"))
            else:
                # The open top is joined with new facts later, when its search goes on.
                lines(Assign("f", state.current_top))
                lines(Assign("before", f"{state.last_top} + (f is None or not {held('f')})"))
                if place != self._places[1]:
                    # A new fact of an inner atom may make an older match of the open top than the one kept.
                    lines(If("f is not None and kept and kept[0][0] is f", (Delete("kept[0]"),)))
                few = f"len(new) <= {NEW_MAX} and len(kept) <= {KEPT_MAX}"
                lines(Assign("vm.looks", f"{FRESH_LOOKS_MAX} if {few} else -1"), Assign("vm.looking", "None"))
                lines(If("vm.looks < 0", (Assign("new", "()"),)))
            joined = Call(f"{self._functions.fresh(place)}(vm, now, f, before, {state.joined_up_to}, kept)")
            lines(Loop("f", "new", (If(held("f"), (joined,)),)))
            if not plan.once:
                restart = Call(f"{self._functions.restart}(vm)")
                lines(If("vm.looks < 0", (restart, Assign("kept", state.kept))))
            lines(_SORT_KEPT)
            if plan.once:
                lines(If(f"len(kept) > {once.MATCHES_MAX}", (Call("vm.spill(kept, now)"),)))

    def write_restart(self, top_gate: Sequence[Test]) -> None:
        """Write the function that lets all tops be tried again; `top_gate` are the conditions on a top ``f``."""
        lines, plan, state = self._lines, self._plan, self._state
        if plan.way is not Way.JOIN or plan.once or len(self._places) < 2:
            return
        table = self._tables[plan.atoms[0][1].predicate]
        tests = f" if {every(top_gate)}" if top_gate else ""
        with lines.function(self._functions.restart, "vm"):
            lines(Assign(ME, "vm.robot"), Assign(state.kept, "[]"))
            lines(Assign(state.current_top, "None"), Assign(state.last_top, "0"))
            lines(*[Assign(state.new(place), "None") for place in self._places[1:]])
            lines(Assign(state.queue, f"[0, *[f for f in {table.name}.values(){tests}]]"))

    def _body(self, leave: Statement) -> Body:
        return Body(self._lines, self._pool, self._tables, BoundSlots(), leave)

    @property
    def _keep(self) -> Call:
        return Call(f"kept.append({self._plan.entry()})")

    @property
    def _break_off(self) -> Return:
        return Return(f"vm.break_off({self._plan.index}, now)")

    def _begin(self) -> list[Statement]:
        """Return the statements that begin to count the facts that a search looks at."""
        rule = self._plan.rule
        return begun(self._pool, (self._plan.index, len(rule.head), len(rule.body)))

    def _if_broken(self) -> None:
        plan = self._plan
        if plan.may_break:
            rematch = Return(f"vm.rematch({plan.index}, now)")
            self._lines(If(f"vm.broken & {plan.bit}", (rematch,)))


_SORT_KEPT = If("len(kept) > 1", (Call("kept.sort(reverse=True)"),))
"""Puts the oldest match last, from where it is popped."""
