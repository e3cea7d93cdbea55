"""The reference engine, an executable specification: facts in a store, rules matched as docs/language.md defines it.

It interprets the byte-code and keeps no derived state beside candidate matches. Faster engines are tested against it.
"""

from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.bytecode.program import Program
from rmr.vm.derive import FiringEffect
from rmr.vm.interpreter import Interpreter
from rmr.vm.machine import FIRING_BUDGET, Machine
from rmr.vm.machine_events import FactInserted, FactRemoved, RuleFired
from rmr.vm.match import FOLDED
from rmr.vm.store import Args, Fact, Store
from rmr.vm.subgoals import purpose_of


class Interpreted(Machine):
    """A machine that interprets its program."""

    __slots__ = ("_interpreter", "_store")

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
        self._store = Store(program.predicates)
        self._interpreter = Interpreter(
            program, self.robot, self._store, self._goals, choices, self._failures, self._dropped, self._urgency
        )

    @property
    def busy(self) -> bool:  # type: ignore[override]
        """Whether a rule may be satisfied."""
        return self._interpreter.busy

    def each(self, predicate: int) -> list[Args]:
        """Return the arguments of the facts of `predicate` that hold, oldest first."""
        return self._store.each(predicate)

    def dated(self, predicate: int) -> list[tuple[Args, Instant]]:
        """Return the same with the instants of their insertion."""
        return self._store.dated(predicate)

    def _insert(self, now: Instant, predicate: int, args: Args) -> None:
        store = self._store
        kept = self._shared.returns.get(predicate)
        table = predicate if kept is None else kept
        if predicate in self._shared.best and self.is_worse(now, predicate, args):
            return
        if store.has(predicate, args) or self._is_full(now, store.count, store.length):
            return
        store.insert(table, args, now)
        if self._trace:
            self._events.append(FactInserted(predicate, args, now))
        self._interpreter.touch(table)
        self._inserted(now, predicate, args)

    def _withdraw(self, now: Instant, predicate: int, args: Args) -> None:
        fact = self._store.tables[predicate].find(args)
        if fact is not None:
            self._remove(now, fact)

    def take_out(self, now: Instant, predicate: int) -> list[Args]:
        """Remove the facts of a temporary predicate and return their arguments, the oldest first."""
        facts = list(self._store.tables[predicate].facts.values())
        for fact in facts:
            self._remove(now, fact)
        return [fact.args for fact in facts]

    def _fire(self, now: Instant) -> None:
        interpreter = self._interpreter
        interpreter.resume()
        if self._any_goals is not None:
            self._any_goals.begin(now)
        for _ in range(self._budget):
            firing = interpreter.select(now)
            if firing is None:
                return
            self._apply(now, *firing)

    def _apply(self, now: Instant, rule: int, derivation: FiringEffect) -> None:
        """Fire a rule: remove what it consumes, then add what it derives."""
        self.firings += 1
        self._events.append(RuleFired(rule, now))
        if rule in self._shared.serving:
            facts = [fact.args for fact in self._interpreter.chosen(rule).facts if fact.predicate != FOLDED]
            self._purpose = purpose_of(self._shared.serving[rule], facts)
        for fact in derivation.consumed:
            self._remove(now, fact)
        for chain in derivation.derived:
            self._follow(now, chain)
        self._purpose = ()

    def _remove(self, now: Instant, fact: Fact) -> None:
        self._store.remove(fact)
        self._interpreter.touch(fact.predicate)
        self._removed(now, fact.predicate, fact.args, fact.at)
        if self._any_goals is not None and self._any_goals.open:
            self._any_goals.fact_changed(fact.predicate, fact.args, holds=False)
        if self._trace:
            self._events.append(FactRemoved(fact.predicate, fact.args, now))

    def _goals_changed(self, predicate: int) -> None:
        self._interpreter.touch_goal(predicate)
