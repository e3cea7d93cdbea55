"""The state of one machine that runs generated code (`rmr.vm.generate`), and the slow paths of that code.

The main slow path is the rematch: a rule with ``not``, or one whose expression has had no value, is matched from
scratch after each change, in the order of the specification. `Unfired` remembers which of its matches have fired
(refraction).
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.bytecode.octets import identity
from rmr.bytecode.program import Program
from rmr.vm import match, once
from rmr.vm.derive import Chain, Draws
from rmr.vm.evaluate import NoValue
from rmr.vm.generate.form import ARGS, HELD, SERIAL
from rmr.vm.generate.module import Module
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.machine import FIRING_BUDGET, Machine
from rmr.vm.machine_events import FactInserted, FactRemoved
from rmr.vm.store import Args

HeldFact = list[Any]
"""A fact: whether it holds, its serial, its arguments (`rmr.vm.generate.form`)."""

Entry = tuple[HeldFact, ...]
"""The facts of a match."""

Key = tuple[int, ...]
"""The serials of a match's facts: its identity over the whole run."""

Valued = tuple[list[tuple[int, HeldFact]], list[Chain]]
"""The effect of a match: the consumed facts, each with its predicate, and the derived chains."""


class SeenFact:
    """Adapter of a fact to the interface that `Failures` needs (`serial`, `held`)."""

    __slots__ = ("_fact", "serial")

    def __init__(self, fact: HeldFact) -> None:
        self._fact = fact
        self.serial: int = fact[SERIAL]

    @property
    def held(self) -> bool:
        """Whether it holds."""
        return bool(self._fact[HELD])


def key_of(entry: Entry) -> Key:
    """Return the key of a match."""
    return tuple([fact[SERIAL] for fact in entry])


class Unfired:
    """The fired and the unfired matches of a rule that consumes nothing and is rematched after each change."""

    __slots__ = ("_complete", "_fired", "_left")

    def __init__(self, fired: set[Key]) -> None:
        """`fired` are the keys of matches, the serials of their facts."""
        self._fired = fired
        self._left: list[Entry] = []
        self._complete = True
        """Whether `_left` holds all matches that have not fired."""

    @property
    def is_used_up(self) -> bool:
        """Whether all kept matches have fired although there are more than were kept."""
        self._forget_gone()
        return not self._left and not self._complete

    def look(self, matches: Iterator[Entry]) -> None:
        """Replace the memory by all `matches` that hold now: forget the fired ones that no longer hold."""
        found: set[Key] = set()
        left: list[Entry] = []
        self._complete = True
        for entry in matches:
            if (key := key_of(entry)) in self._fired:
                found.add(key)
            elif len(left) < once.MATCHES_MAX:
                left.append(entry)
            else:
                self._complete = False
        self._fired = found
        self._left = left[::-1]

    def each(self) -> Iterator[Entry]:
        """Yield the matches that have not fired, the oldest first."""
        self._forget_gone()
        return (entry for entry in reversed(self._left) if self._stands(entry))

    def fire(self, entry: Entry) -> None:
        """Record that a match has fired."""
        self._fired.add(key_of(entry))

    def _forget_gone(self) -> None:
        while self._left and not self._stands(self._left[-1]):
            self._left.pop()

    def _stands(self, entry: Entry) -> bool:
        return key_of(entry) not in self._fired and all(fact[HELD] for fact in entry)


SEVERAL = 16
"""Number of facts of one predicate from which a batch insertion (`Module.several`) is worth its compilation."""


