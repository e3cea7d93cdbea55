"""The functions that find the match with which a rule fires next: the oldest facts, conjunct by conjunct.

``find{rule}`` is called when that match may have gone or an earlier one may have arisen, and sets the bit that says
whether the rule is satisfied. A rule that joins atoms (JOIN) calls the facts of its first atom tops. Its state
(`rmr.vm.generate.state_layout.RuleSlots`) is the queue of untried tops, the current top, which may have more matches
than the one found, the serial number of the last top tried, the new facts of the other atoms, and the matches found,
the oldest last. Later tops are tried only when the current one is used up. Matches compare by their facts and facts by
their flag and serial number, so matches with removed facts sort to the end and are popped first.

``each{rule}`` yields all matches as the specification finds them: conjuncts in the order of the text, each failure
reported.
"""

from collections.abc import Callable, Sequence
from typing import Any

from rmr.bytecode.arithmetic import NoValue
from rmr.bytecode.heads import folds
from rmr.bytecode.program import Atom
from rmr.vm import once
from rmr.vm.generate.body import ME, Body, BoundSlots, begun, loads
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.form import (
    HELD,
    Assign,
    AssignAll,
    Block,
    Break,
    Continue,
    Delete,
    Evaluate,
    If,
    Loop,
    Return,
    Statement,
    Test,
    Update,
    While,
    Yield,
    every,
    held,
    serial,
)
from rmr.vm.generate.plan import RulePlan, Way, order_from
from rmr.vm.generate.source import Pool

NEW_MAX = 64
"""New facts of one atom up to which each is joined with the tops tried so far; for more, all tops are tried again."""

FRESH_LOOKS_MAX = 1 << 12
"""Facts that may be examined to join new facts with the tops; beyond that, all tops are tried again."""

TAKEN_MAX = 64
"""Facts taken out of a queue before it is shortened, which also needs that they are more than half of it."""

AT_ONCE_MAX = 32
"""Matches after which the search of a rule whose matches nothing undoes pauses until they have fired."""

KEPT_MAX = 4096
"""Matches that a consuming rule keeps; with more, they are discarded and all tops are tried again, one by one."""


def next_of(queue: list[Any]) -> list[Any] | None:
    """Take the oldest fact that holds out of a queue, whose first item counts the facts taken; None if none holds."""
    taken = queue[0]
    last = len(queue) - 1
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

    def __init__(self, build: FormBuilder, pool: Pool, tables: Sequence[FactTable], top: int, seed: int) -> None:
        super().__init__(build, pool, tables, BoundSlots(), Return())
        self._top = top
        self._seed = seed

    def stop(self, place: int, fact: str) -> str | None:
        """Leave out the combinations that another search finds, so that no match is found twice.

        Those are the tops that have not been tried, and new facts of atoms whose new facts have been joined already.
        """
        if place == self._top:
            return f"{serial(fact)} >= before"
        return f"{serial(fact)} > known" if place < self._seed else None


