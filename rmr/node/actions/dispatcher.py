"""Actions: what a derived action makes the robot do, and the order in which they run (paper III.C, figure 5).

An action is a coroutine over a `RobotHandle`; those that rmr provides are written the same way as a user's
own. They are not asyncio coroutines: each `await` hands a `Pause` to the dispatcher, which resumes the action at
the first call at which the pause is over, so that actions run in virtual time as they do in a process.

Rules. An action that uses the wheels waits until the wheels are free, first come first served; `stop` does not
wait. An action that serves a time assertion's job is held back until the job's turn (`rmr.node.crossing`), and
does not keep others from the wheels meanwhile; if its slot moves away before it has begun, it is held again.
Completion inserts the declared effects, `ActionFailed` the `else` effects.
"""

from collections import deque
from collections.abc import Awaitable, Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from rmr.base.mistake import frames, is_ctrl_c, place_in, words
from rmr.base.printable import one_line
from rmr.base.time import NEVER, Duration, Instant
from rmr.base.values import Robot, Value, format_fact
from rmr.bytecode.program import Kind, Program
from rmr.node.actions.handle import NOT_ASYNCIO, ActionFailed, Pause, RobotHandle
from rmr.vm.job import TimedJob

__all__ = ["ActionFailed", "Dispatcher", "Handler", "Pause", "RobotHandle", "RunningAction", "action"]

RUNNING_MAX: Final = 1024
"""Actions under way or waiting at one robot, as many as the machine awaits; a program that derives more is broken."""

STOPPED: Final = "stopped"
"""The failure of an action that `stop` has interrupted."""
TAKEN_OVER: Final = "taken over by a later one"
"""The failure of an action that a later one of its name has replaced."""
NEW_PROGRAM: Final = "a new program"
"""The failure of an action under way when the robot changes its program; it begins again if that declares it, too."""
CANCELLED: Final = "cancelled"
"""The failure of an action that serves no open goal any more."""
INTERRUPTED: Final = (STOPPED, TAKEN_OVER, NEW_PROGRAM, CANCELLED)
"""Failures that the program has brought about, and that are no faults."""
FAILURE_CHARACTERS_MAX: Final = 500
"""Length of an action's reason of failure, which a user's handler may have written; the rest is cut off."""


class MissingHandlers(ValueError):  # noqa: N818 - reads as what it is
    """The program declares actions that nothing carries out; the message says which, where, and what to do."""


@dataclass(frozen=True, slots=True)
class Handler:
    """How an action is carried out."""

    name: str
    run: Callable[..., Awaitable[None]]
    """Called with the robot's handle and the action's arguments without the executor."""
    effect: str | None = None
    """The predicate inserted, with the same arguments, when the program declares no effect."""
    wheels: bool = False  # whether it uses them
    takes_over: bool = False
    """Whether a later one takes the wheels from an earlier one of the same name, which then fails."""
    at_once: bool = False
    """Whether it interrupts what the wheels do instead of waiting (`stop`)."""
    to_area: bool = False
    """Whether it drives to the area that it names (`moveto`): its turn may then be a passage of the bottleneck."""
    takes: Duration | None = None  # how long, where that is known beforehand


_registered: dict[str, Handler] = {}


def action(
    name: str, effect: str | None = None, *, wheels: bool = False
) -> Callable[[Callable[..., Awaitable[None]]], Callable[..., Awaitable[None]]]:
    """Register an `async def` as the handler of action `name`.

    `effect` names a fact that its completion inserts, with the action's arguments, when the program declares no
    effect. Set `wheels` when it drives, so that it waits for other driving actions.
    """

    def register(run: Callable[..., Awaitable[None]]) -> Callable[..., Awaitable[None]]:
        _registered[name] = Handler(name, run, effect, wheels)
        return run

    return register


def check_handlers(program: Program, handlers: Mapping[str, Handler]) -> None:
    """Raise MissingHandlers if `program` declares actions that none of `handlers` carries out."""
    missing = [i for i, p in enumerate(program.predicates) if p.kind is Kind.ACTION and p.name not in handlers]
    if missing:
        listed = "; ".join(program.predicates[index].name + _declared(program, index) for index in missing)
        first = program.predicates[missing[0]].name
        raise MissingHandlers(
            f"no handler for action {listed} (give one with actions: FILE.py in the lab file, or --actions FILE.py: "
            f'@action("{first}"))'
        )


def _declared(program: Program, index: int) -> str:
    if program.debug is None or index >= len(program.debug.predicates):
        return ""
    place = program.debug.predicates[index]
    return f", declared at {place.file}:{place.line}:{place.column}"


def registered() -> dict[str, Handler]:
    """Return the handlers registered so far by `action`, by name."""
    return dict(_registered)


