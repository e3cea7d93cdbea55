"""The runtime system's part of a robot: it runs the machine and sees that whatever the machine reports happens.

Facts, goals and news for other robots go to the deliveries, actions to the dispatcher or to their executors, jobs to
the crossings, and everything into the trace. An action that has ended brings its effects, wakes the chain of steps that
waits for it, and is reported to the robot that derived it.
"""

from collections.abc import Callable
from typing import Final

from rmr.base.time import Instant, in_seconds
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Effect, Kind
from rmr.node.actions.action_log import ActionEnded, ActionHeld
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Dispatcher, Handler, RunningAction
from rmr.node.crossing.crossings import Crossings
from rmr.node.logic.deliveries import Deliveries
from rmr.node.robot_state import RobotState
from rmr.node.trace import TraceLevel, fact_text, goal_text, rule_text
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.machine_events import (
    ActionCancelled,
    ActionDerived,
    BoundReached,
    ExpressionFailed,
    FactInserted,
    FactRemoved,
    FactSent,
    FinishAwaited,
    FinishSeen,
    GoalAchieved,
    GoalSent,
    GoalWithdrawn,
    JobFinished,
    JobMissed,
    JobStarted,
    RuleFired,
    RuleRepeats,
    VmEvent,
)
from rmr.vm.provenance import EffectCause
from rmr.vm.store import Args

RESTLESS_CALLS: Final = 60
"""Calls in a row after which a program that still has satisfied rules counts as one that never becomes quiet."""