class SearchWriter:
    """Writes the search functions of one rule."""

    def __init__(self, plan: RulePlan, build: FormBuilder, pool: Pool, tables: Sequence[FactTable]) -> None:
        self._plan = plan
        self._state = plan.state
        self._functions = plan.functions
        self._build = build
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

    def write_each(self, *, may_index: bool) -> None:
        """Write ``each{rule}``, with new indices only if `may_index`: the layout of the indices is still open."""
        build = self._build
        plan = self._plan
        with build.function(self._functions.each, "vm", "now"):
            build(Assign(ME, "vm.robot"))
            counted = sum(isinstance(each, Atom) for each in plan.rule.body) > 1 or any(folds(plan.rule.body))
            if counted:
                build(*self.begin())
            mark = build.mark()
            reports = plan.index, len(plan.rule.head)
            body = self._body(Return(), may_index=may_index, counted=counted, reports=reports)
            body.seek(list(enumerate(plan.rule.body)), lambda: build(Yield(plan.entry() if plan.facts else "()")))
            build.insert(mark, loads(body))

    # One atom

    def _find_single(self) -> None:
        build = self._build
        state = self._state
        with build.function(self._functions.find, "vm", "now"):
            self._if_broken()
            # The match may have gone: then the next fact of the queue that still holds takes its place.
            following = AssignAll((state.match, "f"), f"{state.queue} and next_of({state.queue})")
            build(Assign("f", state.match), If(f"f is None or not {held('f')}", (following,)))
            build(If("f is None", self._unsatisfied))
            if self._plan.valued:
                self._work_out("f")
            build(self._satisfied)

    def _work_out(self, facts: str) -> None:
        """Write the evaluation of the next match's head; if it has no value, the rule is rematched."""
        value = f"{self._functions.value}(vm, now, {facts})"
        self._build(AssignAll((self._state.valued, "v"), value), If("v is None", (self._break_off,)))

    # Several atoms

    def _from_top(self) -> None:
        """Write the search below one top: the first match, or all of them if each fires once (refraction)."""
        build = self._build
        plan = self._plan
        kept = ["kept"] if plan.once else []
        with build.function(self._functions.below, "vm", "now", plan.names()[0], *kept):
            build(Assign(ME, "vm.robot"))
            found = self._keep if plan.once else Return(plan.entry())
            mark = build.mark()
            build.insert(mark, self.below(Return(), lambda: build(found)))

    def below(self, leave: Statement, leaf: Callable[[], None]) -> list[Statement]:
        """Write the search for the matches with a given top; `leaf` writes what is done with each of them.

        Returns the statements that load what it probes, which stand before it.
        """
        plan = self._plan
        top, atom = plan.atoms[0]
        conjuncts = list(enumerate(plan.rule.body))
        body = self._body(leave)
        body.seek(conjuncts[:top], lambda: None)
        body.take(top, atom, plan.facts[top])
        body.seek(conjuncts[top + 1 :], leaf)
        return loads(body)

    def _fresh(self, seed: int) -> None:
        """Write the search for the matches in which the atom at place `seed` takes a new fact."""
        build = self._build
        plan = self._plan
        fact = plan.facts[seed]
        with build.function(self._functions.fresh(seed), "vm", "now", fact, "before", "known", "kept"):
            build(Assign(ME, "vm.robot"))
            mark = build.mark()
            body = FreshBody(build, self._pool, self._tables, self._places[0], seed)
            body.take(seed, dict(plan.atoms)[seed], fact)
            body.seek(order_from(plan, seed), lambda: build(self._keep))
            build.insert(mark, loads(body))

    def _find_lasting(self) -> None:
        """Write the search of a rule that fires once for facts that never go: nothing can undo what is kept."""
        build = self._build
        plan = self._plan
        state = self._state
        with build.function(self._functions.find, "vm", "now"):
            build(*self.begin())
            self._load_kept()
            for place in self._places[1:]:
                self._join_new(place)
            build(Assign(state.joined_up_to, "vm.newest"))
            with build.when("not kept"):
                build(Assign("q", state.queue), If("q is None", self._unsatisfied))
                build(Assign(ME, "vm.robot"), Assign("taken", "q[0]"), Assign("last", "len(q) - 1"))
                mark = build.mark()
                with build.repeat("taken < last"):
                    build(Update("taken", "+", "1"), Assign(plan.names()[0], "q[taken]"))
                    uses = self.below(Continue(), lambda: build(self._keep))
                    build(If(f"len(kept) > {AT_ONCE_MAX}", (Break(),)))
                build(Assign(state.last_top, serial("q[taken]")), self.shorten_queue())
                build(If("not kept", self._unsatisfied), Evaluate("kept.reverse()"))
                build.insert(mark, uses)
            build(self._satisfied)

    def shorten_queue(self) -> If:
        """Return the statement that stores how far a queue has been taken; it deletes the taken part if that is larger.

        Deleting costs time in proportion to what is left, so it waits until more has been taken than is left.
        """
        shorten: Block = (Delete("q[1:taken + 1]"), Assign("q[0]", "0"))
        long = If(f"taken > {TAKEN_MAX} and taken + taken > last", shorten, (Assign("q[0]", "taken"),))
        return If("taken == last", (Assign(self._state.queue, "None"),), (long,))

    def _find_join(self) -> None:
        build = self._build
        plan = self._plan
        state = self._state
        with build.function(self._functions.find, "vm", "now"):
            self._if_broken()
            attempt = build.attempt("NoValue", "", self._break_off) if plan.failing else build.level()
            with attempt:
                if plan.once:
                    build(*self.begin())
                self._load_kept()
                for place in self._places[1:]:
                    self._join_new(place)
                if plan.is_eager:
                    # All tops at once, so that failures are reported when the specification reports them.
                    self._try_tops()
                    build(_SORT_KEPT)
                    build(Assign(state.joined_up_to, "vm.newest"), self._drop_gone())
                    with build.otherwise():
                        build(*self._unsatisfied)
                else:
                    # A kept match is older than any of a later top. So later tops are tried only when none is left.
                    build(Assign(state.joined_up_to, "vm.newest"), self._drop_gone())
                    with build.otherwise():
                        self._try_tops()
            if plan.valued:
                self._work_out("*kept[-1]")
            build(self._satisfied)

    def _load_kept(self) -> None:
        kept = self._state.kept
        self._build(Assign("kept", kept), If("kept is None", (AssignAll((kept, "kept"), "[]"),)))

    def _drop_gone(self) -> While:
        """Return the loop that leaves at the end of what is kept a match that holds, or takes its else."""
        holds = " and ".join(held(f"e[{place}]") for place in range(len(self._places)))
        return While("kept", (Assign("e", "kept[-1]"), If(holds, (Break(),)), Evaluate("kept.pop()")))

    def _try_tops(self) -> None:
        """Write the search in the open top and then in the others, until there is a match."""
        build = self._build
        plan = self._plan
        state = self._state
        none: Block = (Break(),) if plan.is_eager else self._unsatisfied
        if not plan.once:
            build(*self.begin())
        if plan.once or len(self._places) == 1:
            self._tops(none)
            return
        with_top = f"{self._functions.below}(vm, now, f)"
        build(Assign("f", state.current_top))
        with build.when("f is not None"):
            build(Assign("e", f"{with_top} if {held('f')} else None"))
            used_up = Assign(state.current_top, "None")
            build(If("e is not None", (Evaluate("kept.append(e)"),), (used_up,)))
        with build.when("not kept"):
            self._tops(none)

    def _tops(self, none: Block) -> None:
        """Write the search below one top after another; `none` is done when there is no top left."""
        build = self._build
        plan = self._plan
        state = self._state
        build(Assign("q", state.queue))
        if not plan.once and not plan.valued:
            self._tops_in_line()
            return
        below = self._functions.below
        with build.repeat("True"):
            build(Assign("f", "q and next_of(q)"), If("not f", (Assign(state.queue, "None"), *none)))
            build(Assign(state.last_top, serial("f")))
            if plan.once:
                build(Evaluate(f"{below}(vm, now, f, kept)"))
                if not plan.is_eager:
                    build(If("kept", (Evaluate("kept.reverse()"), Break())))
            else:
                build(Assign("e", f"{below}(vm, now, f)"))
                is_open = [Assign(state.current_top, "f")] if len(self._places) > 1 else []
                build(If("e is not None", (Evaluate("kept.append(e)"), *is_open, Break())))

    def _tops_in_line(self) -> None:
        """Write the search below one top after another for the first match of a rule that consumes."""
        build = self._build
        plan = self._plan
        state = self._state
        fact = plan.names()[0]
        build(Assign(ME, "vm.robot"))
        with build.repeat("True"):
            # `next_of` in line for its usual case: the next fact still holds, and the queue need not be shortened.
            usual = f"q is not None and (h := q[0] + 1) + h <= len(q) and {held(f'({fact} := q[h])')}"
            none = If(f"q is None or ({fact} := next_of(q)) is None", (Assign(state.queue, "None"), *self._unsatisfied))
            build(If(usual, (Assign("q[0]", "h"),), (none,)), Assign(state.last_top, serial(fact)))
            mark = build.mark()
            is_open = [Assign(state.current_top, fact)] if len(self._places) > 1 else []
            one: Block = (*is_open, self._satisfied, Return())
            if not is_open or self._places[0] in plan.consumed:
                uses = self.below(Continue(), lambda: build(self._keep, *one))
            else:
                # A top that stays is searched once, unless it has many matches: of these only the first is kept.
                many = If(f"len(kept) > {AT_ONCE_MAX}", (Delete("kept[1:]"), *one))
                uses = self.below(Continue(), lambda: build(self._keep, many))
                build(If("kept", (Evaluate("kept.reverse()"), self._satisfied, Return())))
            build.insert(mark, uses)  # inside the loop: the first top that is tried may have made these indices

    def _join_new(self, place: int) -> None:
        """Write the join of the new facts of one atom that is not the first with the tops tried so far."""
        build = self._build
        plan = self._plan
        state = self._state
        new = state.new(place)
        with build.when(f"{new} is not None"):
            build(Assign("new", new), Assign(new, "None"))
            if plan.once:
                build(Assign("before", f"{state.last_top} + 1"))
            else:
                # The open top is joined with new facts later, when its search goes on.
                build(Assign("f", state.current_top))
                build(Assign("before", f"{state.last_top} + (f is None or not {held('f')})"))
                if place != self._places[1]:
                    # A new fact of an inner atom may make an older match of the open top than the one kept.
                    build(If("f is not None and kept and kept[0][0] is f", (Delete("kept[0]"),)))
                # Joining costs time for each new fact. Beyond its budget all tops are tried again instead.
                few = f"len(new) <= {NEW_MAX} and len(kept) <= {KEPT_MAX}"
                build(Assign("vm.looks", f"{FRESH_LOOKS_MAX} if {few} else -1"), Assign("vm.looking", "None"))
                build(If("vm.looks < 0", (Assign("new", "()"),)))
            joined = Evaluate(f"{self._functions.fresh(place)}(vm, now, f, before, {state.joined_up_to}, kept)")
            build(Loop("f", "new", (If(held("f"), (joined,)),)))
            if not plan.once:
                restart = Evaluate(f"{self._functions.restart}(vm)")
                build(If("vm.looks < 0", (restart, Assign("kept", state.kept))))
            build(_SORT_KEPT)
            # Every match of such a rule fires, so none is searched again: those beyond the bound are lost, and counted.
            if plan.once:
                build(If(f"len(kept) > {once.MATCHES_MAX}", (Evaluate("vm.spill(kept, now)"),)))

    def write_restart(self, top_gate: Sequence[Test]) -> None:
        """Write the function that lets all tops be tried again; `top_gate` are the conditions on a top ``f``."""
        build = self._build
        plan = self._plan
        state = self._state
        if plan.way is not Way.JOIN or plan.once or len(self._places) < 2:
            return
        table = self._tables[plan.atoms[0][1].predicate]
        tests = f" if {every(top_gate)}" if top_gate else ""
        with build.function(self._functions.restart, "vm"):
            build(Assign(ME, "vm.robot"), Assign(state.kept, "[]"))
            build(Assign(state.current_top, "None"), Assign(state.last_top, "0"))
            build(*[Assign(state.new(place), "None") for place in self._places[1:]])
            build(Assign(state.queue, f"[0, *[f for f in {table.name}.values(){tests}]]"))

    def _body(self, leave: Statement, **options: Any) -> Body:
        return Body(self._build, self._pool, self._tables, BoundSlots(), leave, **options)

    @property
    def _keep(self) -> Evaluate:
        return Evaluate(f"kept.append({self._plan.entry()})")

    @property
    def _break_off(self) -> Return:
        return Return(f"vm.break_off({self._plan.index}, now)")

    def begin(self) -> list[Statement]:
        """Return the statements that begin to count the facts that a search looks at."""
        rule = self._plan.rule
        return begun(self._pool, (self._plan.index, len(rule.head), len(rule.body)))

    def _if_broken(self) -> None:
        plan = self._plan
        if plan.may_break:
            rematch = Return(f"vm.rematch({plan.index}, now)")
            self._build(If(f"vm.broken & {plan.bit}", (rematch,)))


_SORT_KEPT = If("len(kept) > 1", (Evaluate("kept.sort(reverse=True)"),))
"""Puts the oldest match last, from where it is popped."""
