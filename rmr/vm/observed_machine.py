"""The interpreter with a provenance log: the machine of a robot whose past is to be explained (`rmr.vm.provenance`).

It fires the same rules for the same facts with the same draws as every engine, and reports the same events. A firing
is derived a second time, with a list of the inner matches, so that each derived item is known with its premises.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.bytecode.arithmetic import truth
from rmr.bytecode.program import Aggregate, Comprehension, HeadValue, Operator, Program
from rmr.vm.derive import Chain, Derived, DerivedKind, FiringEffect, Inner, InnerMatch, PlannedHead, PlannedWhen
from rmr.vm.goals import GoalArgs
from rmr.vm.interpreted import Interpreted
from rmr.vm.interpreter import UNRANKED
from rmr.vm.job import TimedJob
from rmr.vm.machine import FIRING_BUDGET
from rmr.vm.machine_events import ActionDerived, FactSent, GoalSent, JobStarted
from rmr.vm.match import FOLDED, Env, bind_again
from rmr.vm.provenance import (
    ActionRecord,
    Cause,
    ChainOrigin,
    EffectCause,
    FiringCause,
    FiringRecord,
    GivenCause,
    GoalRecord,
    InsertionRecord,
    JobRecord,
    MissedCause,
    ProvenanceLog,
    RemovalRecord,
    Rival,
    SendRecord,
    StepCause,
)
from rmr.vm.ranks import here
from rmr.vm.store import Args, Fact


class ObservedMachine(Interpreted):
    """An interpreted machine that writes a provenance log."""

    __slots__ = ("_because", "_log", "_sends")

    def __init__(
        self,
        program: Program,
        robot: int,
        choices: Choices,
        log: ProvenanceLog,
        *,
        firing_budget: int = FIRING_BUDGET,
        trace: bool = False,
    ) -> None:
        super().__init__(program, robot, choices, firing_budget=firing_budget, trace=trace)
        self._log = log
        self._sends = 0
        self._because: Cause = GivenCause("program")
        """The cause of whatever the present input brings about."""

    # Input from the host

    def _insert_all(self, now: Instant, facts: Iterable[tuple[int, Args]]) -> None:
        self._because = GivenCause("program")
        super()._insert_all(now, facts)

    def _arrive(self, now: Instant, cause: Cause) -> None:
        self._because = cause
        super()._arrive(now, cause)

    def run(self, now: Instant, last: bool = True) -> None:
        """Run as every machine does, and note whether the run was not finished."""
        super().run(now, last)
        if self.busy:
            self._log.unfinished.append(self.firings)

    # Consequences

    def _apply(self, now: Instant, rule: int, derivation: FiringEffect) -> None:
        number = self.firings + 1
        self._log.records.append(self._firing(now, number, rule, derivation))
        self._because = FiringCause(number, 0)
        super()._apply(now, rule, derivation)

    def _follow(self, now: Instant, chain: Chain) -> None:
        because = self._because
        if isinstance(because, EffectCause):
            self._because = StepCause(because.action, because.news)
        super()._follow(now, chain)
        if isinstance(because, FiringCause):
            self._because = because._replace(chain=because.chain + 1)

    def _inserted(self, now: Instant, predicate: int, args: Args) -> None:
        fact = self._store.newest
        kept = self._shared.returns.get(predicate)
        table = predicate if kept is None else kept
        self._log.records.append(InsertionRecord(now, fact, table, args, self._because))
        before = len(self._events)
        super()._inserted(now, predicate, args)
        for event in self._events[before:]:
            if isinstance(event, JobStarted):
                self._log.records.append(JobRecord(now, event.job.serial, fact))

    def _remove(self, now: Instant, fact: Fact) -> None:
        self._log.records.append(RemovalRecord(now, fact.serial, self._because))
        super()._remove(now, fact)

    def _want(self, now: Instant, predicate: int, args: GoalArgs) -> None:
        self._log.records.append(GoalRecord(now, predicate, here(args, self.robot), self._because))
        super()._want(now, predicate, args)

    def _give(self, now: Instant, item: Derived) -> None:
        super()._give(now, item)
        if item.owner != self.robot:
            self._sent(now, item.role, item.owner, item.predicate, item.args)

    def _sent(self, now: Instant, role: DerivedKind, destination: int, predicate: int, args: Args) -> None:
        """Record that the last event is to be sent to another robot, and number it."""
        event = self._events[-1]
        assert isinstance(event, FactSent | GoalSent | ActionDerived)
        self._sends += 1
        self._events[-1] = replace(event, number=self._sends)
        self._log.records.append(SendRecord(now, role, int(destination), predicate, args, self._because))

    def _act(
        self,
        now: Instant,
        predicate: int,
        executor: int,
        args: Args,
        then: Chain = (),
        origin: tuple[int, int] | None = None,
    ) -> None:
        super()._act(now, predicate, executor, args, then, origin)
        event = self._events[-1]
        assert isinstance(event, ActionDerived)
        if event.serial:
            record = ActionRecord(now, event.serial, predicate, int(executor), args, self._because, then)
            self._log.records.append(record)
        if executor != self.robot:
            self._sent(now, DerivedKind.ACTION, executor, predicate, args)

    def _miss(self, until: Instant) -> None:
        because = self._because  # of the input that comes after the deadlines before it
        super()._miss(until)
        self._because = because

    def _missed(self, job: TimedJob) -> None:
        self._because = MissedCause(job.serial)

    # A firing

    def _firing(self, now: Instant, number: int, rule: int, effect: FiringEffect) -> FiringRecord:
        interpreter = self._interpreter
        candidate = interpreter.chosen(rule)
        planned = interpreter.planned(rule)
        env = interpreter.slots_of(rule, ago=1)
        bind_again(planned.steps, candidate.facts, env, now)
        bindings = tuple(env[: len(env) - planned.drawn])
        matches: list[InnerMatch] = []
        planned.derive(self._store, env, candidate.facts, now, _ignore, matches)
        return FiringRecord(
            now,
            number,
            rule,
            bindings,
            _serials(candidate.facts),
            _serials(effect.consumed),
            tuple(_origins(planned.head, env, effect.derived, matches)),
            None if candidate.rank == UNRANKED else candidate.rank,
            tuple(
                [
                    Rival(index, None if rank == UNRANKED else rank, each, _serials(interpreter.chosen(index).facts))
                    for index, rank, each in interpreter.rivals(rule)
                ]
            ),
            tuple([(predicate, args) for predicate, goals in self._goals.open.items() for args in goals.values()]),
            candidate.urgency,
        )


def _ignore(part: int, step: int, facts: Sequence[Fact], reason: str) -> None:
    """Drop a failure of an expression: it was reported when the rule was matched."""
    del part, step, facts, reason


def _serials(facts: Iterable[Fact]) -> tuple[int, ...]:
    return tuple([fact.serial for fact in facts if fact.predicate != FOLDED])


def _origins(
    head: Sequence[PlannedHead], env: Env, derived: Sequence[Chain], matches: Sequence[InnerMatch]
) -> Iterator[ChainOrigin]:
    """Yield the derived chains, each with the facts of the inner match or matches that it comes from.

    `env` has the slots of the firing after its head has been evaluated, the conditions of choices included.
    """
    rest = iter(derived)
    for part, planned in enumerate(head):
        item = planned.item if isinstance(planned, PlannedWhen) and truth(env[planned.slot]) else planned
        if isinstance(item, HeadValue | PlannedWhen):
            continue
        if not isinstance(item, Inner):
            yield ChainOrigin(next(rest), ())
            continue
        found = [_serials(facts) for place, facts in matches if place == part]
        if isinstance(item.head, Comprehension):
            for serials in found:
                for _ in item.items:
                    yield ChainOrigin(next(rest), serials)
        elif found or not _needs_match(item.head):
            for _ in item.items:
                yield ChainOrigin(next(rest), tuple([serial for serials in found for serial in serials]))


def _needs_match(aggregate: Aggregate) -> bool:
    """Return whether an aggregate of no match derives nothing."""
    return aggregate.operator in (Operator.MIN, Operator.MAX)
