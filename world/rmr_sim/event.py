"""What happens in a simulated run beside what its robots do: an instant and a callback (paper V.A).

Two steps add an event to a run: subclass `Event` and override `callback`; hand an instance to
`Simulation.schedule`. The simulator's own faults are such events. Events of the same instant happen in the order in
which they were scheduled, before whatever ends on the air then; the tick that begins at that instant comes first.
"""

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING

from rmr.base.errors import Error
from rmr.base.mistake import place, words
from rmr.base.time import Instant, in_seconds

if TYPE_CHECKING:
    from rmr_sim.simulation import Simulation


PUT_OFF = (inspect.iscoroutinefunction, inspect.isgeneratorfunction, inspect.isasyncgenfunction)
"""What tells functions whose call does nothing by itself."""


class EventError(Error):
    """A user's event or observer failed; the message says which, and where in its file."""


class Event:
    """Something that happens once. Subclass it and override `callback`."""

    def __init__(self, at: Instant) -> None:
        """`at` is lab time; what is over already when it is scheduled happens at once."""
        self.at = at

    def callback(self, simulation: "Simulation") -> None:
        """Do what the event is about; `simulation.now` is the instant. It may schedule further events."""
        raise NotImplementedError(f"override callback in {type(self).__name__}: it says what the event does")

    def happen(self, simulation: "Simulation") -> None:
        """Have `callback` done. Raises EventError if it raises anything, exit() included."""
        try:
            self.callback(simulation)
        except (EventError, KeyboardInterrupt):
            raise
        except BaseException as error:
            what = f"event {type(self).__name__}"
            raise EventError(_told(what, simulation.now, self.callback, error)) from error


def observed(observe: Callable[[Instant], None], now: Instant) -> None:
    """Have a user's observer look. Raises EventError if it raises anything, exit() included."""
    try:
        observe(now)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        what = f"observer {getattr(observe, '__qualname__', type(observe).__name__)}"
        raise EventError(_told(what, now, observe, error)) from error


def checked(event: object) -> Event:
    """Return `event` if it can be scheduled. Raises TypeError."""
    if not isinstance(event, Event):
        raise TypeError(f"{event!r:.60} is no Event")
    if not hasattr(event, "at"):
        raise TypeError(f"{type(event).__name__} has no instant: its __init__ must call super().__init__(at)")
    instant(event.at)
    if any(is_put_off(event.callback) for is_put_off in PUT_OFF):
        raise TypeError(f"callback of {type(event).__name__} would not run when it is called: no async, no yield in it")
    return event


def instant(value: object) -> Instant:
    """Return `value` if it is an instant. Raises TypeError: 1.5 would be one and a half nanoseconds."""
    if not isinstance(value, int):
        raise TypeError(f"{value!r:.60} is no instant: a whole number of nanoseconds, such as seconds(1.5)")
    return value


def _told(what: str, now: Instant, function: Callable[..., None], error: BaseException) -> str:
    """Return what a user's `function` has raised, and where, as its author knows it: in the file that holds it."""
    code = getattr(function, "__code__", None) or getattr(type(function).__call__, "__code__", None)
    where = "no Python file" if code is None else place(error, code.co_filename, code.co_firstlineno)
    return f"{what} at {in_seconds(now):.3f} s: {words(error)} ({where})"
