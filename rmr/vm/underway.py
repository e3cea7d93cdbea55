"""Actions under way, and the chains of steps that wait for their ends (``a(R) then b(R)``).

A robot awaits the end of each action that it executes, because of the effects, and of each action with a following
step, whichever robot is its executor. The end of an action is reported with its serial. The serial belongs to the robot
that derived the action; another executor knows it as the action's origin. Both tables are bounded: an end that never
comes, because the executor is gone, occupies one entry.
"""

from typing import NamedTuple

from rmr.base.time import Instant
from rmr.base.values import Robot
from rmr.vm.bounds import Dropped
from rmr.vm.derive import Chain
from rmr.vm.machine_events import ActionDerived
from rmr.vm.store import Args

ACTIONS_MAX = 1024
"""Actions whose end is awaited; beyond that the oldest one is forgotten."""

CHAINS_MAX = 256
"""Chains that wait for an action's end; beyond that the oldest one is dropped. A chain may be as long as a head."""


class Awaited(NamedTuple):
    """An action whose end is awaited."""

    action: ActionDerived
    then: Chain
    """The steps that follow it."""


class UnderWay:
    """The actions that one robot awaits."""

    __slots__ = ("_actions", "_chains", "_dropped", "_forgotten", "_robot", "_serial")

    def __init__(self, robot: Robot, dropped: Dropped) -> None:
        self._robot = robot
        self._dropped = dropped
        self._serial = 0
        self._forgotten = 0
        """Serial of the last action that was forgotten: all awaited actions have a greater one."""
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
        """Return the event of an action that this robot executes, or that steps follow."""
        actions = self._actions
        if len(actions) >= ACTIONS_MAX or (then and len(self._chains) >= CHAINS_MAX):
            self._make_room(now, bool(then))
        self._serial = serial = self._serial + 1
        actions[serial] = action = ActionDerived(serial, predicate, executor, args, origin)
        if then:
            self._chains[serial] = then
        return action

    def end(self, serial: int, executor: int | None) -> Awaited | None:
        """Remove and return an action that has ended; None if it is not awaited, or `executor` does not execute it.

        An `executor` of None passes every action.
        """
        action = self._actions.get(serial)
        if action is None or executor not in (None, action.executor):
            return None
        del self._actions[serial]
        return Awaited(action, self._chains.pop(serial, ()))

    def steps_after(self, serial: int) -> Chain:
        """Return the later steps of the chain in which an action is a step."""
        return self._chains.get(serial, ())

    def awaited(self, serial: int) -> ActionDerived | None:
        """Return the action of a serial number; None if its end is not awaited."""
        return self._actions.get(serial)

    def cancel(self, serial: int) -> ActionDerived | None:
        """Drop the steps that follow an action; return it if this robot executes it and its end is awaited."""
        action = self._actions.get(serial)
        if action is None:
            return None
        self._chains.pop(serial, None)
        if action.executor != self._robot:
            del self._actions[serial]  # it was awaited for its chain alone
            return None
        return action

    def _make_room(self, now: Instant, chained: bool) -> None:
        """Forget the oldest action, or drop the oldest chain, where another one would be too many."""
        if len(self._actions) >= ACTIONS_MAX:
            oldest = self._forgotten + 1
            if oldest not in self._actions:  # rare: finding the first key of a dict skips all deleted entries before it
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
                del self._actions[oldest]  # it was awaited for its chain alone
