"""What an action's coroutine gets and awaits: the `robot` of an `async def`.

This module and `rmr.node.actions.built_in` are never compiled, so that a handler meets the same classes, and the same
messages, in both forms: a coroutine that mypyc has made differs from Python's when it is closed after its end, for
example.

A handle belongs to one action and is gone with it. What a robot shall remember from one action to the next stands in
`RobotHandle.state`, which lives as long as the robot's node: until its process ends, or another run begins.
"""

import math
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any, Protocol

from rmr.base.time import NEVER, NS_PER_MS, Instant, in_seconds, seconds
from rmr.base.values import Value
from rmr.vm.provenance import HandlerCause

if TYPE_CHECKING:
    from rmr.node.peers.perception import Percept

NOT_ASYNCIO = "an action awaits robot.sleep, robot.until and what else its robot offers, not {}"
"""The failure of an action that awaits something else."""


class ActionFailed(Exception):  # noqa: N818 - the name that users raise
    """Raise it in an action to make the declared `else` effect hold; the reason goes to the trace."""


class Pause:
    """What an action awaits: an instant, or a condition looked at whenever the robot runs."""

    __slots__ = ("condition", "until")

    def __init__(self, until: Instant = NEVER, condition: Callable[[], bool] | None = None) -> None:
        self.until = until
        self.condition = condition

    def __await__(self) -> Generator["Pause", None, None]:
        yield self

    def over(self, now: Instant) -> bool:
        """Return whether the action goes on at `now`."""
        return now >= self.until or (self.condition is not None and self.condition())


def pause_of(now: Instant, duration_s: float) -> Pause:
    """Return a pause of `duration_s` seconds, a millisecond at least, from `now`. Raises ValueError as `sleep` does."""
    if not 0.0 <= duration_s < math.inf:
        raise ValueError(f"cannot wait {duration_s} s; give a finite number of seconds, 0 or more")
    # A handler that sleeps for nothing again and again would keep its host from ever going on.
    return Pause(now + max(NS_PER_MS, seconds(duration_s)))


class HandledAction(Protocol):
    """The action to which a handle belongs."""

    serial: int
    """Its number, the cause of what its handler inserts and withdraws."""

    @property
    def name(self) -> str:
        """Its predicate's name."""

    @property
    def uses_wheels(self) -> bool:
        """Whether it drives."""


class RobotHandle:
    """What an action may do with its robot."""

    __slots__ = ("_node", "_now", "_running")

    def __init__(self, now: Callable[[], Instant], node: Any, running: HandledAction) -> None:
        self._now = now
        self._node = node
        self._running = running

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse what the next action would not find."""
        if name.startswith("_"):
            object.__setattr__(self, name, value)
            return
        raise AttributeError(f'robot.{name} cannot be set: keep it in robot.state["{name}"]')

    @property
    def id(self) -> int:
        """The robot's number."""
        return int(self._node.robot)

    @property
    def state(self) -> dict[str, Any]:
        """What the robot's actions remember: one dict for all of them, empty when the robot starts or restarts."""
        state: dict[str, Any] = self._node.state
        return state

    def now(self) -> float:
        """Return lab time in seconds."""
        return in_seconds(self._now())

    async def sleep(self, duration_s: float) -> None:
        """Wait `duration_s` seconds, a millisecond at least. Raises ValueError below 0 and for what is not finite."""
        await pause_of(self._now(), duration_s)

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait until `condition()` is true; it is looked at in each of the robot's frames."""
        if not condition():
            await Pause(condition=condition)

    # -- the provided actions as steps of a handler -----------------------------------------------------------

    async def moveto(self, area: str) -> None:
        """Drive to `area`, as the action `moveto` does. Raises ActionFailed if it cannot."""
        await self._perform("moveto", area)

    async def lineup(self, area: str, place: int) -> None:
        """Drive to the `place`-th place, from 1, of the queue of `area`, as the action `lineup` does."""
        await self._perform("lineup", area, place)

    async def goto(self, x: float, y: float) -> None:
        """Drive to a point of the floor, metres. Raises ActionFailed if it cannot."""
        await self._perform("goto", x, y)

    async def reach(self, x: float, y: float, begins_s: float, ends_s: float) -> None:
        """Drive straight to a point, metres, from one instant of lab time to another, seconds."""
        await self._perform("reach", x, y, begins_s, ends_s)

    async def face(self, degrees: float) -> None:
        """Turn to a heading, degrees counter-clockwise from the x axis."""
        await self._perform("face", degrees)

    async def wait(self, duration_s: float) -> None:
        """Let time pass, seconds: the same as `sleep`."""
        await self.sleep(duration_s)

    async def _perform(self, name: str, *args: Value) -> None:
        """Carry out a provided action as a part of this one, without its effects."""
        provided = self._node.provided(name)
        own = self._running
        if provided.wheels and not own.uses_wheels:
            raise ActionFailed(f'robot.{name} drives: declare the handler with @action("{own.name}", wheels=True)')
        await provided.run(self, *args)

    # -- what takes no time -----------------------------------------------------------------------------------

    def drive(self, v: float, w: float) -> None:
        """Drive at `v` m/s, turning at `w` rad/s, until told otherwise. Declare the action with `wheels=True`.

        Raises ValueError for what is no finite number.
        """
        if not (math.isfinite(v) and math.isfinite(w)):
            raise ValueError(f"cannot drive at {v} m/s and {w} rad/s")
        self._node.drive(float(v), float(w))

    def stop(self) -> None:
        """Stop the wheels."""
        self._node.halt()

    def sense(self) -> "Percept":
        """Return the newest percept: pose, bodies in view, whether the hull touches anything."""
        percept: Percept = self._node.percept()
        return percept

    def insert(self, predicate: str, *args: Value) -> None:
        """Insert a fact of this robot: ``robot.insert("seen", 3)``. Raises ValueError when it does not fit."""
        self._node.insert(self._now(), predicate, args, HandlerCause(self._running.serial))

    def withdraw(self, predicate: str, *args: Value) -> None:
        """Withdraw a sensed fact of this robot, one of a predicate that the program declares with ``type sensor``.

        Nothing happens if it does not hold. Raises ValueError when it does not fit, or the robot itself senses it.
        """
        self._node.withdraw(self._now(), predicate, args, HandlerCause(self._running.serial))

    def say(self, text: str) -> None:
        """Write `text` into the robot's trace."""
        self._node.trace(self._now(), "said", text=str(text))