class Permit(Protocol):
    """What an action that serves a job waits for: the job's crossing of a shared resource."""

    rank: int
    """The robot's place in the schedule, from 1; 0 without one."""
    place: int
    """Its place among those that go the same direction."""

    @property
    def waits(self) -> bool:
        """Whether the robot may not enter the resource yet."""

    def released(self, now: Instant) -> bool:
        """Return whether the action may begin."""


@dataclass(slots=True, eq=False)
class RunningAction:
    """One derived action, waiting or under way."""

    serial: int
    name: str
    args: tuple[Value, ...]
    handler: Handler
    permit: Permit | None = None  # None: it serves no job and need not wait
    derived: Instant = 0
    missed: int | None = None  # the assertion whose missed deadline derived it
    origin: tuple[int, int] | None = None  # a robot that waits for its end, and the number by which that knows it
    admitted: Instant | None = None  # to the wheels' queue, or to its beginning: it waits for no permit
    started: Instant | None = None
    ended: Instant | None = None
    coroutine: Generator[object, None, None] | None = None
    """None: it has not begun, or has come to its end by itself. A coroutine that has ended is not touched again."""
    pause: Pause = field(default_factory=lambda: Pause(0))
    over: bool = False
    gate: Permit | None = None  # its turn at a passage on its way, if that is not its permit
    job: TimedJob | None = None  # the one that its permit is of
    due: Instant = NEVER  # by when it has to end, so that the later steps of that job have their time
    behind: tuple[int, ...] = ()  # the robots that had the resource while it waited, in their order
    raised: tuple[str, ...] = ()  # the lines of the traceback, if its handler raised anything but ActionFailed

    def held(self, now: Instant) -> bool:
        """Return whether the action has to wait for its permit."""
        return self.permit is not None and not self.permit.released(now)

    @property
    def uses_wheels(self) -> bool:
        """Whether it drives."""
        return self.handler.wheels

    def text(self, robot: int) -> str:
        """Return the action in program syntax."""
        return format_fact(self.name, (Robot(robot), *self.args))


class Host(Protocol):
    """What the dispatcher asks of its node."""

    def action_ended(self, now: Instant, running: RunningAction, failure: str | None) -> None:
        """Handle the end of an action; `failure` is the reason, None when it completed."""

    def handle(self, running: RunningAction) -> Any:
        """Return the handle that the action's coroutine gets."""

    def halt(self) -> None:
        """Stop the wheels."""


