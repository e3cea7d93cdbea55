"""The engine that robots run: Python made from the program (`rmr.vm.generate`), a state for each machine.

It fires the same rules for the same facts with the same draws as the interpreter, which is the specification. What
is here is what the generated code seldom needs: rules that are matched anew after each change, and goals whose ranks
hang on what a match derives.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rmr.base.identity import ByIdentity
from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.bytecode.program import Program, Strategy
from rmr.bytecode.wire import identity
from rmr.vm import match, once
from rmr.vm.derive import Chain
from rmr.vm.evaluate import NoValue
from rmr.vm.events import FactInserted, FactRemoved, RuleFired
from rmr.vm.generate.layout import ARGS, HELD, SERIAL
from rmr.vm.generate.module import Module
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.interpreter import UNRANKED
from rmr.vm.machine import FIRING_BUDGET, Machine
from rmr.vm.store import Args

GoneFact = list[Any]
Entry = tuple[GoneFact, ...]
"""The facts of a match."""

Key = tuple[int, ...]
"""Their serials, which name the match for ever."""

Valued = tuple[list[GoneFact], list[Chain]]
"""What a match consumes and derives."""

Ranked = tuple[int, Entry, Valued]
"""A match with its rank."""


SEVERAL = 16
"""Facts of one predicate from which on they are inserted all at once."""


class SeenFact:
    """A fact as failures remember it."""

    __slots__ = ("_fact", "serial")

    def __init__(self, fact: GoneFact) -> None:
        self._fact = fact
        self.serial: int = fact[SERIAL]

    @property
    def held(self) -> bool:
        """Whether it holds."""
        return bool(self._fact[HELD])


class Generated(Machine):
    """A machine that runs code made from its program; `module` makes its subclass."""

    __slots__ = (
        "broken",
        "busy",
        "changed",
        "count",
        "fired",
        "heed",
        "length",
        "looking",
        "looks",
        "ranks",
        "ready",
        "s",
        "searched",
        "stale",
        "touched",
        "wanting",
    )

    module: Module
    looking: tuple[tuple[int, int, int], Sequence[GoneFact]]
    """What the search is at: the rule, its part and the step there, and the facts found before."""

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
        self.s = 0
        """The serial of the fact that was inserted last."""
        self.count = 0
        """How many facts there are."""
        self.length = 0
        """How many characters and items their strings and lists hold."""
        self.ready = 0
        """The rules that are satisfied, a bit each; those that are `stale` may be or not."""
        self.stale = self.module.at_first
        self.changed = self.module.at_first
        """Of the rules that are matched anew: those that something has changed for."""
        self.broken = 0
        """The rules that are matched anew from now on because an expression of theirs had no value."""
        self.touched = 0
        """While goals are open: the rules that something has changed for."""
        self.wanting = False
        """Whether goals are open."""
        self.heed = trace
        """Whether somebody wants to know of each fact."""
        self.fired: dict[int, Unfired] = {}
        """Of the rules that are matched anew and consume nothing: which matches have fired."""
        self.ranks: list[tuple[int, bool]] | None = None
        """While goals are open: the lowest rank that each rule can have, and whether all its firings have it."""
        self.searched: dict[int, Ranked | None] = {}
        """While goals are open: the match that comes nearest, of the rules whose matches differ in that."""
        self.busy = bool(self.module.plans)
        self.module.reset(self)

    # What the machine asks

    def each(self, predicate: int) -> Iterator[Args]:
        """Yield the arguments of the facts of `predicate` that hold, oldest first."""
        table = self.module.tables[predicate]
        held = self.queued(predicate) if table.queued else self._table(predicate).values()
        return (tuple(fact[ARGS : ARGS + table.arity]) for fact in held)

    def dated(self, predicate: int) -> list[tuple[Args, Instant]]:
        """Return the same with the instants of their insertion."""
        arity = self.module.tables[predicate].arity
        return [(tuple(fact[ARGS : ARGS + arity]), fact[-1]) for fact in self._table(predicate).values()]

    def _table(self, predicate: int) -> dict[Any, GoneFact]:
        table: dict[Any, GoneFact] = getattr(self, f"t{predicate}")
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

    def _goals_changed(self, predicate: int) -> None:
        del predicate
        self.searched.clear()
        self.ranks = None
        if bool(self._any_goals and self._any_goals.open) != self.wanting:
            self.wanting = not self.wanting
            self.heed = self._trace or self.wanting
            self.stale |= self.module.all_rules

    # What the generated code asks

    def is_full(self, now: Instant) -> bool:
        """Tell whether one more fact is too many, and count it as dropped."""
        return self._is_full(now, self.count, self.length)

    def told(self, now: Instant, predicate: int, args: Args) -> None:
        """Let the time assertions know of a new fact that may concern them."""
        if not self.heed:
            self._inserted(now, predicate, args)

    def came(self, now: Instant, predicate: int, args: Args, rules: int) -> None:
        """Let all that heeds each fact know of a new one; it concerns the `rules`."""
        if self._trace:
            self._events.append(FactInserted(predicate, args, now))
        self.touched |= rules
        self._inserted(now, predicate, args)

    def went(self, now: Instant, predicate: int, args: Args, rules: int) -> None:
        """Let all that heeds facts know that one has gone; it concerned the `rules`."""
        if self._trace:
            self._events.append(FactRemoved(predicate, args, now))
        self.touched |= rules

    def queued(self, predicate: int) -> list[GoneFact]:
        """Return the facts of a predicate that are in no table, oldest first."""
        facts = list(getattr(self, f"t{predicate}"))
        for plan in self.module.readers[predicate]:
            facts += [getattr(self, f"m{plan.index}"), *self._waiting(plan.index)]
        return sorted([fact for fact in facts if fact is not None and fact[HELD]])

    def give_up(self) -> None:
        """Tell, once, that a search for matches has looked at too many facts."""
        (rule, part, step), facts = self.looking
        reason = NoValue(f"the search for matches was given up after {match.LOOKS_MAX} facts")
        self.failed(self._now, rule, part, step, facts, reason)

    def spill(self, kept: list[Entry], now: Instant) -> None:
        """Drop the newest of too many matches that have not fired."""
        for _ in range(len(kept) - once.MATCHES_MAX):
            self._dropped.add("matches", once.MATCHES_MAX, now)
        del kept[: -once.MATCHES_MAX]

    def failed(self, now: Instant, rule: int, part: int, step: int, facts: Sequence[GoneFact], reason: NoValue) -> None:
        """Tell, once, that an expression has no value."""
        seen: Any = [SeenFact(fact) for fact in facts]
        self._failures.match(now, rule, part, step, seen, str(reason))

    def apply(self, now: Instant, valued: Valued) -> None:
        """Do what a firing does: remove what it consumes, then add what it derives."""
        consumed, derived = valued
        remove = self.module.remove
        for predicate, fact in consumed:
            remove[predicate](self, now, fact)
        for chain in derived:
            self._follow(now, chain)

    def again(self, rule: int, now: Instant) -> None:
        """Look for the match with which a rule fires as the specification does."""
        plan = self.module.plans[rule]
        for entry in self._matches(plan, now):
            value = self.module.names[f"value{rule}"] if plan.valued else None
            valued = value(self, now, *entry) if value is not None else None
            if valued is not None or value is None:
                self._offer(plan, entry, valued)
                return
        self._offer(plan, None, None)

    def break_off(self, rule: int, now: Instant) -> None:
        """Match a rule anew from now on: an expression of it had no value, and which failures are told matters."""
        plan = self.module.plans[rule]
        self.module.slow(rule)
        if plan.once:
            unfired = set(map(key_of, self._kept(plan)))
            known = getattr(self, f"w{rule}") if plan.way is Way.JOIN else self.s
            last = getattr(self, f"l{rule}") if plan.way is Way.JOIN else self.s
            found = map(key_of, self._each(plan, now))
            fired = {key for key in found if key[0] <= last and max(key) <= known and key not in unfired}
            self.fired[rule] = Unfired(fired)
        self.broken |= plan.bit
        self.changed |= plan.bit
        self.again(rule, now)

    def fire_heeded(self, now: Instant) -> bool:
        """Fire a rule while each fact is heeded: one that comes nearest to an open goal; False if none is satisfied."""
        stale, self.stale = self.stale, 0
        touched, self.touched = self.touched, 0
        lowest, best = UNRANKED, list[tuple[RulePlan, Ranked | None]]()
        left, find = self.ready | stale, self.module.names["FIND"]
        while left:
            bit = left & -left
            left ^= bit
            plan = self.module.plans[bit.bit_length() - 1]
            if stale & bit:
                find[bit](self, now)
            if not self.ready & bit:
                self.searched.pop(plan.index, None)
                continue
            rank, ranked = self._rank(plan, now, bool(touched & bit))
            if rank < lowest:
                lowest = rank
                best.clear()
            if rank == lowest:
                best.append((plan, ranked))
        if not best:
            self.busy = False
            return False
        textual = self.program.strategy is Strategy.TEXTUAL or len(best) == 1
        plan, ranked = best[0 if textual else self._choices.below(len(best))]
        if ranked is None:
            single = plan.way is Way.SINGLE
            entry = (getattr(self, f"m{plan.index}"),) if single else getattr(self, f"k{plan.index}")[-1]
            valued = self._derive(plan, entry, now)
        else:
            _, entry, valued = ranked
        self.firings += 1
        self._events.append(RuleFired(plan.index, now))
        self._take(plan, entry)
        assert valued is not None
        self.apply(now, valued)
        return True

    # Matching anew

    def _each(self, plan: RulePlan, now: Instant) -> Iterator[Entry]:
        """Yield all matches of a rule, fired or not, and tell what fails."""
        each: Iterator[Entry] = self.module.names[f"each{plan.index}"](self, now)
        return each

    def _derive(self, plan: RulePlan, entry: Entry, now: Instant) -> Valued | None:
        self.module.slow(plan.index)
        valued: Valued | None = self.module.names[f"derive{plan.index}"](self, now, *entry)
        return valued

    def _matches(self, plan: RulePlan, now: Instant) -> Iterator[Entry]:
        """Yield the matches with which a rule that is matched anew may fire."""
        if not plan.once:
            return self._each(plan, now)
        unfired = self.fired.setdefault(plan.index, Unfired(set()))
        if self.changed & plan.bit or unfired.is_used_up:
            self.changed &= ~plan.bit
            unfired.look(self._each(plan, now))
        return unfired.each()

    def _offer(self, plan: RulePlan, entry: Entry | None, valued: Valued | None) -> None:
        """Make a match, or none, the one with which a rule that is matched anew fires next."""
        r = plan.index
        if plan.way is Way.SINGLE:
            setattr(self, f"m{r}", None if entry is None else entry[0])
            setattr(self, f"q{r}", None)
        else:
            setattr(self, f"k{r}", [] if entry is None else [entry])
        if plan.way is Way.JOIN:
            for name in (f"q{r}", f"c{r}", *[f"n{r}_{place}" for place, _ in plan.atoms[1:]]):
                setattr(self, name, None)
            setattr(self, f"l{r}", 1)  # facts that are not the first atom's count too
        if plan.valued:
            setattr(self, f"v{r}", valued)
        self.ready = self.ready & ~plan.bit if entry is None else self.ready | plan.bit

    # While goals are open

    def _rank(self, plan: RulePlan, now: Instant, touched: bool) -> tuple[int, Ranked | None]:
        """Return the rank of a satisfied rule; with its match if that is not the one that it fires without goals."""
        if not self.wanting:
            return UNRANKED, None
        if self.ranks is None:
            goals = self._goals
            found = [(goals.nearest(each.index), goals.is_settled(each.index)) for each in self.module.plans]
            self.ranks = [(UNRANKED if rank is None else rank, rank is None or settled) for rank, settled in found]
        nearest, settled = self.ranks[plan.index]
        if settled:
            return nearest, None
        if touched or plan.index not in self.searched:
            self.searched[plan.index] = self._search(plan, now, nearest)
        ranked = self.searched[plan.index]
        return (UNRANKED + 1, None) if ranked is None else (ranked[0], ranked)

    def _search(self, plan: RulePlan, now: Instant, nearest: int) -> Ranked | None:
        """Return the match that comes nearest to a goal, the oldest of several."""
        self.module.slow(plan.index)
        best: Ranked | None = None
        for entry in self._candidates(plan, now):
            valued = self._derive(plan, entry, now)
            if valued is None:
                continue
            rank = self._goals.rank(plan.index, valued[1], now)
            rank = UNRANKED if rank is None else rank
            if best is None or rank < best[0]:
                best = rank, entry, valued
            if best[0] <= nearest:
                break
        return best

    def _candidates(self, plan: RulePlan, now: Instant) -> Iterator[Entry]:
        if not plan.once:
            return self._each(plan, now)
        if plan.way is Way.AGAIN or self.broken & plan.bit:
            return self._matches(plan, now)
        return iter(self._kept(plan, everything=True, now=now))

    def _kept(self, plan: RulePlan, *, everything: bool = False, now: Instant = 0) -> list[Entry]:
        """Return the matches that a rule keeps, the oldest first; `everything` tries the tops that are left before."""
        r = plan.index
        if plan.way is Way.SINGLE:
            facts = [getattr(self, f"m{r}"), *self._waiting(r)]
            return [(fact,) for fact in facts if fact is not None and fact[HELD]]
        kept: list[Entry] = getattr(self, f"k{r}")
        if everything:
            tops = self._waiting(r)
            setattr(self, f"q{r}", None)
            for top in tops:
                setattr(self, f"l{r}", top[SERIAL])
                if top[HELD]:
                    self.module.names[f"below{r}"](self, now, top, kept)
            kept.sort(reverse=True)
        return sorted([entry for entry in kept if all(fact[HELD] for fact in entry)])

    def _waiting(self, rule: int) -> list[GoneFact]:
        """Return the facts in the queue of a rule."""
        queue = getattr(self, f"q{rule}")
        return [] if queue is None else queue[queue[0] + 1 :]

    def _take(self, plan: RulePlan, entry: Entry) -> None:
        """Take a match out of what its rule keeps: it fires."""
        r = plan.index
        self.stale |= plan.bit
        self.touched |= plan.bit
        if not plan.once:
            return
        if plan.way is Way.AGAIN or self.broken & plan.bit:
            self.fired[r].fire(entry)
        elif plan.way is Way.SINGLE:
            fact = entry[0]
            left = [
                each for each in (getattr(self, f"m{r}"), *self._waiting(r)) if each is not None and each is not fact
            ]
            setattr(self, f"m{r}", left[0] if left else None)
            setattr(self, f"q{r}", [0, *left[1:]] if left[1:] else None)
        else:
            kept = getattr(self, f"k{r}")
            kept.remove(entry)


def key_of(entry: Entry) -> Key:
    """Return the key of a match."""
    return tuple([fact[SERIAL] for fact in entry])


class Unfired:
    """Which matches of a rule that consumes nothing, and is matched anew, have fired and which not."""

    __slots__ = ("_complete", "_fired", "_left")

    def __init__(self, fired: set[Key]) -> None:
        """`fired` are the keys of matches, the serials of their facts."""
        self._fired = fired
        self._left: list[Entry] = []
        self._complete = True
        """Of those that have not fired all are in what is left."""

    @property
    def is_used_up(self) -> bool:
        """Whether nothing is left although there was more than is kept."""
        self._forget_gone()
        return not self._left and not self._complete

    def look(self, matches: Iterator[Entry]) -> None:
        """Take all `matches` that there are now: forget the fired ones that are gone."""
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
        """Note that a match has fired."""
        self._fired.add(key_of(entry))

    def _forget_gone(self) -> None:
        while self._left and not self._stands(self._left[-1]):
            self._left.pop()

    def _stands(self, entry: Entry) -> bool:
        return key_of(entry) not in self._fired and all(fact[HELD] for fact in entry)


def _machine_of(program: Program) -> type[Generated]:
    module = Module(program)
    return type("GeneratedMachine", (Generated,), {"__slots__": module.slots, "module": module, **module.methods})


machine_of: ByIdentity[Program, type[Generated]] = ByIdentity(_machine_of)
"""Returns the class of a program's machines."""
