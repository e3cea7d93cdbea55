"""The engine that robots run: Python code generated from the program (`rmr.vm.generate`), and a state for each machine.

It fires the same rules for the same facts with the same draws as the interpreter, which is the specification. This
module is the observed mode, in which each change is reported: while goals are open, because a rank may depend on the
items that a match derives, and while changes are traced.
"""

from collections.abc import Iterator
from typing import Any

from rmr.base.identity import ByIdentity
from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.bytecode.program import Program, Strategy
from rmr.vm.generate.module import Module
from rmr.vm.generate.plan import RulePlan, Way
from rmr.vm.interpreter import UNRANKED
from rmr.vm.machine_events import RuleFired
from rmr.vm.rotor import ROTOR_MATCHES_MAX
from rmr.vm.running import Running
from rmr.vm.unfired import Entry, Valued

Ranked = tuple[int, Entry, Valued]
"""A match with its rank."""


class Generated(Running):
    """A machine that runs code generated from its program; `machine_of` makes a subclass for each program."""

    __slots__ = ("ranks", "searched")

    def __init__(self, program: Program, robot: int, choices: Choices, **options: Any) -> None:
        self.ranks: list[tuple[int, bool]] | None = None
        """While goals are open, by rule: the lowest rank of its firings, and whether all of them have it."""
        self.searched: dict[int, Ranked | None] = {}
        """While goals are open: the best match of each rule whose firings differ in rank."""
        super().__init__(program, robot, choices, **options)

    def _goals_changed(self, predicate: int) -> None:
        del predicate
        self.searched.clear()
        self.ranks = None
        if bool(self._any_goals and self._any_goals.open) != self.wanting:
            self.wanting = not self.wanting
            self.observed = self._trace or self.wanting
            self.stale |= self.module.all_rules

    def fire_observed(self, now: Instant) -> bool:
        """Fire the rule nearest to an open goal, while each change is reported; return False if none is satisfied."""
        stale = self.stale
        self.stale = 0
        touched = self.touched
        self.touched = 0
        lowest = UNRANKED
        best = list[tuple[RulePlan, Ranked | None]]()
        left = self.ready | stale  # rules by ascending bit: program order, in which failures are reported
        find = self.module.names["FIND"]
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
            entry = (getattr(self, plan.slots.match),) if single else getattr(self, plan.slots.kept)[-1]
            valued = self._derive(plan, entry, now)
        else:
            _, entry, valued = ranked
        if lowest < UNRANKED and not plan.once:
            self._goals.fire(now, plan.index, plan.args_of(entry))
        self.firings += 1
        self._events.append(RuleFired(plan.index, now))
        self._take(plan, entry)
        assert valued is not None
        self.apply(now, valued)
        return True

    def _rank(self, plan: RulePlan, now: Instant, touched: bool) -> tuple[int, Ranked | None]:
        """Return the rank of a satisfied rule, and its match unless that is the one that it keeps (the oldest)."""
        if not self.wanting:
            return UNRANKED, None
        if self.ranks is None:
            goals = self._goals
            found = [(goals.nearest(each.index), goals.is_settled(each.index)) for each in self.module.plans]
            self.ranks = [(UNRANKED if rank is None else rank, rank is None or settled) for rank, settled in found]
        nearest, settled = self.ranks[plan.index]
        if settled and (nearest == UNRANKED or plan.once or not self._goals.rotor.turns(plan.index)):
            return nearest, None
        if touched or plan.index not in self.searched:
            self.searched[plan.index] = self._search(plan, now, nearest)
        ranked = self.searched[plan.index]
        return (UNRANKED + 1, None) if ranked is None else (ranked[0], ranked)

    def _search(self, plan: RulePlan, now: Instant, nearest: int) -> Ranked | None:
        """Return the match of the best rank; ties are broken by the least recent firing, then by age."""
        self.module.slow(plan.index)
        rotor = self._goals.rotor
        turns = not plan.once and rotor.turns(plan.index)
        best: Ranked | None = None
        best_last = compared = 0
        for entry in self._candidates(plan, now):
            valued = self._derive(plan, entry, now)
            if valued is None:
                continue
            rank = self._goals.rank(plan.index, valued[1], now)
            rank = UNRANKED if rank is None else rank
            last = rotor.last(plan.index, plan.args_of(entry)) if turns and rank != UNRANKED else 0
            if best is None or rank < best[0]:
                best = (rank, entry, valued)
                best_last = last
                compared = 1
            elif rank == best[0] and compared < ROTOR_MATCHES_MAX:
                compared += 1
                if last < best_last:
                    best = (rank, entry, valued)
                    best_last = last
            if best[0] <= nearest and (not best_last or compared >= ROTOR_MATCHES_MAX):
                break
        return best

    def _candidates(self, plan: RulePlan, now: Instant) -> Iterator[Entry]:
        if not plan.once:
            return self._each(plan, now)
        if plan.way is Way.REMATCH or self.broken & plan.bit:
            return self._matches(plan, now)
        return iter(self._kept(plan, everything=True, now=now))

    def _take(self, plan: RulePlan, entry: Entry) -> None:
        """Remove a match that fires from those that its rule keeps."""
        slots = plan.slots
        self.stale |= plan.bit
        self.touched |= plan.bit
        if not plan.once:
            return
        if plan.way is Way.REMATCH or self.broken & plan.bit:
            self.fired[plan.index].fire(entry)
        elif plan.way is Way.SINGLE:
            fact = entry[0]
            waiting = getattr(self, slots.match), *self._waiting(plan)
            left = [each for each in waiting if each is not None and each is not fact]
            setattr(self, slots.match, left[0] if left else None)
            setattr(self, slots.queue, [0, *left[1:]] if left[1:] else None)
        else:
            getattr(self, slots.kept).remove(entry)


def _machine_of(program: Program) -> type[Generated]:
    module = Module(program)
    return type("GeneratedMachine", (Generated,), {"__slots__": module.slots, "module": module, **module.methods})


machine_of: ByIdentity[Program, type[Generated]] = ByIdentity(_machine_of)
"""Returns the class of a program's machines."""
