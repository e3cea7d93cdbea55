"""Handlers of users, with what they do to their robot logged step by step (`action_steps`).

A handler may read the world outside (the wall clock, a file) or change it (open a door), so a replay does not execute
it. Its robot handle is one over `RecordedServices`, which logs every call before it passes it on. Provided actions that
the handler awaits are part of the mind: of these, only begin, resumptions and end are logged.

This module is never compiled, like the modules of handlers (`rmr.node.actions.handle`).
"""

from collections.abc import Awaitable, Callable, Generator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from rmr.base.mistake import is_ctrl_c, words
from rmr.base.time import NEVER, Instant
from rmr.base.values import Value
from rmr.mind import action_steps as steps
from rmr.mind.fact_values import pack
from rmr.mind.mind_log import MindLog
from rmr.node.actions.dispatcher import Handler, failure_of, kind_of
from rmr.node.actions.handle import Pause
from rmr.node.actions.node_handle import NodeHandle
from rmr.vm.provenance import Cause


def recorded_handlers(handlers: Mapping[str, Handler], log: MindLog) -> Mapping[str, Handler]:
    """Return `handlers` with each one's steps logged."""
    numbers = ActionNumbers()
    return {name: replace(handler, run=RecordedRun(handler, numbers, log)) for name, handler in handlers.items()}


class ActionNumbers:
    """Numbers the actions of one incarnation."""

    def __init__(self) -> None:
        self._next = 0

    def take(self) -> int:
        """Return the next number."""
        self._next += 1
        return self._next - 1


class StepLog:
    """Logs the steps of one action."""

    def __init__(self, number: int, handler: Handler, log: MindLog) -> None:
        self.handler = handler
        self._number = number
        self._log = log
        self._steps = 0
        self.step_pause: Pause | None = None
        """The pause that a step has returned last."""
        self.paused_step = 0
        """The step that has returned it."""

    def add(self, code: str, *values: object) -> None:
        """Log a step."""
        self._log.acted(pack([code, self._number, *values]))

    def step(self, name: str, args: Sequence[object]) -> int:
        """Log that a provided action begins as a part of this one; return its number."""
        number = self._steps
        self._steps += 1
        self.add(steps.STEP, number, name, [steps.as_value(arg) for arg in args])
        return number

    def failed(self, code: str, error: BaseException) -> None:
        """Log that the handler, or its condition, has raised `error`."""
        failure, raised = failure_of(error, self.handler)
        self.add(code, failure, list(raised))

    def paused(self, awaited: object) -> object:
        """Log what the handler awaits; return it, with its condition logged if it has one of its own."""
        if not isinstance(awaited, Pause):
            self.add(steps.FOREIGN, kind_of(awaited))
            return awaited
        if awaited is self.step_pause:
            self.add(steps.STEP_PAUSE, self.paused_step)
            return awaited
        condition = awaited.condition
        self.add(steps.PAUSE, min(awaited.until, NEVER), condition is not None)
        return awaited if condition is None else Pause(awaited.until, self._asked(condition))

    def _asked(self, condition: Callable[[], bool]) -> Callable[[], bool]:
        """Return `condition`, logged when it becomes true or fails."""

        def asked() -> bool:
            try:
                holds = bool(condition())
            except BaseException as error:
                if is_ctrl_c(error):
                    raise
                self.failed(steps.CONDITION_FAILED, error)
                raise
            if holds:
                self.add(steps.TRUE)
            return holds

        return asked


class RecordedRun:
    """A handler's function that logs its steps."""

    def __init__(self, handler: Handler, numbers: ActionNumbers, log: MindLog) -> None:
        self._handler = handler
        self._numbers = numbers
        self._log = log

    @property
    def __code__(self) -> Any:
        """The code of the handler's own function, by which its file is known."""
        return self._handler.run.__code__

    def __call__(self, robot: NodeHandle, *args: Value) -> Awaitable[None]:
        """Begin the action."""
        log = StepLog(self._numbers.take(), self._handler, self._log)
        log.add(steps.RUN)
        own = NodeHandle(RecordedServices(robot, log), robot._action)
        try:
            begun = self._handler.run(own, *args)
            if not isinstance(begun, Awaitable):
                log.add(steps.NO_AWAITABLE)
                return begun
            coroutine = begun.__await__()
        except BaseException as error:
            if is_ctrl_c(error):
                raise
            log.failed(steps.FAILED, error)
            raise
        log.add(steps.BEGUN)
        return RecordedCoroutine(coroutine, log)


