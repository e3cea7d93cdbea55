"""The run loop: match the stale rules again, choose a satisfied one, fire it, until no rule is satisfied.

The rules of a small program fire in this function, found by binary search; those of a larger one have a function each.
A head of facts, goals and actions that cannot fail is generated where the rule fires; what other heads derive is
computed when the match is found (`rmr.vm.generate.head_functions`).
"""

from collections.abc import Sequence
from itertools import islice
from operator import length_hint

from rmr.base.streams import Choices
from rmr.bytecode.heads import inner
from rmr.bytecode.program import DeriveAction, DeriveFact, DeriveGoal, Program, Strategy
from rmr.vm import machine, match
from rmr.vm.derive import Derived
from rmr.vm.generate.body import ME
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.facts import FactWriter, mark_stale
from rmr.vm.generate.form import (
    Assign,
    AssignAll,
    Block,
    Break,
    Continue,
    Evaluate,
    If,
    Loop,
    Return,
    Statement,
    Update,
    While,
    held,
    serial,
    tuple_of,
)
from rmr.vm.generate.head_items import WrittenItem, rows_of, write_bindings, written_items
from rmr.vm.generate.match_search import SearchWriter
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.generate.source import Pool
from rmr.vm.machine_events import FactSent, RuleFired

IN_LINE_MAX = 12
"""Greatest number of readers of a predicate whose insertions are inlined where its facts are derived."""

IN_LOOP_MAX = 8
"""Greatest number of rules that fire in the loop itself, each with its event, constant during a run, in a variable."""

_OLDEST_RULE = Update("ready", "&", "-ready")
"""Leaves the lowest bit: the first of the rules in the order of the text."""


