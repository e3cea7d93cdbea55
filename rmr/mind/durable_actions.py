"""Handlers of users in a durable robot (`durable_node`).

While the robot goes on, a handler's steps are logged (`recorded_actions`). While it is brought back, they are done
again from the log (`replayed_actions`), and the handler is not executed. What a handler had in its variables is lost
with its process. So an action that was under way then is *interrupted*: it fails if the program declares what holds
when it fails (`else`), and else its handler is called again.

That a handler begins is on disk before it is called. One whose begin is not was never called.

This module is never compiled, like the modules of handlers (`rmr.node.actions.handle`).
"""

from collections.abc import Awaitable, Callable, Generator, Mapping
from dataclasses import replace
from typing import Any, cast

from rmr.base.values import Value
from rmr.bytecode.program import Program
from rmr.mind import action_steps as steps
from rmr.mind.kept_state import KeptRun, StateKeeper
from rmr.mind.mind_format import ACTED
from rmr.mind.mind_log import MindLog
from rmr.mind.recorded_actions import ActionNumbers, RecordedRun
from rmr.mind.replay_feed import ReplayFeed
from rmr.mind.replayed_actions import LOST, ReplayedAction
from rmr.node.actions.dispatcher import Handler, RunningAction
from rmr.node.actions.handle import ActionFailed, Pause
from rmr.node.actions.node_handle import NodeHandle


class DurableActions:
    """The users' handlers of one robot."""

    def __init__(self, program: Program, feed: ReplayFeed) -> None:
        self._program = program
        self._feed = feed
        self._numbers = ActionNumbers()
        self._kept = StateKeeper()
        self._log: MindLog | None = None
        self._commit: Callable[[], None] = lambda: None
        self.live = False
        """Whether handlers are executed; else their steps come from the log."""
        self.lives = 0
        """How often the robot has been started again."""
        self.acted = False
        """Whether a handler has done a step since this was last reset."""

    def join(self, log: MindLog, commit: Callable[[], None]) -> None:
        """Take the log, and what writes it to disk; before that no action begins."""
        self._log = log
        self._commit = commit

    def handlers(self, handlers: Mapping[str, Handler]) -> dict[str, Handler]:
        """Return `handlers` with each one's actions durable."""
        ordered = sorted(handlers.items())  # in whatever order the user's file has registered them
        return {name: replace(handler, run=DurableRun(self, handler)) for name, handler in ordered}

    def go_live(self, state: dict[str, Any]) -> None:
        """Execute handlers from now on; `state` is what they remember."""
        self._kept.go_on(state)
        for _ in range(self._feed.actions):
            self._numbers.take()
        self.live = True

    def interrupt(self, running: list[RunningAction]) -> None:
        """Interrupt those of the actions `running` that handlers of users carry out: the robot was started again."""
        self.lives += 1
        for each in running:
            if isinstance(each.coroutine, DurableAction):
                each.pause = Pause(0)

    def fails(self, action: str) -> bool:
        """Return whether the program declares what holds when `action` fails."""
        index = self._program.index(action)
        return index is not None and bool(self._program.predicates[index].else_effects)

    @property
    def calls_handler(self) -> bool:
        """Whether the handler of the action that begins now is called, or was, as far as the log says."""
        step = self._feed.peek(ACTED)
        return self.live or (step is not None and step[0] == steps.RUN and step[1] == self._feed.actions)

    def begin(self, handler: Handler, robot: NodeHandle, args: tuple[Value, ...]) -> Any:
        """Call a handler, or do its begin again from the log; return what it returned. Raises what it raised."""
        assert self._log is not None
        self.acted = True
        if self.live:
            run = _CommittedRun(handler.run, self._commit, self._kept)
            return RecordedRun(replace(handler, run=run), self._numbers, self._log)(robot, *args)
        action = ReplayedAction(self._feed.actions, self._feed, robot)
        self._feed.actions += 1
        return None if action.activation(steps.RUN)[0] == steps.NO_AWAITABLE else action


class _CommittedRun:
    """A handler's function that is called once its begin is on disk, and whose robot's state is kept."""

    def __init__(self, run: Callable[..., Awaitable[None]], commit: Callable[[], None], kept: StateKeeper) -> None:
        self._run = run
        self._commit = commit
        self._kept = kept

    @property
    def __code__(self) -> Any:
        """The code of the handler's own function, by which its file is known."""
        return self._run.__code__

    def __call__(self, robot: NodeHandle, *args: Any) -> Awaitable[None]:
        services: Any = robot.node
        self._commit()
        begun = self._run(robot, *args)
        if not isinstance(begun, Awaitable):
            return begun
        run: Any = KeptRun(begun, lambda: self._kept.log(services.state, services.log))
        return cast(Awaitable[None], run)


class DurableRun:
    """A handler's function whose actions outlive the process."""

    def __init__(self, owner: DurableActions, handler: Handler) -> None:
        self._owner = owner
        self._handler = handler

    @property
    def __code__(self) -> Any:
        """The code of the handler's own function, by which its file is known."""
        return self._handler.run.__code__

    def __call__(self, robot: NodeHandle, *args: Value) -> Awaitable[None]:
        """Begin the action."""
        begun: Awaitable[None] = DurableAction(self._owner, self._handler, robot, args).begun()
        return begun


class DurableAction:
    """One action: the coroutine that the dispatcher resumes."""

    def __init__(self, owner: DurableActions, handler: Handler, robot: NodeHandle, args: tuple[Value, ...]) -> None:
        self._owner = owner
        self._handler = handler
        self._robot = robot
        self._args = args
        self._life = owner.lives
        self._called = False
        """Whether the handler has been called."""
        self._coroutine: Any = None
        """None: the log ends before the handler is called, or before it goes on."""

    def begun(self) -> Any:
        """Call the handler; return this, or what it returned that cannot be awaited."""
        self._called = self._owner.calls_handler
        try:
            begun: object = self._owner.begin(self._handler, self._robot, self._args)
        except ActionFailed as error:
            if not _is_lost(error):
                raise
            return self
        if not isinstance(begun, Awaitable):
            return begun
        self._coroutine = begun.__await__()
        return self

    def __await__(self) -> Any:
        return self

    def __next__(self) -> object:
        self._owner.acted = True
        if self._life != self._owner.lives:
            self._life = self._owner.lives
            self._drop()
            if self._called and self._owner.fails(self._handler.name):
                # The failure of an action that was under way when the robot died.
                raise ActionFailed("interrupted: the robot was started again")
            begun = self.begun()
            if begun is not self:
                raise ActionFailed("its handler is no `async def`")
        if self._coroutine is None:
            return Pause()
        try:
            return next(self._coroutine)
        except ActionFailed as error:
            if not _is_lost(error):
                raise
            return Pause()

    def _drop(self) -> None:
        """Break off the provided actions that the handler awaited."""
        coroutine, self._coroutine = self._coroutine, None
        if isinstance(coroutine, ReplayedAction):
            coroutine.drop()

    def close(self) -> None:
        """Break it off."""
        self._owner.acted = True
        if self._life != self._owner.lives or self._coroutine is None:
            self._drop()
            return
        coroutine: Generator[object, None, None] = self._coroutine
        try:
            coroutine.close()
        except ActionFailed as error:
            if not _is_lost(error):
                raise


def _is_lost(error: ActionFailed) -> bool:
    """Return whether the log ends where a handler would go on."""
    return error.args == (LOST,)
