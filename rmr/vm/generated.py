"""The engine that robots run: Python code generated from the program (`rmr.vm.generate`), and a state for each machine.

It fires the same rules for the same facts with the same draws as the interpreter, which is the specification. This
module is the observed mode, in which each change is reported: while goals are open or jobs press, because rank and
urgency may depend on the items that a match derives, and while changes are traced.
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
from rmr.vm.ranks import PENDING
from rmr.vm.rotor import ROTOR_MATCHES_MAX
from rmr.vm.running import Entry, Running, Valued
from rmr.vm.subgoals import purpose_of
from rmr.vm.urgency import UNURGENT, Urgency

Ranked = tuple[int, int, Entry, Valued]
"""A match with its rank and urgency."""


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
            self._observe()

    def _jobs_changed(self, urgency: Urgency) -> None:
        super()._jobs_changed(urgency)
        self.searched.clear()
        if urgency.has_jobs != self.pressing:
            self.pressing = urgency.has_jobs
            # Between two firings only: code of one that is under way reports its facts in the mode in which it began.
            self.unsettled = True

    def settle_jobs(self) -> None:
        """Begin or end the observed mode, between two firings: jobs have begun or ceased to press."""
        self.unsettled = False
        self._observe()

    def _observe(self) -> None:
        """Begin or end to report each change, as goals and jobs are there or not."""
        self.observed = self._trace or self.wanting or self.pressing
        self.stale |= self.module.all_rules

    def fire_observed(self, now: Instant) -> bool:
        """Fire the rule nearest to an open goal, while each change is reported; return False if none is satisfied.

        False also if the machine waits for ranks; then it stays busy.
        """
        if self.wanting and self._goals.settle():
            self.searched.clear()
        lowest, best = self._nearest(now)
        if not best:
            self.busy = False
            return False
        if lowest == PENDING:
            if not self._goals.wait():
                self.searched.clear()
                return self.fire_observed(now)
            return False
        textual = self.program.strategy is Strategy.TEXTUAL or len(best) == 1
        plan, ranked = best[0 if textual else self._choices.below(len(best))]
        if ranked is None:
            single = plan.way is Way.SINGLE
            entry = (getattr(self, plan.slots.match),) if single else getattr(self, plan.slots.kept)[-1]
            valued = self._derive(plan, entry, now)
        else:
            _, _, entry, valued = ranked
        if lowest < UNRANKED and not plan.once:
            self._goals.fire(now, plan.index, plan.args_of(entry))
        self.firings += 1
        self._events.append(RuleFired(plan.index, now))
        if plan.index in self._shared.serving:
            self._purpose = purpose_of(self._shared.serving[plan.index], plan.args_of(entry))
        self._take(plan, entry)
        if plan.drawn:
            self.drew(plan.index)
        assert valued is not None
        self.apply(now, valued)
        self._purpose = ()
        return True

    def _nearest(self, now: Instant) -> tuple[int, list[tuple[RulePlan, Ranked | None]]]:
        """Return the lowest rank of a satisfied rule, and the most urgent rules that have it, in program order."""
        stale = self.stale
        self.stale = 0
        touched = self.touched
        self.touched = 0
        lowest = UNRANKED
        most = UNURGENT
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
            urgency = UNURGENT if ranked is None else ranked[1]
            if rank < lowest or (rank == lowest and urgency < most):
                lowest = rank
                most = urgency
                best.clear()
            if rank == lowest and urgency == most:
                best.append((plan, ranked))
        return lowest, best

    def _rank(self, plan: RulePlan, now: Instant, touched: bool) -> tuple[int, Ranked | None]:
        """Return the rank of a satisfied rule, and its match unless that is the one that it keeps (the oldest)."""
        first = UNURGENT
        if self.pressing:
            assert self._urgency is not None
            first = self._urgency.first(plan.index)
        if not self.wanting and first == UNURGENT:
            return UNRANKED, None
        if self.ranks is None:
            goals = self._goals
            found = [(goals.nearest(each.index), goals.is_settled(each.index)) for each in self.module.plans]
            self.ranks = [(UNRANKED if rank is None else rank, rank is None or settled) for rank, settled in found]
        nearest, settled = self.ranks[plan.index]
        is_alike = settled and (nearest == UNRANKED or plan.once or not self._goals.rotor.turns(plan.index))
        if is_alike and first == UNURGENT:
            return nearest, None
        if touched or plan.index not in self.searched:
            self.searched[plan.index] = self._search(plan, now, nearest, first)
        ranked = self.searched[plan.index]
        return (UNRANKED + 1, None) if ranked is None else (ranked[0], ranked)

    def _search(self, plan: RulePlan, now: Instant, nearest: int, first: int) -> Ranked | None:
        """Return the match of the best rank; ties are broken by urgency, the least recent firing, and age.

        `nearest` and `first` are lower bounds on rank and urgency.
        """
        self.module.slow(plan.index)
        rotor = self._goals.rotor
        turns = nearest != UNRANKED and not plan.once and rotor.turns(plan.index)
        best: Ranked | None = None
        best_last = compared = 0
        for entry in self._candidates(plan, now):
            valued = self._derive(plan, entry, now)
            if valued is None:
                continue
            ranked = self._goals.rank(plan.index, valued[1], now) if nearest != UNRANKED else None
            rank = UNRANKED if ranked is None else ranked
            urgency = UNURGENT if first == UNURGENT or self._urgency is None else self._urgency.of(valued[1], now)
            last = rotor.last(plan.index, plan.args_of(entry)) if turns and rank != UNRANKED else 0
            if best is None or (rank, urgency) < best[:2]:
                best = (rank, urgency, entry, valued)
                best_last = last
                compared = 1
            elif (rank, urgency) == best[:2] and compared < ROTOR_MATCHES_MAX:
                compared += 1
                if last < best_last:
                    best = (rank, urgency, entry, valued)
                    best_last = last
            if best[0] <= nearest and best[1] <= first and (not best_last or compared >= ROTOR_MATCHES_MAX):
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