class Running(Machine):
    """A machine that runs code made from its program."""

    __slots__ = (
        "broken",
        "busy",
        "changed",
        "count",
        "drawn",
        "fired",
        "length",
        "looking",
        "looks",
        "newest",
        "observed",
        "pressing",
        "ready",
        "stale",
        "touched",
        "unsettled",
        "wanting",
    )

    module: Module
    looking: tuple[tuple[int, int, int], Sequence[HeldFact]] | None
    """Place of the running search for its failure report: rule, part and step, and the facts found before.

    None: an exhausted budget is not reported, for the search is restarted in another way."""

    def __init__(
        self,
        program: Program,
        robot: int,
        choices: Choices,
        *,
        firing_budget: int = FIRING_BUDGET,
        trace: bool = False,
    ) -> None:
        super().__init__(program, robot, choices, firing_budget=firing_budget, trace=trace)
        self.newest = 0
        """The serial of the fact that was inserted last."""
        self.count = 0
        """Number of facts."""
        self.length = 0
        """Total length of their strings and lists, in characters and items."""
        self.ready = 0
        """Bit set of the satisfied rules; the bits of `stale` rules are not valid."""
        self.stale = self.module.at_first
        """Bit set of the rules that must be matched again before the next firing."""
        self.changed = self.module.at_first
        """Bit set of the rematched rules with a changed fact since their last search."""
        self.looks = 0
        """Remaining search budget: facts that the search may still examine."""
        self.looking = None
        self.broken = 0
        """Bit set of the rules that are rematched from now on because one of their expressions had no value."""
        self.touched = 0
        """While goals are open: bit set of the rules with a changed fact since they were last ranked."""
        self.wanting = False
        """Whether goals are open."""
        self.pressing = False
        """Whether there are jobs that influence the order of firings."""
        self.unsettled = False
        """Whether that has changed since the last firing."""
        self.observed = trace
        """Whether each insertion and removal is reported: facts are traced, goals are open or jobs are pressing."""
        self.fired: dict[int, Unfired] = {}
        """Refraction memory of the rematched rules that consume nothing."""
        self.drawn: dict[int, int] = {}
        """Of each rule that draws: how often it has fired."""
        self.busy = bool(self.module.plans)
        self.module.reset(self)

    # Called by the machine

    def each(self, predicate: int) -> Iterator[Args]:
        """Yield the arguments of the facts of `predicate` that hold, oldest first."""
        table = self.module.tables[predicate]
        held = self.queued(predicate) if table.queued else self._table(predicate).values()
        return (tuple(fact[ARGS : ARGS + table.arity]) for fact in held)

    def dated(self, predicate: int) -> list[tuple[Args, Instant]]:
        """Return the same with the instants of their insertion."""
        arity = self.module.tables[predicate].arity
        return [(tuple(fact[ARGS : ARGS + arity]), fact[-1]) for fact in self._table(predicate).values()]

    def _table(self, predicate: int) -> dict[Any, HeldFact]:
        table: dict[Any, HeldFact] = getattr(self, self.module.tables[predicate].slot)
        return table

    def _insert_all(self, now: Instant, facts: Iterable[tuple[int, Args]]) -> None:
        for predicate, rows in self.module.rows(facts):
            if len(rows) < SEVERAL:
                for args in rows:
                    self.module.add[predicate](self, now, *args)
            else:
                self.module.several(predicate)(self, now, rows)

    def _insert(self, now: Instant, predicate: int, args: Args) -> None:
        self.module.add[predicate](self, now, *args)

    def _withdraw(self, now: Instant, predicate: int, args: Args) -> None:
        table = self.module.tables[predicate]
        key: Any = args[0] if table.arity == 1 else args
        fact = self._table(predicate).get(identity(key) if table.open else key)
        if fact is not None:
            self.module.remove[predicate](self, now, fact)

    def take_out(self, now: Instant, predicate: int) -> list[Args]:
        """Remove the facts of a temporary predicate and return their arguments, the oldest first."""
        table = self.module.tables[predicate]
        facts = self.queued(predicate) if table.queued else list(self._table(predicate).values())
        for fact in facts:
            self.module.remove[predicate](self, now, fact)
        return [tuple(fact[ARGS : ARGS + table.arity]) for fact in facts]

    # Called by generated code

    def is_full(self, now: Instant) -> bool:
        """Return whether the store is full; then count one fact as dropped."""
        return self._is_full(now, self.count, self.length)

    def concern(self, now: Instant, predicate: int, args: Args) -> None:
        """Pass a new fact to the time assertions, unless `on_insert` does."""
        if not self.observed:
            self._inserted(now, predicate, args)

    def on_insert(self, now: Instant, predicate: int, args: Args, rules: int) -> None:
        """Report a new fact to the trace and the goals; it concerns the `rules` (a bit each)."""
        if self._trace:
            self._events.append(FactInserted(predicate, args, now))
        self.touched |= rules
        self._inserted(now, predicate, args)

    def on_remove(self, now: Instant, predicate: int, args: Args, rules: int) -> None:
        """Report a removed fact to the trace and the goals; it concerned the `rules` (a bit each)."""
        if self._trace:
            self._events.append(FactRemoved(predicate, args, now))
        self.touched |= rules
        if self.wanting:
            self._goals.fact_changed(predicate, args, holds=False)

    def queued(self, predicate: int) -> list[HeldFact]:
        """Return the facts of a predicate that are in no table, oldest first."""
        facts = list(getattr(self, self.module.tables[predicate].slot))
        for plan in self.module.readers[predicate]:
            facts += [getattr(self, plan.slots.match), *self._waiting(plan)]
        return sorted([fact for fact in facts if fact is not None and fact[HELD]])

    def draws(self, rule: int) -> Draws:
        """Return the numbers that the next firing of a rule draws."""
        return Draws(self._seed, rule, self.drawn.get(rule, 0))

    def drew(self, rule: int) -> None:
        """Note that a rule that draws has fired."""
        self.drawn[rule] = self.drawn.get(rule, 0) + 1

    def give_up(self) -> None:
        """Report, once, that a search has used its budget, unless it is restarted in another way (`looking`)."""
        if self.looking is None:
            return
        (rule, part, step), facts = self.looking
        reason = NoValue(f"the search for matches was given up after {match.LOOKS_MAX} facts")
        self.failed(self._now, rule, part, step, facts, reason)

    def spill(self, kept: list[Entry], now: Instant) -> None:
        """Drop the newest of the unfired matches beyond `MATCHES_MAX`; `kept` has the oldest last."""
        for _ in range(len(kept) - once.MATCHES_MAX):
            self._dropped.add("matches", once.MATCHES_MAX, now)
        del kept[: -once.MATCHES_MAX]

    def failed(self, now: Instant, rule: int, part: int, step: int, facts: Sequence[HeldFact], reason: NoValue) -> None:
        """Report, once, that an expression has no value."""
        seen: Any = [SeenFact(fact) for fact in facts]
        self._failures.match(now, rule, part, step, seen, str(reason))

    def apply(self, now: Instant, valued: Valued) -> None:
        """Apply a firing: remove the consumed facts, then derive the chains."""
        consumed, derived = valued
        remove = self.module.remove
        for predicate, fact in consumed:
            remove[predicate](self, now, fact)
        for chain in derived:
            self._follow(now, chain)

    def rematch(self, rule: int, now: Instant) -> None:
        """Find the match with which a rule fires next, by the search of the specification."""
        plan = self.module.plans[rule]
        for entry in self._matches(plan, now):
            valued = self._worked_out(plan.functions.value, entry, now) if plan.valued else None
            if valued is not None or not plan.valued:
                self._offer(plan, entry, valued)
                return
        self._offer(plan, None, None)

    def break_off(self, rule: int, now: Instant) -> None:
        """Rematch a rule from now on: an expression had no value, and the failures reported are part of the result."""
        plan = self.module.plans[rule]
        self.module.slow(rule)
        if plan.once:
            # The incremental search forgets fired matches, a rematch must know them: they are the matches that it had
            # reached, by its serial numbers, and no longer keeps as unfired.
            unfired = set(map(key_of, self._kept(plan)))
            known = getattr(self, plan.slots.joined_up_to) if plan.way is Way.JOIN else self.newest
            last = getattr(self, plan.slots.last_top) if plan.way is Way.JOIN else self.newest
            found = map(key_of, self._each(plan, now))
            fired = {key for key in found if key[0] <= last and max(key) <= known and key not in unfired}
            self.fired[rule] = Unfired(fired)
        self.broken |= plan.bit
        self.changed |= plan.bit
        self.rematch(rule, now)

    # Matching anew

    def _each(self, plan: RulePlan, now: Instant) -> Iterator[Entry]:
        """Yield all matches of a rule, fired or not, and report failures."""
        each: Iterator[Entry] = self.module.names[plan.functions.each](self, now)
        return each

    def _derive(self, plan: RulePlan, entry: Entry, now: Instant) -> Valued | None:
        self.module.slow(plan.index)
        return self._worked_out(plan.functions.derive, entry, now)

    def _worked_out(self, function: str, entry: Entry, now: Instant) -> Valued | None:
        """Return the effect of a match; the budget of the search that found it is saved and restored."""
        before = self.looks, self.looking
        valued: Valued | None = self.module.names[function](self, now, *entry)
        self.looks, self.looking = before
        return valued

    def _matches(self, plan: RulePlan, now: Instant) -> Iterator[Entry]:
        """Yield the matches with which a rematched rule may fire."""
        if not plan.once:
            return self._each(plan, now)
        unfired = self.fired.setdefault(plan.index, Unfired(set()))
        if self.changed & plan.bit or unfired.is_used_up:
            self.changed &= ~plan.bit
            unfired.look(self._each(plan, now))
        return unfired.each()

    def _offer(self, plan: RulePlan, entry: Entry | None, valued: Valued | None) -> None:
        """Set the match with which a rematched rule fires next, or none."""
        slots = plan.slots
        if plan.way is Way.SINGLE:
            setattr(self, slots.match, None if entry is None else entry[0])
            setattr(self, slots.queue, None)
        else:
            setattr(self, slots.kept, [] if entry is None else [entry])
        if plan.way is Way.JOIN:
            for name in (slots.queue, *plan.join_slots):
                setattr(self, name, None)
            # Not 0: new facts of the other atoms are ignored before the first top is tried, and must not be here.
            setattr(self, slots.last_top, 1)
        if plan.valued:
            setattr(self, slots.valued, valued)
        self.ready = self.ready & ~plan.bit if entry is None else self.ready | plan.bit

    def _kept(self, plan: RulePlan, *, everything: bool = False, now: Instant = 0) -> list[Entry]:
        """Return the matches that a rule keeps, the oldest first; with `everything`, search the untried tops before."""
        slots = plan.slots
        if plan.way is Way.SINGLE:
            facts = [getattr(self, slots.match), *self._waiting(plan)]
            return [(fact,) for fact in facts if fact is not None and fact[HELD]]
        kept: list[Entry] = getattr(self, slots.kept)
        if everything:
            tops = self._waiting(plan)
            self.looks = match.LOOKS_MAX
            self.looking = (plan.index, len(plan.rule.head), len(plan.rule.body)), ()
            setattr(self, slots.queue, None)
            for top in tops:
                setattr(self, slots.last_top, top[SERIAL])
                if top[HELD]:
                    self.module.names[plan.functions.below](self, now, top, kept)
            # What is gone must not stay: it would be sorted before the matches that hold, and fire.
            kept[:] = sorted([entry for entry in kept if all(fact[HELD] for fact in entry)], reverse=True)
        return sorted([entry for entry in kept if all(fact[HELD] for fact in entry)])

    def _waiting(self, plan: RulePlan) -> list[HeldFact]:
        """Return the facts in the queue of a rule."""
        queue = getattr(self, plan.slots.queue)
        return [] if queue is None else queue[queue[0] + 1 :]
