"""Actions under way, and the chains of steps that wait for their ends (``a(R) then b(R)``).

The robot awaits the end of each action that it executes, for its effects, and of each that a step follows,
whoever executes it. An action has a serial by which its end is reported; one of another robot has it on the
robot that derived it, and its executor learns it as the action's origin. Both tables are bounded: an end that
never comes, because the executor is gone, costs the place of one entry and no more.
"""

from typing import NamedTuple

from rmr.base.time import Instant
from rmr.base.values import Robot
from rmr.vm.bounds import Dropped
from rmr.vm.derive import Chain
from rmr.vm.machine_events import ActionDerived, Args

ACTIONS_MAX = 1024
"""Actions of which the end is awaited; beyond that the oldest are forgotten."""

CHAINS_MAX = 256
"""Chains that wait for an action's end; beyond that the oldest is dropped. Each holds up to a whole head."""


class Awaited(NamedTuple):
    """An action of which the end is awaited."""

    action: ActionDerived
    then: Chain
    """The steps behind it."""


class UnderWay:
    """The actions that one robot awaits."""

    __slots__ = ("_actions", "_chains", "_dropped", "_forgotten", "_robot", "_serial")

    def __init__(self, robot: Robot, dropped: Dropped) -> None:
        self._robot = robot
        self._dropped = dropped
        self._serial = 0
        self._forgotten = 0
        """The serial of the last action that was forgotten: those that are awaited are younger."""
        self._actions: dict[int, ActionDerived] = {}
        self._chains: dict[int, Chain] = {}

    def begin(
        self,
        now: Instant,
        predicate: int,
        executor: int,
        args: Args,
        then: Chain = (),
        origin: tuple[int, int] | None = None,
    ) -> ActionDerived:
        """Return the report of an action which this robot executes, or behind which there are steps."""
        actions = self._actions
        if len(actions) >= ACTIONS_MAX or (then and len(self._chains) >= CHAINS_MAX):
            self._make_room(now, bool(then))
        self._serial = serial = self._serial + 1
        actions[serial] = action = ActionDerived(serial, predicate, executor, args, origin)
        if then:
            self._chains[serial] = then
        return action

    def end(self, serial: int, executor: int | None) -> Awaited | None:
        """Take out an action that has ended; None if it is not awaited, or not from `executor` (None: anybody)."""
        action = self._actions.get(serial)
        if action is None or executor not in (None, action.executor):
            return None
        del self._actions[serial]
        return Awaited(action, self._chains.pop(serial, ()))

    def _make_room(self, now: Instant, chained: bool) -> None:
        """Forget the oldest action, or drop the oldest chain, where another one would be too many."""
        if len(self._actions) >= ACTIONS_MAX:
            oldest = self._forgotten + 1
            if oldest not in self._actions:  # seldom: to find its first a dictionary passes over all that have gone
                oldest = next(iter(self._actions))
            self._forgotten = oldest
            del self._actions[oldest]
            self._chains.pop(oldest, None)
            self._dropped.add("actions", ACTIONS_MAX, now)
        if chained and len(self._chains) >= CHAINS_MAX:
            oldest = next(iter(self._chains))
            del self._chains[oldest]
            self._dropped.add("chains", CHAINS_MAX, now)
            if self._actions[oldest].executor != self._robot:
                del self._actions[oldest]  # awaited for nothing else
