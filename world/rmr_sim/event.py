"""Events of a simulated run other than the actions of its robots: an instant and a callback (paper V.A).

To add an event to a run, subclass `Event`, override `callback`, and hand an instance to `Simulation.schedule`. The
lab's faults of robots are such events; disturbances of the radio are set from the beginning. At one instant the tick
comes first, then the events in the order in which they were scheduled, then the ends of frames on the air.

A callback is handed the running `rmr_sim.simulation.Simulation`. Its type is not named here: an import of that module
would be a circle, and a narrower type would forbid users to annotate their own callbacks with `Simulation`.
"""

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from rmr.base.errors import Error
from rmr.base.mistake import is_ctrl_c, place, words
from rmr.base.time import Duration, Instant, in_seconds
from rmr_world.lab import Fault, Kill, Outage, Restart, Slow, Stall

DEFERRED = (inspect.iscoroutinefunction, inspect.isgeneratorfunction, inspect.isasyncgenfunction)
"""Tests for functions whose call does not run their body."""


class EventError(Error):
    """A user's event or observer failed; the message says which, and where in its file."""


class Event:
    """Something that happens once. Subclass it and override `callback`."""

    def __init__(self, at: Instant) -> None:
        """`at` is lab time; an event whose time is past when it is scheduled happens at once."""
        self.at = at

    def callback(self, simulation: Any) -> None:
        """Perform the event at `simulation.now`; it may schedule further events."""
        raise NotImplementedError(f"override callback in {type(self).__name__}: it says what the event does")

    def happen(self, simulation: Any) -> None:
        """Call `callback`. Raises EventError if that raises anything, exit() included."""
        try:
            self.callback(simulation)
        except EventError:
            raise
        except BaseException as error:
            if is_ctrl_c(error):
                raise
            what = f"event {type(self).__name__}"
            raise EventError(described(what, simulation.now, self.callback, error)) from error


def call_observer(observe: Callable[[Instant], None], now: Instant) -> None:
    """Call a user's observer. Raises EventError if that raises anything, exit() included."""
    try:
        observe(now)
    except EventError:
        raise
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        what = f"observer {getattr(observe, '__qualname__', type(observe).__name__)}"
        raise EventError(described(what, now, observe, error)) from error


def checked(event: object) -> Event:
    """Return `event` if it can be scheduled. Raises TypeError."""
    if not isinstance(event, Event):
        raise TypeError(f"{event!r:.60} is no Event")
    if not hasattr(event, "at"):
        raise TypeError(f"{type(event).__name__} has no instant: its __init__ must call super().__init__(at)")
    instant(event.at)
    if any(is_deferred(event.callback) for is_deferred in DEFERRED):
        raise TypeError(f"callback of {type(event).__name__} would not run when it is called: no async, no yield in it")
    return event


def instant(value: object) -> Instant:
    """Return `value` if it is an instant. Raises TypeError: 1.5 would be one and a half nanoseconds."""
    if not isinstance(value, int):
        raise TypeError(f"{value!r:.60} is no instant: a whole number of nanoseconds, such as seconds(1.5)")
    return value


def described(what: str, now: Instant, function: Callable[..., object], error: BaseException) -> str:
    """Return the message for an exception of a user's `function`, with its place in the user's file."""
    code = getattr(function, "__code__", None) or getattr(type(function).__call__, "__code__", None)
    where = "no Python file" if code is None else place(error, code.co_filename, code.co_firstlineno)
    return f"{what} at {in_seconds(now):.3f} s: {words(error)} ({where})"


class FaultRecord(NamedTuple):
    """A fault of one robot."""

    at: Instant
    until: Instant
    """End of a fault that lasts; else NEVER."""
    robot: int
    fault: str
    """The trace's word: killed, restarted, stalled, slowed or silenced."""


class FaultTarget(Protocol):
    """The methods of `Simulation` that faults call."""

    def kill(self, robot: int) -> None:
        """Kill the process of `robot`."""

    def is_dead(self, robot: int) -> bool:
        """Return whether `robot` has been killed and not been restarted."""

    def restart(self, robot: int) -> None:
        """Start `robot` again, without memory."""

    def stall(self, robot: int, until: Instant) -> None:
        """Stop the process of `robot` until `until`."""

    def slow(self, robot: int, until: Instant, every: Duration) -> None:
        """Call the node of `robot` once in `every` nanoseconds only, until `until`."""

    def silence(self, robot: int, until: Instant) -> None:
        """Let `robot` receive no localisation pulse until `until`."""


class FaultEvent(Event):
    """A fault of a robot happens. A fault with an end ends by itself."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.at if isinstance(fault, Kill | Restart) else fault.start)
        self.fault = fault

    def callback(self, simulation: FaultTarget) -> None:
        """Apply the fault."""
        match self.fault:
            case Kill(robot=robot):
                simulation.kill(robot)
            case Restart(robot=robot):
                if simulation.is_dead(robot):  # a user's event may have restarted it already
                    simulation.restart(robot)
            case Stall(end=end, robot=robot):
                simulation.stall(robot, end)
            case Slow(end=end, robot=robot, every=every):
                simulation.slow(robot, end, every)
            case Outage(end=end, robot=robot):
                simulation.silence(robot, end)
