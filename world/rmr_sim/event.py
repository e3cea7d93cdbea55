"""Events of a simulated run other than the actions of its robots: an instant and a callback (paper V.A).

To add an event to a run, subclass `Event`, override `callback`, and hand an instance to `Simulation.schedule`. The
simulator's own faults are such events. At one instant the tick comes first, then the events in the order in which they
were scheduled, then the ends of frames on the air.

A callback is handed the running `rmr_sim.simulation.Simulation`. Its type is not named here: an import of that module
would be a circle, and a narrower type would forbid users to annotate their own callbacks with `Simulation`.
"""

import inspect
from collections.abc import Callable
from typing import Any

from rmr.base.errors import Error
from rmr.base.mistake import is_ctrl_c, place, words
from rmr.base.time import Instant, in_seconds

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
