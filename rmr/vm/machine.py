"""The virtual machine of one robot: facts in, events out (paper IV.B, figure 6).

This module is the part common to all engines: the interface to the host, and the handling of goals, time assertions and
actions. Engines differ in how they store facts and find the rule that fires next (`rmr.vm.engines`). The host passes in
facts from outside, goals, the ends of actions and the time, calls `run`, and collects events with `drain`.

A firing is atomic: first the facts that the body consumes are removed, then the items of the head are derived, then the
next rule is chosen. An insertion first discharges goals, then ends jobs, then starts them.

A deadline is inclusive (t' - t <= d, paper III.E): a fact inserted at the instant of the deadline is in time. So
deadlines before `now` are handled before anything else that happens at `now`, and deadlines at `now` after it. The
machine has no clock and never waits; between two `run`s the host sleeps until `next_wake`.
"""

from abc import abstractmethod
from collections.abc import Iterable

from rmr.base.streams import Choices
from rmr.base.time import NEVER, Instant
from rmr.base.values import Value, format_fact
from rmr.bytecode.octets import identity
from rmr.bytecode.program import ANY, Constant, Duty, Effect, Kind, Pattern, Program, Strategy
from rmr.vm.aggregate import replaces
from rmr.vm.derive import Chain, Derived, DerivedKind, evaluated
from rmr.vm.evaluate import NoValue
from rmr.vm.goals import GoalArgs
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import (
    ActionDerived,
    FactSent,
    GoalSent,
    GoalWithdrawn,
    JobMissed,
    VmEvent,
)
from rmr.vm.machine_parts import Parts
from rmr.vm.match import pattern_agrees
from rmr.vm.provenance import OUTSIDE, Cause, DeliveredCause, EffectCause, GivenCause, OutsideCause
from rmr.vm.ranks import goal_key, here
from rmr.vm.store import Args
from rmr.vm.subgoals import Purpose
from rmr.vm.type_checks import TypeChecks
from rmr.vm.urgency import Urgency

FACTS_MAX = 100_000
"""Facts of one robot, of all kinds; beyond that a fact is dropped. A full store of short facts takes some 50 MB."""

FACTS_LENGTH_MAX = 4_000_000
"""Total length, in characters and items, of the strings and lists of all facts; beyond that a fact is dropped."""

FIRING_BUDGET = 500
"""Firings of one `run`. The bound keeps a robot responsive whose program never becomes quiescent."""

_FACT = DerivedKind.FACT
_ACTION = DerivedKind.ACTION  # looking up a member of an enumeration takes longer than an insertion should