class Dispatcher:
    """Runs one robot's actions."""

    def __init__(self, host: Host) -> None:
        self._host = host
        self.held: list[RunningAction] = []
        """Waiting for their turn."""
        self.queue: deque[RunningAction] = deque()
        """Waiting for the wheels."""
        self.running: list[RunningAction] = []

    @property
    def idle(self) -> bool:
        """Whether no action is under way or waits."""
        return not (self.held or self.queue or self.running)

    def released(self, now: Instant) -> bool:
        """Return whether an action that waited for its turn may begin."""
        return bool(self.held) and any(not running.held(now) for running in self.held)

    @property
    def polling(self) -> bool:
        """Whether an action waits for a condition, which is looked at in every frame."""
        return len([running for running in self.running if running.pause.condition is not None]) > 0

    @property
    def driving(self) -> RunningAction | None:
        """The action that has the wheels."""
        for running in self.running:
            if running.handler.wheels:
                return running
        return None

    @property
    def next_wake(self) -> Instant:
        """When the next sleeping action goes on."""
        wake = NEVER
        for running in self.running:
            until = running.pause.until
            wake = until if until < wake else wake
        return wake

    def derive(self, now: Instant, running: RunningAction) -> None:
        """Take on an action: hold it, queue it, or start it."""
        if len(self.held) + len(self.queue) + len(self.running) >= RUNNING_MAX:
            self._host.action_ended(now, running, f"more than {RUNNING_MAX} actions under way")
        elif running.held(now):
            self.held.append(running)
        else:
            self._admit(now, running)

    def cancel(self, now: Instant, serial: int) -> None:
        """End an action that waits or is under way; nothing happens if it has ended."""
        for running in self.running:
            if running.serial == serial:
                self._end(now, running, CANCELLED)
                return
        for running in [*self.held, *self.queue]:
            if running.serial == serial:
                (self.held if running in self.held else self.queue).remove(running)
                self._host.action_ended(now, running, CANCELLED)

    def _admit(self, now: Instant, running: RunningAction) -> None:
        running.admitted = now
        if running.handler.at_once:
            self._interrupt(now)
        elif running.handler.wheels and (self.queue or self.driving):
            driving = self.driving
            if not (running.handler.takes_over and driving is not None and driving.name == running.name):
                self.queue.append(running)
                return
            # The later `lineup` knows the newer place in the queue: the earlier one would lead to the wrong place.
            self._end(now, driving, TAKEN_OVER)
        self._start(now, running)

    def _interrupt(self, now: Instant) -> None:
        driving = self.driving
        if driving is not None:
            self._end(now, driving, STOPPED)
        self._host.halt()

    def _start(self, now: Instant, running: RunningAction) -> None:
        running.started = now
        handle = self._host.handle(running)
        self.running.append(running)
        try:
            begun: object = running.handler.run(handle, *running.args)
            if not isinstance(begun, Awaitable):
                raise ActionFailed("its handler is no `async def`")
            running.coroutine = begun.__await__()
        except BaseException as error:  # a handler with other parameters, for example
            if is_ctrl_c(error):
                raise
            self._fail(now, running, error)
            return
        self._resume(now, running)

    def _resume(self, now: Instant, running: RunningAction) -> None:
        """Go on with an action whose pause is over.

        Whatever a handler raises, its conditions and its way out too, fails the action and not the robot.
        """
        coroutine = running.coroutine
        assert coroutine is not None
        try:
            if not running.pause.over(now):
                return
        except BaseException as error:  # the coroutine is suspended still
            if is_ctrl_c(error):
                raise
            self._fail(now, running, error)
            return
        try:
            pause = next(coroutine)
        except StopIteration:
            running.coroutine = None
            self._end(now, running, None)
        except BaseException as error:
            if is_ctrl_c(error):
                raise
            running.coroutine = None
            self._fail(now, running, error)
        else:
            if isinstance(pause, Pause):
                running.pause = pause
            else:
                self._end(now, running, NOT_ASYNCIO.format(kind_of(pause)))

    def _fail(self, now: Instant, running: RunningAction, error: BaseException) -> None:
        """End an action by what its handler has raised."""
        failure, raised = failure_of(error, running.handler)
        if raised:
            running.raised = raised
        self._end(now, running, failure)

    def _end(self, now: Instant, running: RunningAction, failure: str | None) -> None:
        self.running.remove(running)
        running.over = True
        coroutine, running.coroutine = running.coroutine, None
        if coroutine is not None and failure is not None:
            failure = _closed(coroutine, failure)
        if running.handler.wheels:
            self._host.halt()
        if failure is not None:
            failure = one_line(failure, FAILURE_CHARACTERS_MAX)
        self._host.action_ended(now, running, failure)

    def break_off(self) -> list[RunningAction]:
        """End all actions without a word to the machine, for a new program begins; return those that had begun."""
        begun = self.running.copy()
        for running in (*begun, *self.queue, *self.held):
            running.over = True
        self.running.clear()
        self.queue.clear()
        self.held.clear()
        for running in begun:
            coroutine, running.coroutine = running.coroutine, None
            if coroutine is not None:
                _closed(coroutine, NEW_PROGRAM)
            if running.handler.wheels:
                self._host.halt()
        return begun

    def step(self, now: Instant) -> None:
        """Release, start and resume what is due."""
        if self.queue:
            # A slot may have moved away since: such an action must not keep the wheels from others.
            for running in [one for one in self.queue if one.held(now)]:
                self.queue.remove(running)
                self.held.append(running)
        if self.held:
            for running in [one for one in self.held if not one.held(now)]:
                self.held.remove(running)
                self._admit(now, running)
        self.resume(now)
        while self.queue and self.driving is None:
            self._start(now, self.queue.popleft())

    def resume(self, now: Instant) -> None:
        """Go on with the actions whose pauses are over."""
        for running in self.running.copy():
            if not running.over:  # `stop` may have ended it meanwhile
                self._resume(now, running)


def failure_of(error: BaseException, handler: Handler) -> tuple[str, tuple[str, ...]]:
    """Return why an action fails whose handler has raised `error`, and the lines of the traceback.

    Everything but ActionFailed is a mistake in the handler, reported with its place.
    """
    if isinstance(error, ActionFailed):
        return str(error) or "failed", ()
    file = _file_of(handler)
    raised = frames(error, file)
    if isinstance(error, RuntimeError) and str(error) == "no running event loop":
        return NOT_ASYNCIO.format("asyncio"), raised
    where = place_in(error, file)
    return f"{words(error)} ({where})" if where else words(error), raised


def _closed(coroutine: Generator[object, None, None], failure: str) -> str:
    """Break off a suspended coroutine; return why it failed, and what went wrong on its way out, if anything did."""
    try:
        coroutine.close()
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return f"{failure}, then {words(error)}"
    return failure


def _file_of(handler: Handler) -> str:
    """Return the name of the file in which a handler stands; empty if that cannot be known."""
    code = getattr(handler.run, "__code__", None)
    return "" if code is None else str(code.co_filename)


def kind_of(awaited: object) -> str:
    """Return what an action has awaited, in words; a future of asyncio, and its `sleep(0)`, are asyncio's."""
    if awaited is None or hasattr(awaited, "_asyncio_future_blocking"):
        return "asyncio"
    return type(awaited).__name__