class MachineRunner:
    """Runs one robot's machine and carries out what it reports."""

    def __init__(
        self,
        state: RobotState,
        deliveries: Deliveries,
        crossings: Crossings,
        actions: Dispatcher,
        handler: Callable[[str], Handler],
    ) -> None:
        """`handler` returns what carries out an action."""
        self._state = state
        self._robot = state.robot
        self._program = state.program
        self._machine = state.machine
        self._deliveries = deliveries
        self._crossings = crossings
        self._actions = actions
        self._handler = handler
        self._overrun = False
        """The last run used up its budget of firings: the rest waits for the next frame."""
        self._restless_calls = 0
        self._restless_noted = False
        self.expression_failures = 0
        """Supposed effects without value."""
        self.achieved = 0
        """Goals discharged."""

    def follow(self, other: "MachineRunner") -> None:
        """Go on with the counters of another program's runner."""
        self.expression_failures = other.expression_failures + other._machine.expression_failures
        self.achieved = other.achieved

    def run(self, now: Instant, last: bool) -> None:
        """Let the machine deal with what is due, and what it reports happen; see `Machine.run` on `last`."""
        machine = self._machine
        if machine.busy or machine.due <= now:
            machine.run(now, last)
            self._overrun = machine.busy
        if machine.has_news:
            self.settle(now)

    def settle(self, now: Instant) -> bool:
        """Let happen what the machine has reported since; return whether it had anything to report."""
        had_news = False
        while self._machine.has_news:
            events = self._machine.drain()
            had_news = True
            missed: int | None = None
            actions: list[tuple[ActionDerived | ActionCancelled, int | None]] = []
            for event in events:
                self._state.tell(event)
                if isinstance(event, RuleFired):
                    self._derive(now, actions)
                if isinstance(event, ActionDerived | ActionCancelled):
                    actions.append((event, missed))
                else:
                    self._happened(now, event)
                missed = event.job.assertion if isinstance(event, JobMissed) else None
            self._derive(now, actions)
        return had_news

    def _derive(self, now: Instant, actions: list[tuple[ActionDerived | ActionCancelled, int | None]]) -> None:
        """Take up the actions of one firing, after its facts: a job that these start holds back what serves it."""
        for event, missed in actions:
            if isinstance(event, ActionDerived):
                self._derived(now, event, missed)
            else:
                self._cancelled(now, event)
        actions.clear()

    def due(self, now: Instant, last: bool) -> bool:
        """Return whether another `run` at this very instant has something to do."""
        return not self._overrun and (self._machine.busy or (last and self._machine.due <= now))

    @property
    def restless(self) -> bool:
        """Whether the program counts as one that never becomes quiet, until it does."""
        return self._restless_calls >= RESTLESS_CALLS

    def watch_quiescence(self, now: Instant) -> None:
        """Tell once of a program that never becomes quiet; it goes on within its budget of firings a call."""
        self._restless_calls = self._restless_calls + 1 if self._machine.busy else 0
        if self._restless_calls == RESTLESS_CALLS and not self._restless_noted:
            self._restless_noted = True
            self._state.trace(now, "restless", firings=self._machine.firings)

    # -- what the machine reports -----------------------------------------------------------------------------

    def _happened(self, now: Instant, event: VmEvent) -> None:
        match event:
            case RuleFired(rule=rule):
                if not self._restless_calls or self._state.notes.level >= TraceLevel.FIRINGS:
                    self._state.trace(now, "fired", rule=rule_text(self._program, rule))
            case FactSent() | GoalSent() | FinishAwaited() | FinishSeen():
                self._deliveries.send(now, event)
            case JobStarted(job=job):
                self._state.trace(now, "job_started", job=job.text, deadline_s=in_seconds(job.deadline))
                self._crossings.started(now, job)
            case JobFinished(job=job):
                self._deliveries.finished(job)
                self._state.trace(now, "job_finished", job=job.text)
                self._crossings.finished(now, job)
            case JobMissed(job=job):
                self._deliveries.missed(now, job)
                self._state.trace(now, "deadline_missed", job=job.text)
            case GoalAchieved(predicate=predicate, args=args):
                self.achieved += 1
                self._state.trace(now, "achieved", goal=goal_text(self._program, predicate, self._robot, args))
            case GoalWithdrawn(predicate=predicate, args=args):
                self._state.trace(now, "unwanted", goal=goal_text(self._program, predicate, self._robot, args))
            case FactInserted() | FactRemoved() | ExpressionFailed() | RuleRepeats() | BoundReached():
                self._noted(now, event)
            case ActionDerived() | ActionCancelled():
                raise AssertionError("actions are derived and cancelled when all else has happened")

    def _noted(
        self, now: Instant, event: FactInserted | FactRemoved | ExpressionFailed | RuleRepeats | BoundReached
    ) -> None:
        """Record events that only the trace needs."""
        match event:
            case FactInserted(predicate=predicate, args=args):
                self._state.trace(now, "inserted", fact=fact_text(self._program, predicate, self._robot, args))
            case FactRemoved(predicate=predicate, args=args):
                self._state.trace(now, "removed", fact=fact_text(self._program, predicate, self._robot, args))
            case ExpressionFailed(where=where, reason=reason):
                self._state.trace(now, "expression_failed", where=where, reason=reason)
            case RuleRepeats(rule=rule, firings=firings):
                self._state.trace(now, "repeats", rule=rule_text(self._program, rule), firings=firings)
            case BoundReached(what=what, bound=bound):
                self._state.trace(now, "bound_reached", kept=what, bound=bound)

    def _derived(self, now: Instant, event: ActionDerived, missed: int | None) -> None:
        if event.executor != self._robot:
            self._deliveries.send_action(now, event)
            return
        name = self._program.predicates[event.predicate].name
        jobs = self._machine.serves(event.predicate, event.args)
        then = self._machine.steps_after(event.serial)
        live = self._machine.live_jobs()
        permit = self._crossings.permit(now, jobs, live, event, then)
        handler = self._handler(name)
        running = RunningAction(event.serial, name, event.args, handler, permit, now, missed, event.origin)
        self._crossings.action_derived(running)
        if self._program.assertions:
            self._state.action_log.steps.derived(self._program, running, event.predicate, live)
        crossing = self._crossings.crossing(running)
        if crossing is not None and running.held(now):
            self._state.tell(ActionHeld(event.serial, crossing.told))
        self._actions.derive(now, running)

    def _cancelled(self, now: Instant, event: ActionCancelled) -> None:
        action = fact_text(self._program, event.predicate, self._robot, event.args)
        predicate, args = event.served
        goal = goal_text(self._program, predicate, self._robot, args)
        self._state.trace(now, "cancelled", action=action, goal=goal)
        self._actions.cancel(now, event.serial)

    # -- ends of actions --------------------------------------------------------------------------------------

    def ended(self, now: Instant, running: RunningAction, failure: str | None) -> None:
        """Apply the effects of an action's end, and report it to the robots that wait for it."""
        running.ended = now
        action = self._program.index(running.name)
        assert action is not None, running.name
        if failure is None:
            failure = self._handlers_effect(now, running, action)
        # A provided action fails as the floor makes it; the failure of a handler of the user's own is a defect, or
        # something that the program has to know.
        provided = running.handler is PROVIDED.get(running.name)
        handled = provided or bool(self._program.predicates[action].else_effects)
        text = running.text(self._robot)
        event = ActionEnded(running.serial, text, failure, handled)
        self._state.tell(event)
        if running.raised:
            self._state.trace(now, "raised", action=text, traceback=list(running.raised))
        self._crossings.action_ended(now, running, failed=failure is not None)
        if self._state.driver is None:
            predicate = self._program.predicates[action]
            effects = predicate.effects if failure is None else predicate.else_effects
            self._suppose(now, effects, running.args, EffectCause(running.serial, failure is None))
        self._machine.complete(now, running.serial, failure is None)
        if running.origin is not None:
            self._deliveries.report_end(now, running.origin, action, event)

    def _handlers_effect(self, now: Instant, running: RunningAction, action: int) -> str | None:
        """Insert the effect that the handler names if the program declares none; return why it does not fit.

        As with declared effects, a sensed fact is left to the senses. An unknown effect is ignored.
        """
        program = self._program
        name = running.handler.effect
        effect = None if name is None else program.index(name)
        if effect is None or program.predicates[action].effects:
            return None
        if program.predicates[effect].kind is not Kind.SENSED:
            try:
                self._machine.insert(now, effect, running.args, EffectCause(running.serial, True))
            except ValueError as error:
                return f"its effect does not fit: {error}"
        return None

    def _suppose(self, now: Instant, effects: tuple[Effect, ...], args: Args, cause: EffectCause) -> None:
        """Replace sensed facts by the effects on their predicates: a robot without a body has no sense that would."""
        env: list[Value] = [Robot(self._robot), *args]
        supposed: dict[int, tuple[list[Args], list[Args]]] = {}
        for effect in effects:
            predicate = self._program.predicates[effect.predicate]
            if predicate.kind is not Kind.SENSED:
                continue
            try:
                before = self._machine.held(effect.predicate)
                values = tuple([evaluate(code, env, now) for code in effect.args])
                self._machine.insert(now, effect.predicate, values, cause)
            except (NoValue, ValueError) as reason:
                self.expression_failures += 1
                where = f"effect on {predicate.name}"
                self._state.trace(now, "expression_failed", where=where, reason=str(reason))
            else:
                supposed.setdefault(effect.predicate, (before, []))[1].append(values)
        for index, (before, wanted) in supposed.items():
            for held in before:
                if held not in wanted:
                    self._machine.withdraw(now, index, held, cause)
