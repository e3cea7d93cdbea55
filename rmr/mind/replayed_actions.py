"""Handlers of users in a replay: they are not executed; what they did to their robot is done again from the log."""

from collections.abc import Awaitable, Callable, Generator, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from rmr.base.values import Value
from rmr.mind import action_steps as steps
from rmr.mind.kept_state import replace_state
from rmr.mind.replay_feed import ReplayFeed
from rmr.node.actions.dispatcher import Handler
from rmr.node.actions.handle import ActionFailed, Pause
from rmr.node.actions.node_handle import NodeHandle
from rmr.vm.provenance import HandlerCause

LOST = "the log does not say how the handler goes on"
"""The failure of an action that goes on in a replay and not in the recording."""


def replayed_handlers(actions: Iterable[Handler], feed: ReplayFeed) -> dict[str, Handler]:
    """Return a handler for each of `actions` whose steps come from `feed`."""
    run = partial(_run, feed)
    return {each.name: replace(each, run=run) for each in actions}


def _run(feed: ReplayFeed, robot: NodeHandle, *_: Value) -> Awaitable[None]:
    """Begin an action."""
    action = ReplayedAction(feed.actions, feed, robot)
    feed.actions += 1
    if action.activation(steps.RUN)[0] == steps.NO_AWAITABLE:
        return None  # type: ignore[return-value]
    return action


class ReplayedAction:
    """One action: the coroutine that the dispatcher resumes."""

    def __init__(self, number: int, feed: ReplayFeed, robot: NodeHandle) -> None:
        self._number = number
        self._feed = feed
        self._robot = robot
        self._steps: dict[int, Generator[Any, None, None]] = {}
        self._pauses: dict[int, Pause] = {}
        """The last pause of each step."""

    def __await__(self) -> Any:
        return self

    def __next__(self) -> object:
        code, _, *values = self.activation(steps.RESUME)
        if code == steps.RETURN:
            raise StopIteration
        if code == steps.STEP_PAUSE:
            return self._pauses.get(values[0], Pause())
        if code == steps.FOREIGN:
            return None if values[0] == "asyncio" else type(values[0], (), {})()
        until, conditioned = values
        return Pause(until, self._condition if conditioned else None)

    def drop(self) -> None:
        """Break off the provided actions that it awaits; the log has nothing more of it."""
        for step in self._steps.values():
            with suppress(Exception):
                step.close()

    def close(self) -> None:
        """Break it off."""
        code, _, *values = self.activation(steps.CLOSE)
        if code == steps.CLOSE_FAILED:
            name, text = values
            raise type(name, (Exception,), {})(text)

    def activation(self, begin: str) -> Any:
        """Do again what the handler did in one activation; return the step at its end. Raises ActionFailed."""
        feed = self._feed
        if feed.acted(self._number, (begin,)) is None:
            raise ActionFailed(LOST)
        while (step := feed.acted(self._number)) is not None:
            if step[0] in steps.ENDS:
                if step[0] == steps.FAILED:
                    self._fail(*step[2:])
                return step
            self._do(*step)
        raise ActionFailed(LOST)

    def _condition(self) -> bool:
        """Return whether the handler's condition is true now."""
        while (step := self._feed.acted(self._number, steps.DONE)) is not None:
            self._do(*step)
        if self._feed.acted(self._number, (steps.TRUE,)) is not None:
            return True
        failed = self._feed.acted(self._number, (steps.CONDITION_FAILED,))
        if failed is not None:
            self._fail(*failed[2:])
        return False

    def _fail(self, failure: str, raised: tuple[str, ...]) -> None:
        self._robot._action.raised = raised
        raise ActionFailed(failure)

    def _do(self, code: str, _: int, *values: Any) -> None:
        """Do one thing to the robot. What it raises has gone to the handler, and the next steps say what that did."""
        node = self._robot._node
        cause = HandlerCause(self._robot._action.serial)
        calls: dict[str, Callable[..., object]] = {
            steps.DRIVE: node.drive,
            steps.HALT: node.halt,
            steps.INSERT: lambda name, args: node.insert(node.now, name, args, cause),
            steps.WITHDRAW: lambda name, args: node.withdraw(node.now, name, args, cause),
            steps.TRACE: lambda what, names, given: node.trace(node.now, what, **dict(zip(names, given, strict=True))),
            steps.STEP: self._begin_step,
            steps.NEXT: lambda step: self._go_on(step, next),
            steps.THROW: lambda step: self._go_on(step, lambda coroutine: coroutine.throw(ActionFailed(LOST))),
            steps.STOP: lambda step: self._steps[step].close(),
            steps.STATE: lambda packed: replace_state(node.state, packed),
        }
        with suppress(Exception, SystemExit, StopIteration):
            calls[code](*values)

    def _begin_step(self, step: int, name: str, args: tuple[Value, ...]) -> None:
        self._steps[step] = self._robot._node.provided(name).run(self._robot, *args).__await__()

    def _go_on(self, step: int, go_on: Callable[[Generator[Any, None, None]], Any]) -> None:
        self._pauses[step] = go_on(self._steps[step])