class RecordedCoroutine:
    """The coroutine of a handler, as the dispatcher uses it."""

    def __init__(self, coroutine: Generator[object, None, None], log: StepLog) -> None:
        self._coroutine = coroutine
        self._log = log

    def __await__(self) -> Any:
        return self

    def __next__(self) -> object:
        log = self._log
        log.add(steps.RESUME)
        try:
            awaited = next(self._coroutine)
        except StopIteration:
            log.add(steps.RETURN)
            raise
        except BaseException as error:
            if is_ctrl_c(error):
                raise
            log.failed(steps.FAILED, error)
            raise
        return log.paused(awaited)

    def close(self) -> None:
        """Break the handler off."""
        self._log.add(steps.CLOSE)
        try:
            self._coroutine.close()
        except BaseException as error:
            if is_ctrl_c(error):
                raise
            name = type(error).__name__
            self._log.add(steps.CLOSE_FAILED, name, words(error)[len(name) + 2 :])
            raise
        self._log.add(steps.CLOSED)


class RecordedServices:
    """What a handler may ask of its robot (`rmr.node.services`), logged where it does something."""

    def __init__(self, robot: NodeHandle, log: StepLog) -> None:
        self._robot = robot
        self._log = log

    def __getattr__(self, name: str) -> Any:
        return getattr(self._robot.node, name)

    @property
    def log(self) -> StepLog:
        """The log of the handler's steps."""
        return self._log

    def drive(self, v: float, w: float) -> None:
        """Drive by hand."""
        self._log.add(steps.DRIVE, v, w)
        self._robot._node.drive(v, w)

    def halt(self) -> None:
        """Stop the wheels."""
        self._log.add(steps.HALT)
        self._robot.node.halt()

    def insert(self, now: Instant, name: str, args: Sequence[Value], cause: Cause) -> None:
        """Insert a fact."""
        self._log.add(steps.INSERT, steps.as_value(name), [steps.as_value(arg) for arg in args])
        self._robot._node.insert(now, name, args, cause)

    def withdraw(self, now: Instant, name: str, args: Sequence[Value], cause: Cause) -> None:
        """Withdraw a sensed fact."""
        self._log.add(steps.WITHDRAW, steps.as_value(name), [steps.as_value(arg) for arg in args])
        self._robot._node.withdraw(now, name, args, cause)

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Note something in the trace."""
        self._log.add(steps.TRACE, what, list(fields), [steps.as_value(value) for value in fields.values()])
        self._robot.node.trace(now, what, **fields)

    def provided(self, action: str) -> Handler:
        """Return the handler of a provided action, which logs how it goes on; it gets the robot itself."""
        handler: Handler = self._robot._node.provided(action)

        def run(_: object, *args: Value) -> RecordedStep:
            return RecordedStep(action, args, handler.run(self._robot, *args), self._log)

        return replace(handler, run=run)


class RecordedStep:
    """A provided action that a handler awaits."""

    def __init__(self, name: str, args: Sequence[object], action: Awaitable[None], log: StepLog) -> None:
        self._log = log
        self._over = False
        self._number = log.step(name, args)
        self._coroutine = action.__await__()

    def __await__(self) -> Any:
        return self

    def __iter__(self) -> "RecordedStep":
        return self

    def __next__(self) -> object:
        self._log.add(steps.NEXT, self._number)
        return self._gone_on(lambda: next(self._coroutine))

    def throw(self, *error: Any) -> object:
        """Raise an exception where the action waits."""
        self._log.add(steps.THROW, self._number)
        return self._gone_on(lambda: self._coroutine.throw(*error))

    def _gone_on(self, go_on: Callable[[], object]) -> object:
        try:
            awaited = go_on()
        except BaseException:
            self._over = True
            raise
        if isinstance(awaited, Pause):
            self._log.step_pause = awaited
            self._log.paused_step = self._number
        return awaited

    def close(self) -> None:
        """Break the action off."""
        if not self._over:
            self._over = True
            self._log.add(steps.STOP, self._number)
            self._coroutine.close()

    def __del__(self) -> None:
        """Break it off, as Python does with a coroutine that nobody holds any more."""
        self.close()