class Machine(Parts):
    """Runs one program for one robot."""

    __slots__ = (
        "_bests",
        "_budget",
        "_choices",
        "_now",
        "_purpose",
        "_returning",
        "_seed",
        "_trace",
        "_urgency",
        "firings",
    )

    def __init__(
        self,
        program: Program,
        robot: int,
        choices: Choices,
        *,
        firing_budget: int = FIRING_BUDGET,
        trace: bool = False,
    ) -> None:
        super().__init__(program, robot)
        self.firings = 0
        self._budget = firing_budget
        self._trace = trace
        self._now: Instant = 0
        self._choices = choices
        self._bests: dict[tuple[object, ...], Args] = {}
        """The best fact of those that agree before the argument that decides, by predicate and what they agree in."""
        self._purpose: Purpose = ()
        """The open goals that the present firing serves; what it derives serves them, too."""
        self._returning = False
        """Whether the fact that is inserted has held before: it comes back to the rules alone."""
        by_deadline = program.strategy is Strategy.DEADLINE and bool(program.assertions)
        self._urgency = Urgency(program, self.robot) if by_deadline else None
        """Of firings; None if jobs have no influence on their order."""
        self._seed = choices.state
        """Of what `random()` draws; the choices among rules do not change it."""

    # Implemented by the engines

    busy: bool
    """Whether a rule may be satisfied."""

    @abstractmethod
    def _insert(self, now: Instant, predicate: int, args: Args) -> None:
        """Insert a fact of this robot and apply its consequences (`_inserted`), unless a set holds it already."""

    @abstractmethod
    def _withdraw(self, now: Instant, predicate: int, args: Args) -> None:
        """Remove the sensed fact if it holds."""

    @abstractmethod
    def take_out(self, now: Instant, predicate: int) -> list[Args]:
        """Remove the facts of a temporary predicate and return their arguments, the oldest first."""

    @abstractmethod
    def _fire(self, now: Instant) -> None:
        """Fire rules until none is satisfied, or until the budget is used."""

    @abstractmethod
    def _goals_changed(self, predicate: int) -> None:
        """Mark the rules dirty whose rank depends on the goals of `predicate`: some were opened or discharged."""

    # Input from the host

    def start(self, now: Instant) -> None:
        """Insert the facts, then the goals, that the program states for this robot."""
        shared = self._shared
        if shared.number is not None:
            self.insert(now, shared.number, (int(self.robot),), GivenCause("robot"))
        self._insert_all(now, shared.facts(self.robot))
        for goal in self.program.goals:
            if goal.owner is None or goal.owner == self.robot:
                self._want(now, goal.predicate, goal.args)

    def insert(self, now: Instant, predicate: int, args: Args, cause: Cause = OUTSIDE) -> None:
        """Insert a fact from outside, of any kind; a sensed or persistent fact that already holds changes nothing.

        `cause`, as of every input, is written down by a machine that logs provenance, and ignored by all others.

        Raises:
            ValueError: `args` (without the owner) are not what the predicate declares.
        """
        self._arrive(now, cause)
        self._insert(now, predicate, self._shared.gate.fact(predicate, args))

    def give_back(self, now: Instant, predicate: int, args: Args) -> None:
        """Insert a fact that was set aside: it achieves no goal, ends no job and starts none."""
        self._arrive(now, OUTSIDE)
        self._returning = True
        self._insert(now, predicate, args)
        self._returning = False

    def want(self, now: Instant, predicate: int, args: tuple[Value | Pattern, ...], cause: Cause = OUTSIDE) -> None:
        """Open a goal from outside; ANY among `args` matches anything.

        Raises:
            ValueError: `args` (without the owner) are not what the predicate declares.
        """
        self._arrive(now, cause)
        self._want(now, predicate, self._shared.gate.goal(predicate, args))

    def withdraw(self, now: Instant, predicate: int, args: Args, cause: Cause = OUTSIDE) -> None:
        """Remove a sensed fact that no longer holds; nothing happens if it does not hold.

        Raises:
            ValueError: the predicate is not sensed, or `args` are not what it declares.
        """
        self._arrive(now, cause)
        self._withdraw(now, predicate, self._shared.gate.sensed(predicate, args))

    def derive(self, now: Instant, chain: Chain) -> None:
        """Derive what a firing has derived by which an offer of an earlier program was settled."""
        self._arrive(now, OUTSIDE)
        self._follow(now, chain)

    def derive_action(
        self,
        now: Instant,
        predicate: int,
        args: Args,
        origin: tuple[int, int] | None = None,
        cause: Cause = OUTSIDE,
    ) -> None:
        """Accept an action that another robot derived for this one.

        `origin` is the robot that waits for the action's end, and the action's serial there.

        Raises:
            ValueError: `args` (without the executor) are not what the action declares.
        """
        self._arrive(now, cause)
        args = self._shared.gate.action(predicate, args)
        self._act(now, predicate, self.robot, args, (), origin)

    def complete(
        self,
        now: Instant,
        serial: int,
        ok: bool,
        executor: int | None = None,
        news: DeliveredCause | OutsideCause = OUTSIDE,
    ) -> bool:
        """End an action: insert its effects or, if it failed, its else effects; then derive the next step of its chain.

        The effects are inserted by the robot that executed the action. `executor` is the robot that reports the end
        (None: accept the report without this check). Returns False if the action is not under way, or another robot
        executes it. Effects on sensed predicates are left to the sensors. A failure drops the rest of the chain. `news`
        is how the end became known.
        """
        self._arrive(now, EffectCause(serial, ok, news))
        awaited = self._under_way.end(serial, executor)
        if awaited is None:
            return False
        action, then = awaited
        if action.executor == self.robot:
            for effect, checks in self._shared.effects(action.predicate, ok):
                self._take_effect(now, effect, checks, action)
        served = () if self._any_subgoals is None else self._any_subgoals.over(serial)
        if ok:
            self._purpose = served
            self._follow(now, then)
            self._purpose = ()
        return True

    def await_finish(self, now: Instant, watcher: int, assertion: int, start_args: Args, since: Instant) -> None:
        """Watch for a finish fact of this robot on behalf of a job of `watcher` that has been running since `since`.

        The report is a `FinishSeen` event. It comes at once if the fact was inserted since then, or holds and is not
        temporary.

        Raises:
            ValueError: `watcher` can have no such job, or the fact is not this robot's.
        """
        self._arrive(now, OUTSIDE)
        seen = self._watches.ask(now, watcher, assertion, start_args, since)
        if seen is not None:
            self._events.append(seen)

    def finish_seen(self, now: Instant, source: int, assertion: int, args: Args, at: Instant) -> bool:
        """End the jobs that wait for a finish fact that robot `source` inserted at `at`; False if none waits for it.

        Raises:
            ValueError: there is no such assertion, or `args` are not what its finish fact declares.
        """
        self._arrive(now, OUTSIDE)
        if not 0 <= assertion < len(self.program.assertions):
            raise ValueError(f"there is no assertion {assertion}")
        args = self._shared.gate.fact(self.program.assertions[assertion].finish.predicate, args)
        events = self._assertions.seen(source, assertion, args, min(at, now))
        self._events += events
        if events and self._urgency is not None:
            self._jobs_changed(self._urgency)
        return bool(events)

    def run(self, now: Instant, last: bool = True) -> None:
        """Handle the deadlines that are due and fire rules until quiescence, or until the budget is used.

        Unless this is the `last` run at `now`, deadlines at `now` are left: another input may end jobs in time.
        """
        self._now = now
        jobs = self._any_jobs
        if jobs is not None and jobs.due < now:
            self._miss(now - 1)
        if self.busy:
            self._fire(now)
        # Deadlines at `now` come last: a firing at `now` may still insert the finish fact in time.
        jobs = self._any_jobs  # the first job may have started in this run
        if last and jobs is not None and jobs.due <= now:
            self._miss(now)
            if self.busy:  # by a fact of a violation
                self._fire(now)

    # Queries of the host

    @property
    def quiescent(self) -> bool:
        """Whether the last `run` ended with no rule satisfied, rather than with its budget used."""
        return not self.busy

    @property
    def next_wake(self) -> Instant:
        """When `run` is next needed: now if rules may be satisfied, else at the next deadline, else NEVER."""
        return self._now if self.busy else self.due

    @property
    def due(self) -> Instant:
        """The next deadline of a job; NEVER if there is none."""
        return NEVER if self._any_jobs is None else self._any_jobs.due

    @property
    def jobs(self) -> list[TimedJob]:
        """The jobs of all time assertions, in the order of their first start (the last `JOBS_MAX`)."""
        return [] if self._any_jobs is None else list(self._any_jobs.jobs)

    def live_jobs(self) -> list[TimedJob]:
        """Return the jobs without finish, missed ones included, in the order of their first start."""
        return [] if self._any_jobs is None else self._any_jobs.live

    def undecided_jobs(self) -> list[TimedJob]:
        """Return the jobs that are neither finished nor missed, in the order of their first start."""
        return [] if self._any_jobs is None else self._any_jobs.undecided()

    @property
    def expression_failures(self) -> int:
        """Number of failures of expressions (no value); each suppressed a result."""
        return self._failures.count

    @property
    def dropped(self) -> dict[str, int]:
        """Number of things dropped because a bound was reached, by kind; a kind without drops is missing."""
        return dict(self._dropped.counts)

    @property
    def called_at(self) -> Instant:
        """Upper bound on the instant of the last change of facts: that of the last input or `run`."""
        return self._now

    def has_due(self, now: Instant) -> bool:
        """Return whether there is work for `run` at `now`, or an event to drain. Mostly False while a robot drives."""
        jobs = self._any_jobs
        return self.busy or bool(self._events) or (jobs is not None and jobs.due <= now)

    @property
    def has_news(self) -> bool:
        """Whether there is anything to drain."""
        return bool(self._events)

    def drain(self) -> list[VmEvent]:
        """Return the events since the last call, in order."""
        events = self._events.copy()
        self._events.clear()
        return events

    def serves(self, predicate: int, args: Args) -> list[TimedJob]:
        """Return the scheduled jobs without finish that this action of the robot serves, first due first."""
        return [] if self._any_jobs is None else self._any_jobs.serving(predicate, args)

    def steps_after(self, serial: int) -> Chain:
        """Return the later steps of the chain (``then``) in which an action under way is a step."""
        return () if self._any_actions is None else self._any_actions.steps_after(serial)

    def held(self, predicate: int) -> list[Args]:
        """Return the arguments of the facts of `predicate` that hold, oldest first."""
        return list(self.each(predicate))

    def holds(self, predicate: int, args: tuple[Pattern, ...]) -> bool:
        """Return whether a fact that matches `args` holds; a slot matches any value."""
        return any(pattern_agrees(args, fact) for fact in self.each(predicate))

    def facts(self) -> list[str]:
        """Return the temporary and persistent facts but for provided ones, in program syntax, sorted."""
        texts: list[str] = []
        hidden = self._shared.hidden
        for index, predicate in enumerate(self.program.predicates):
            if predicate.provided or predicate.kind is Kind.SENSED or index in hidden:
                continue
            mark = "!" if predicate.kind is Kind.PERSISTENT else ""
            texts.extend(format_fact(predicate.name, (self.robot, *args), mark) for args in self.each(index))
        return sorted(texts)

    def set_aside(self) -> list[str]:
        """Return the facts that are set aside while another robot decides, in program syntax, sorted."""
        predicates = self.program.predicates
        return sorted(
            format_fact(predicates[hidden.other].name, (self.robot, *args[1:]))
            for hidden in self._shared.hidden.values()
            if hidden.duty is Duty.ASIDE and hidden.other is not None
            for args in self.each(hidden.predicate)
        )

    def goals(self) -> dict[str, list[list[object]] | list[str]]:
        """Return ``{"achieved": [[text, seconds], ...], "open": [text, ...]}``."""
        return self._goals.report()

    # Internal steps

    def _insert_all(self, now: Instant, facts: Iterable[tuple[int, Args]]) -> None:
        """Insert facts, given with their predicates."""
        for predicate, args in facts:
            self._insert(now, predicate, args)

    def _arrive(self, now: Instant, cause: Cause) -> None:  # noqa: ARG002
        """Handle the deadlines before `now`, ahead of an input at `now`; `cause` is for `ObservedMachine` alone."""
        self._now = now
        jobs = self._any_jobs
        if jobs is not None and jobs.due < now:
            self._miss(now - 1)

    def _follow(self, now: Instant, chain: Chain) -> None:
        """Derive the steps of a chain up to its first action; the steps after that wait for its end."""
        for place, item in enumerate(chain):
            if item.role is _ACTION:
                self._act(now, item.predicate, item.owner, item.args, chain[place + 1 :])
                return
            self._give(now, item)

    def _give(self, now: Instant, item: Derived) -> None:
        """Insert a fact or open a goal, here or at the robot that owns it."""
        if item.owner != self.robot:
            event = FactSent if item.role is _FACT else GoalSent
            self._events.append(event(item.owner, item.predicate, item.args))
        elif item.role is _FACT:
            self._insert(now, item.predicate, item.args)
        else:
            self._want(now, item.predicate, tuple([Constant(value) for value in item.args]))

    def is_worse(self, now: Instant, predicate: int, args: Args) -> bool:
        """Return whether a fact is no better than the one kept in its place; remove that one if it is better."""
        best = self._shared.best[predicate]
        key = (predicate, identity(args[: best.argument]))
        kept = self._bests.get(key)
        if kept is not None:
            if not replaces(best, args, kept):
                return True
            self._withdraw(now, predicate, kept)
        self._bests[key] = args
        return False

    def _is_full(self, now: Instant, count: int, length: int) -> bool:
        """Return whether a store of `count` facts and total `length` is full; then count one fact as dropped."""
        if count >= FACTS_MAX:
            self._dropped.add("facts", FACTS_MAX, now)
        elif length >= FACTS_LENGTH_MAX:
            self._dropped.add("lengths", FACTS_LENGTH_MAX, now)
        else:
            return False
        return True

    def _inserted(self, now: Instant, predicate: int, args: Args) -> None:
        """Apply the consequences of an insertion: discharge goals, then end jobs, then start jobs."""
        goals = self._any_goals
        if self._returning or predicate in self._shared.returns:
            # The fact was inserted before, with its consequences; it comes back to the rules alone.
            back = predicate if self._returning else self._shared.returns[predicate]
            if goals is not None and goals.open and back is not None:
                goals.fact_changed(back, args, holds=True)
            return
        if goals is not None and goals.open:
            goals.fact_changed(predicate, args, holds=True)
        if goals is not None and predicate in goals.open:
            achieved = goals.inserted(now, predicate, args)
            if achieved:
                self._events += achieved
                self._goals_changed(predicate)
                ended = [event.args for event in achieved]
                self._close(now, predicate, ended)
                self._end_served(now, predicate, ended, achieved=True)
        if predicate in self._affairs.asked:
            self._events += self._watches.inserted(now, predicate, args)
        if predicate in self._affairs.concerned:
            changed = self._assertions.inserted(now, predicate, args)
            self._events += changed
            if changed and self._urgency is not None:
                self._jobs_changed(self._urgency)

    def _jobs_changed(self, urgency: Urgency) -> None:
        """Note that jobs have started, restarted, finished or missed their deadlines."""
        urgency.renew(self._assertions.undecided())

    def _removed(self, now: Instant, predicate: int, args: Args, since: Instant) -> None:
        """Remember a removed fact if another robot's request for it may still arrive (`rmr.vm.watches`)."""
        if predicate in self._affairs.asked:
            self._watches.removed(now, predicate, args, since)

    def _want(self, now: Instant, predicate: int, args: GoalArgs) -> None:
        base = self._shared.withdrawals.get(predicate)
        if base is not None:
            gone = self._goals.withdraw(now, base, args)
            self._events += [GoalWithdrawn(base, values, now) for values in gone]
            self._goals_changed(base)
            self._close(now, base, gone)
            self._end_served(now, base, gone, achieved=False)
            return
        tracked = bool(self._purpose) or self._any_subgoals is not None
        was_open = tracked and self._goals.is_open(predicate, args)
        self._events += self._goals.want(now, predicate, args)
        if tracked and self._goals.is_open(predicate, args):
            self._subgoals.opened(goal_key(predicate, here(args, self.robot)), self._purpose, was_open)
        self._goals_changed(predicate)
        table = self._shared.goal_tables.get(predicate)
        if table is not None and self._goals.is_open(predicate, args):
            values = tuple([arg.value for arg in here(args, self.robot) if isinstance(arg, Constant)])
            if len(values) == len(args):  # a goal with a variable is no fact
                self._insert(now, table, values)

    def _close(self, now: Instant, predicate: int, gone: Iterable[tuple[object, ...]]) -> None:
        """Remove the facts that stand for goals which are no longer open."""
        table = self._shared.goal_tables.get(predicate)
        for values in gone if table is not None else ():
            if table is not None and ANY not in values:
                self._withdraw(now, table, values)  # type: ignore[arg-type]

    def _end_served(self, now: Instant, predicate: int, gone: Iterable[tuple[object, ...]], *, achieved: bool) -> None:
        """End what was done only for goals that are no longer open (`rmr.vm.subgoals`)."""
        if self._any_subgoals is None:
            return
        for event in self._any_subgoals.ended(now, predicate, gone, achieved=achieved):
            self._events.append(event)
            if isinstance(event, GoalWithdrawn):
                self._goals_changed(event.predicate)
                self._close(now, event.predicate, [event.args])

    def _act(
        self,
        now: Instant,
        predicate: int,
        executor: int,
        args: Args,
        then: Chain = (),
        origin: tuple[int, int] | None = None,
    ) -> None:
        """Report a derived action; its end is awaited if this robot executes it, or if steps follow."""
        # Without effects of its own or steps to derive, an action of another robot is sent and forgotten: serial 0.
        if then or executor == self.robot:
            under_way = self._any_actions or self._under_way
            action = under_way.begin(now, predicate, executor, args, then, origin)
            self._events.append(action)
            if self._purpose:
                self._subgoals.derived(action.serial, self._purpose)
        else:
            self._events.append(ActionDerived(0, predicate, executor, args, origin))

    def _take_effect(self, now: Instant, effect: Effect, checks: TypeChecks, action: ActionDerived) -> None:
        try:
            fact = evaluated(effect, [self.robot, *action.args], now, checks)
        except NoValue as reason:
            self._failures.report(now, f"effect of {self.program.predicates[action.predicate].name}", str(reason))
            return
        self._give(now, fact)

    def _miss(self, until: Instant) -> None:
        """Derive the violations of the deadlines up to `until`, each as of its own deadline, not of the call.

        A fact of one is inserted when all of these deadlines are over: it starts and finishes other jobs.
        """
        given: list[tuple[TimedJob, Derived]] = []
        missed = self._assertions.overdue(until)
        if missed and self._urgency is not None:
            self._jobs_changed(self._urgency)
        for job in missed:
            self._events.append(JobMissed(job))
            env: list[Value] = job.bindings  # type: ignore[assignment]
            try:
                item, checks = self._shared.violations[job.assertion]
                violation = evaluated(item, env, job.deadline, checks)
            except NoValue as reason:
                self._failures.report(job.deadline, f"violation of assertion {job.name}", str(reason))
                continue
            if violation.role is _FACT:
                given.append((job, violation))
            else:
                self._missed(job)
                self._act(job.deadline, violation.predicate, violation.owner, violation.args)
        for job, violation in given:
            self._missed(job)
            self._give(job.deadline, violation)

    def _missed(self, job: TimedJob) -> None:
        """Take note that what follows is the violation of `job`; it is for `ObservedMachine` alone."""
