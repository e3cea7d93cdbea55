"""The executive's runtime task: rules fire and actions go on until nothing more happens at this instant.

What one of them does may give the other work at once: an action that ends inserts a fact, which satisfies a rule, which
derives an action. So they run in rounds, to a fixed point, bounded by `ROUNDS_MAX`.
"""

from typing import Final

from rmr.base.time import Instant
from rmr.node.actions.dispatcher import Dispatcher
from rmr.node.crossing.coordination_link import CoordLink
from rmr.node.crossing.crossings import Crossings
from rmr.node.logic.machine_runner import MachineRunner
from rmr.node.messenger import Messenger
from rmr.node.robot_state import RobotState

ROUNDS_MAX: Final = 64
"""Bound of the rounds in one call: actions that end at once could repeat endlessly. The rest waits for a frame."""


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
        for _ in range(ROUNDS_MAX):
            if not self._round(now):
                break
        self._runner.watch_quiescence(now)
        if state.finish.update(now):
            state.trace(now, "finished")

    def _unforeseen(self, now: Instant) -> bool:
        """Return whether there is something to do that was not foreseen at the end of the last call."""
        return self._machine.busy or self._coordination.due(now) or self._actions.released(now)

    def _round(self, now: Instant) -> bool:
        """Let each part do once what is due; return whether that has left more to do."""
        machine = self._machine
        actions = self._actions
        self._coordinate(now)
        if machine.has_due(now):
            if machine.due == now:
                actions.resume(now)  # what ends at the very instant of a deadline is in time
            self._runner.run(now)
        actions.step(now)
        self._crossings.step(now)
        # Again, since actions and crossings have asked for slots: what the core says to that leaves in this call.
        self._coordinate(now)
        self._messenger.flush(now)
        more = machine.has_due(now) and (self._runner.settle(now) or self._runner.due(now))
        return more or actions.released(now)

    def _coordinate(self, now: Instant) -> None:
        if self._coordination.due(now):
            self._coordination.run(now)