class LoopWriter:
    """Writes ``fire``."""

    def __init__(
        self,
        program: Program,
        build: FormBuilder,
        pool: Pool,
        tables: Sequence[FactTable],
        plans: Sequence[RulePlan],
        facts: FactWriter,
    ) -> None:
        self._program = program
        self._build = build
        self._pool = pool
        self._tables = tables
        self._plans = plans
        self._facts = facts
        self._fires_all = any(plan.fires_all for plan in plans)
        self._firing = ["vm", "now", "emit", *(["turns"] if self._fires_all else [])]
        """The parameters of the function in which one of many rules fires."""
        for name, thing in (("RuleFired", RuleFired), ("Derived", Derived), ("FactSent", FactSent)):
            pool.helper(name, thing)

    def write(self) -> None:
        """Write the function."""
        build = self._build
        timed = sum(plan.bit for plan in self._plans if plan.timed and plan.valued)
        with build.function("fire", "vm", "now"):
            build(Assign(ME, "vm.robot"), Assign("emit", "vm._events.append"))
            build(If("vm._any_goals is not None", (Evaluate("vm._any_goals.begin(now)"),)))
            if self.is_in_loop:
                build(*[Assign(f"e{plan.index}", "None") for plan in self._plans])
            else:
                build(Assign("events", "{}"))
            if timed:
                build(mark_stale(f"vm.ready & {timed}"))
            turns = "range(vm._budget)"
            if self._fires_all:
                build(Assign("turns", f"iter({turns})"))
                turns = "turns"
            with build.loop("_", turns):
                if self._program.strategy is Strategy.DEADLINE and self._program.assertions:
                    build(If("vm.unsettled", (Evaluate("vm.settle_jobs()"),)))
                build(If("vm.observed", (If("vm.fire_observed(now)", (Continue(),)), Return())))
                build(self._match_stale())
                build(Assign("ready", "vm.ready"))
                # More than one rule is satisfied: the strategy leaves one bit.
                textual = self._program.strategy is Strategy.TEXTUAL
                one: Block = (_OLDEST_RULE,) if textual else self._draw()
                quiet = If("not ready", (Assign("vm.busy", "False"), Return()))
                build(If("ready & (ready - 1)", one, (quiet,)))
                build(Update("vm.firings", "+", "1"))
                if not self.is_in_loop:
                    made = AssignAll(("events[ready]", "e"), "RuleFired(ready.bit_length() - 1, now)")
                    build(Assign("e", "events.get(ready)"), If("e is None", (made,)))
                    build(Evaluate("emit(e)"), Evaluate(f"FIRE[ready]({', '.join(self._firing)})"))
                elif self._plans:
                    self._choose(0, len(self._plans))

    def _match_stale(self) -> If:
        """Return the statement that finds the next match of each rule for which something has changed."""
        low = Assign("low", "stale & -stale")
        find = While("stale", (low, Update("stale", "^", "low"), Evaluate("FIND[low](vm, now)")))
        return If("vm.stale", (Assign("stale", "vm.stale"), Assign("vm.stale", "0"), find))

    @property
    def is_in_loop(self) -> bool:
        """Whether all rules fire in the loop itself."""
        return len(self._plans) <= IN_LOOP_MAX

    def write_rule(self, plan: RulePlan) -> None:
        """Write the function in which one of many rules fires."""
        with self._build.function(plan.functions.fire, *self._firing):
            self._build(Assign(ME, "vm.robot"))
            self._fire(plan)

    def may_fire_all(self, plan: RulePlan) -> bool:
        """Return whether a rule may fire for its matches as they are found: none goes, and firings lead to tops alone.

        So it derives facts of this robot whose only consequences are matches, and that it joins with nothing but older
        facts.
        """
        if not plan.lasting or plan.may_break:
            return False
        slots = write_bindings(FormBuilder(), Pool(), plan.rule, self._tables, plan.facts)
        chains = written_items(plan.rule, slots, self._program, Pool(), self._tables) or ()
        joined = {atom.predicate for _, atom in plan.atoms[1:]}
        return all(len(chain) == 1 and self._is_plain(chain[0]) for chain in chains) and joined.isdisjoint(
            chain[0].item.predicate for chain in chains
        )

    def _is_plain(self, item: WrittenItem) -> bool:
        """Return whether an item is a fact of this robot of which nothing but matches follows."""
        if not isinstance(item.item, DeriveFact) or not self._is_in_line(item):
            return False
        table = self._tables[item.item.predicate]
        return not (table.long or table.concerned or table.returns is not None or table.predicate.best is not None)

    def write_fire_all(self, plan: RulePlan) -> None:
        """Write the function that tries the tops of a rule and fires it for each match at once.

        It is called while this rule alone is satisfied, its last match known has fired, and all its facts are joined.
        It ends when the rule may fire no more or another one is affected. `turns` iterates over the firings left.
        """
        build = self._build
        state = plan.state
        stale = mark_stale(plan.bit)
        search = SearchWriter(plan, build, self._pool, self._tables)
        for thing in (islice, length_hint):
            self._pool.helper(thing.__name__, thing)
        with build.function(plan.functions.fire_all, "vm", "now", "turns"):
            build(Assign("left", "length_hint(turns)"))
            short = self._facts.is_full(f"vm.count + {len(plan.rule.head)} * left > {machine.FACTS_MAX}")
            build(If(f"not left or {short}", (stale, Return())))
            build(*search.begin(), Assign(ME, "vm.robot"), Assign("kept", state.kept), Assign("q", state.queue))
            build(Assign("s", "vm.newest"), Assign("taken", "q[0]"), Assign("fired", "0"))
            mark = build.mark()
            with build.loop(plan.names()[0], "islice(q, taken + 1, None)"):  # which the firings make longer
                build(Update("taken", "+", "1"))
                uses = search.below(Continue(), lambda: self._fire_or_keep(plan))
                build(If(f"fired == left or vm.looks < {match.LOOKS_MAX // 2}", (Break(),)))
            build.insert(mark, uses)
            build(Update("vm.count", "+", "s - vm.newest"), Assign("vm.newest", "s"), Assign("last", "len(q) - 1"))
            build(Assign(state.last_top, serial("q[taken]")), search.shorten_queue())
            build(If("kept", (Evaluate("kept.reverse()"),), (stale,)))
            build(Evaluate(f"vm._events.extend([RuleFired({plan.index}, now)] * fired)"))
            build(Update("vm.firings", "+", "fired"), Evaluate("next(islice(turns, fired, fired), None)"))

    def _fire_or_keep(self, plan: RulePlan) -> None:
        """Write that the rule fires for a match, or keeps it if no firing is left."""
        build = self._build
        build(If("fired == left", (Evaluate(f"kept.append({plan.entry()})"), Continue())))
        build(Update("fired", "+", "1"))
        self._facts.firing_all = plan
        self._fire_in_line(plan)
        self._facts.firing_all = None
        made = [each.predicate for each in plan.rule.head if isinstance(each, DeriveFact)]
        if any(reader is not plan for each in made for reader in self._facts.readers[each]):
            build(If(f"vm.stale or vm.ready != {plan.bit}", (Assign("left", "fired"),)))

    def _draw(self) -> Block:
        """Return the statements that draw one of the satisfied rules: `Choices.below` in line."""
        one, other = Choices.MULTIPLIERS
        mask = Choices.MASK
        return (
            Assign("choices", "vm._choices"),
            AssignAll(("choices.state", "z"), f"choices.state + {Choices.GAMMA} & {mask}"),
            Assign("z", f"(z ^ z >> 30) * {one} & {mask}"),
            Assign("z", f"(z ^ z >> 27) * {other} & {mask}"),
            # z >> 32 ^ z >> 63 is the upper half of z ^ z >> 31; times the number of rules, its upper half is a rule.
            Assign("draw", "(z >> 32 ^ z >> 63) * ready.bit_count() >> 32"),
            While("draw", (Update("ready", "&", "ready - 1"), Update("draw", "-", "1"))),
            _OLDEST_RULE,
        )

    def _choose(self, first: int, end: int) -> None:
        """Write the firing of one of the rules from `first` up to before `end`."""
        if end - first == 1:
            event = f"e{first}"
            self._build(
                If(f"{event} is None", (Assign(event, f"RuleFired({first}, now)"),)), Evaluate(f"emit({event})")
            )
            self._fire(self._plans[first])
            return
        middle = (first + end) // 2
        with self._build.when(f"ready < {1 << middle}"):
            self._choose(first, middle)
        with self._build.otherwise():
            self._choose(middle, end)

    def _fire(self, plan: RulePlan) -> None:
        """Write the firing of one rule."""
        # Atomic: the match leaves its rule, what it consumes goes, then what it derives comes (`Machine`).
        self._take(plan)
        if plan.valued:
            self._fire_valued(plan)
        else:
            self._fire_in_line(plan)
        if plan.fires_all:
            alone = f"vm.stale == vm.ready == {plan.bit} and {plan.state.queue}"
            joined = [f"{plan.state.new(place)} is None" for place, _ in plan.atoms[1:]]
            go_on = Evaluate(f"{plan.functions.fire_all}(vm, now, turns)")
            self._build(If(" and ".join(["not kept", alone, *joined]), (Assign("vm.stale", "0"), go_on)))

    def _fire_valued(self, plan: RulePlan) -> None:
        """Write the consumption and derivation of the results that `value` has computed for the match."""
        build = self._build
        build(Assign("consumed, out", plan.state.valued))
        self._consume(plan, 0)
        if plan.drawn:
            build(Evaluate(f"vm.drew({plan.index})"))
        if any(inner(plan.rule.head)):
            build(Loop("call, f", "consumed", (Evaluate("call(vm, now, f)"),)))
        rows = rows_of(plan.rule)
        if rows is None:
            build(Loop("call", "out", (Evaluate("call[0](vm, now, *call[1:])"),)))
            return
        names = [f"a{place}" for place in range(self._tables[rows].arity)]
        with build.loop(tuple_of(names), "out"):
            if len(self._facts.readers[rows]) <= IN_LINE_MAX:
                self._facts.add_if_new(rows, names)
            else:
                build(self._added(rows, names))

    def _fire_in_line(self, plan: RulePlan) -> None:
        """Write out what a head that cannot fail derives."""
        slots = write_bindings(self._build, self._pool, plan.rule, self._tables, plan.facts)
        chains = written_items(plan.rule, slots, self._program, self._pool, self._tables)
        assert chains is not None
        items = [item for chain in chains for item in chain]
        made = [item for item in items if isinstance(item.item, DeriveFact)]
        plain = all(len(chain) == 1 for chain in chains) and not any(isinstance(i.item, DeriveGoal) for i in items)
        in_line = plain and all(map(self._is_in_line, made))
        # As many facts come as go, and none can be refused: one change of the count serves all of them.
        roomy = in_line and len(made) <= len(plan.consumed) and all(map(self._is_temporary, made))
        self._consume(plan, len(made) if roomy else 0)
        for chain in chains:
            self._derive(chain, in_line, roomy)

    def _take(self, plan: RulePlan) -> None:
        """Write the removal of the match from those that the rule keeps."""
        build = self._build
        r = plan.index
        names = plan.names()
        stale = mark_stale(plan.bit)
        if plan.way is Way.SINGLE:
            self._take_single(plan)
            return
        noted = plan.once and (plan.way is Way.REMATCH or plan.may_break)
        targets = [tuple_of(names)] if names else []
        if noted or not names:
            targets.append("e")
        build(Assign("kept", plan.state.kept), AssignAll(tuple(targets), "kept.pop()"))
        if plan.once and plan.way is Way.REMATCH:
            build(Evaluate(f"vm.fired[{r}].fire(e)"))
        elif plan.once and plan.may_break:
            build(If(f"vm.broken & {plan.bit}", (Evaluate(f"vm.fired[{r}].fire(e)"),)))
        # A rule is stale after a firing unless the matches that it keeps are known to be complete and to hold.
        if plan.lasting and not plan.may_break:
            build(If("not kept", (stale,)))
        elif plan.way is Way.JOIN and plan.atoms[0][0] in plan.consumed and not plan.may_break:
            self._next_top(plan)
        else:
            build(stale)

    def _take_single(self, plan: RulePlan) -> None:
        """Write the step of a rule of one atom to the next fact of its queue."""
        build = self._build
        r = plan.index
        state = plan.state
        fact = plan.names()[0]
        stale = mark_stale(plan.bit)
        unsatisfied = Update("vm.ready", "^", str(plan.bit))
        build(Assign(fact, state.match))
        if plan.may_break:
            noted: Block = (stale, Evaluate(f"vm.fired[{r}].fire(({fact},))")) if plan.once else (stale,)
            build(If(f"vm.broken & {plan.bit}", noted))
        # If the next match must be searched first, the rule is marked stale; otherwise it stays satisfied.
        gone: Block = (Assign(state.queue, "None"), unsatisfied)
        empty = If("f is None", gone, (stale,) if plan.valued else ())
        rest: Block = (AssignAll((state.match, "f"), "next_of(q)"), empty)
        if not plan.valued:
            # `next_of` in line for its usual case: the next fact still holds, and the queue need not be shortened.
            usual = f"(h := q[0] + 1) + h <= len(q) and {held('(f := q[h])')}"
            rest = (If(usual, (Assign("q[0]", "h"), Assign(state.match, "f")), rest),)
        build(Assign("q", state.queue), If("q is None", (Assign(state.match, "None"), unsatisfied), rest))

    def _consume(self, plan: RulePlan, made: int) -> None:
        """Write the removal of the consumed facts; `made` facts, inserted later in this firing, are counted here."""
        change = made - len(plan.consumed)
        if change:
            self._build(Update("vm.count", "+" if change > 0 else "-", str(abs(change))))
        atoms = dict(plan.atoms)
        for place in plan.consumed:
            self._facts.remove(atoms[place].predicate, plan.facts[place], plan.bit)

    def _next_top(self, plan: RulePlan) -> None:
        """Write the stale mark of a rule that consumes its top, if there are facts left to search."""
        state = plan.state
        left = ["kept", "(q and q[0] + 1 < len(q))", *[state.new(place) for place, _ in plan.atoms[1:]]]
        gone = (state.current_top, state.queue) if len(plan.atoms) > 1 else (state.queue,)
        nothing: Block = (AssignAll(gone, "None"), Update("vm.ready", "^", str(plan.bit)))
        self._build(Assign("q", state.queue), If(" or ".join(left), (mark_stale(plan.bit),), nothing))

    def _is_in_line(self, item: WrittenItem) -> bool:
        """Return whether the insertion of a fact is written out."""
        return item.mine and len(self._facts.readers[item.item.predicate]) <= IN_LINE_MAX

    def _is_temporary(self, item: WrittenItem) -> bool:
        """Return whether a fact always has room after another one was removed: it has no length, and is always new."""
        table = self._tables[item.item.predicate]
        return table.linear and not table.long

    def _derive(self, chain: list[WrittenItem], in_line: bool, roomy: bool) -> None:
        build = self._build
        pool = self._pool
        item = chain[0]
        if len(chain) == 1 and isinstance(item.item, DeriveAction):
            action = f"now, {item.item.predicate}, {item.owner.text}, {tuple_of([each.text for each in item.args])}"
            mine = f"emit((vm._any_actions or vm._under_way).begin({action}))"
            build(Evaluate(mine if item.mine else f"vm._act({action})"))
            return
        if len(chain) > 1 or not isinstance(item.item, DeriveFact):
            sources = [each.write(build, pool) for each in chain]
            build(Evaluate(f"vm._follow(now, {tuple_of(sources)})"))
            return
        args = [each.text for each in item.args]
        predicate = item.item.predicate
        if item.mine and in_line:
            names = [f"a{place}" for place in range(len(args))]
            build(*[Assign(name, text) for name, text in zip(names, args, strict=True)])
            if roomy:
                self._facts.add(predicate, names, "")
            else:
                self._facts.add_if_new(predicate, names)
        elif item.mine:
            build(self._added(predicate, args))
        else:
            sent = Evaluate(f"emit(FactSent(owner, {predicate}, {tuple_of(args)}))")
            build(If(f"(owner := {item.owner.text}) == {ME}", (self._added(predicate, args),), (sent,)))

    def _added(self, predicate: int, args: Sequence[str]) -> Statement:
        """Return the call that inserts a fact of this robot."""
        return Evaluate(f"{self._tables[predicate].functions.add}({', '.join(['vm', 'now', *args])})")
