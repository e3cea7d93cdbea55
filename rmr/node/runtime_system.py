"""The executive's runtime task: rules fire and actions go on until nothing more happens at this instant.

What one of them does may give the other work at once: an action that ends inserts a fact, which satisfies a rule, which
derives an action. So they run in rounds, to a fixed point, bounded by `ROUNDS_MAX`.

Deliveries take effect one at a time: each in a robot in which no rule is satisfied any more. Bounds keep a robot
responsive, and its deliveries from waiting for ever: once `FIRING_BUDGET` rules have fired in a call, those that are
left wait for the next one, and in a robot that never becomes quiet they take effect all the same.
"""

from typing import Final

from rmr.base.time import Instant
from rmr.node.actions.dispatcher import Dispatcher
from rmr.node.crossing.coordination_link import CoordLink
from rmr.node.crossing.crossings import Crossings
from rmr.node.logic.machine_runner import MachineRunner
from rmr.node.messenger import Messenger
from rmr.node.robot_state import RobotState
from rmr.vm.machine import FIRING_BUDGET

ROUNDS_MAX: Final = 64
"""Bound of the rounds in one call, and after each delivery: actions that end at once could repeat endlessly. The rest
waits for a frame."""


class RuntimeSystem:
    """Runs one robot's program, actions, crossings and coordination."""

    def __init__(
        self,
        state: RobotState,
        runner: MachineRunner,
        actions: Dispatcher,
        crossings: Crossings,
        coordination: CoordLink,
        messenger: Messenger,
    ) -> None:
        self._state = state
        self._machine = state.machine
        self._runner = runner
        self._actions = actions
        self._crossings = crossings
        self._coordination = coordination
        self._messenger = messenger

    def run(self, now: Instant) -> None:
        """Do what is to be done at `now`. Where others have only said where they are, that is nothing."""
        state = self._state
        if not (state.dirty or state.due or self._unforeseen(now)):
            return
        state.dirty = False
        state.reschedule = True
        self._rounds(now)
        self._runner.watch_quiescence(now)
        if self._messenger.shared.used:
            self._messenger.shared.look(now)
        if state.finish.update(now):
            state.trace(now, "finished")

    def _unforeseen(self, now: Instant) -> bool:
        """Return whether there is something to do that was not foreseen at the end of the last call."""
        machine = self._machine
        return machine.busy or self._messenger.waiting or self._coordination.due(now) or self._actions.released(now)

    def _rounds(self, now: Instant) -> None:
        """Do what is due, then let the deliveries that have arrived take effect, each when all is done before it."""
        messenger = self._messenger
        while messenger.waiting and self._runner.restless:
            messenger.take_up(now)
        machine = self._machine
        firings_max = machine.firings + FIRING_BUDGET
        rounds = 0
        more = machine.busy
        while rounds < ROUNDS_MAX:
            if not more and messenger.waiting:
                messenger.take_up(now)
                rounds = 0
            more = self._round(now)
            rounds += 1
            if not more and (not messenger.waiting or machine.busy or machine.firings >= firings_max):
                break

    def _round(self, now: Instant) -> bool:
        """Let each part do once what is due; return whether that has left more to do."""
        # A deadline at `now` is not missed before all deliveries of this instant have taken effect.
        last = not self._messenger.waiting
        machine = self._machine
        actions = self._actions
        self._coordinate(now)
        if machine.has_due(now):
            if machine.due == now:
                actions.resume(now)  # what ends at the very instant of a deadline is in time
            self._runner.run(now, last)
        actions.step(now)
        self._crossings.step(now)
        # Again, since actions and crossings have asked for slots: what the core says to that leaves in this call.
        self._coordinate(now)
        self._messenger.flush(now)
        more = machine.has_due(now) and (self._runner.settle(now) or self._runner.due(now, last))
        return more or actions.released(now)

    def _coordinate(self, now: Instant) -> None:
        if self._coordination.due(now):
            self._coordination.run(now)
