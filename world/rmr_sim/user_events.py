"""Loads a user's file of events (``--events FILE.py``): events of one run, and invariants that it checks.

The file's function `events(lab, seed)` returns the events. Invariants are the functions that `invariant` decorates:
they are called with the running simulation at the end of each tick. One holds if it returns None or True. False, or an
AssertionError, is a violation with the message of the error or the first line of the function's docstring; a text is a
violation with that text. A violation is recorded when it begins: the next one of the same function after the function
has held again.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from rmr.base.mistake import is_ctrl_c, place, words
from rmr.base.time import Instant
from rmr.node.actions.user_file import UserFileError, run_file
from rmr_sim.event import DEFERRED, Event, EventError, checked, described
from rmr_sim.violation import Violation
from rmr_world.lab import Lab
from rmr_world.lab_program import ProgramError

EVENTS_MAX = 100_000
"""Bound of the events of one run from the file, which stops an endless generator. Events may schedule others later."""
MARK = "_rmr_invariant"
"""Attribute of a decorated function."""

Invariant = Callable[[Any], object]

F = TypeVar("F", bound=Invariant)


class UserEvents(NamedTuple):
    """What a file of events holds for one run."""

    events: Sequence[Event] = ()
    invariants: Sequence[Invariant] = ()


def load_events(path: Path | None, lab: Lab, seed: int) -> UserEvents:
    """Return what the file holds for the run of `lab` with `seed`. Raises ProgramError if the file is wrong."""
    if path is None:
        return UserEvents()
    try:
        module = run_file(path, "rmr_user_events")
    except UserFileError as error:
        raise ProgramError(str(error)) from error
    function = getattr(module, "events", None)
    invariants = invariants_in(vars(module).values())
    if function is None and invariants:
        return UserEvents((), invariants)
    if not callable(function):
        raise ProgramError(
            f"{path}: has no function events(lab, seed) that returns the run's events, and no @invariant"
        )
    found: list[Event] = []
    try:
        for event in function(lab, seed):
            if len(found) == EVENTS_MAX:
                raise ValueError(f"events returned more than {EVENTS_MAX} events")
            found.append(checked(event))
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        raise ProgramError(f"{place(error, str(path))}: {words(error)}") from error
    return UserEvents(found, invariants)


# --- invariants


def invariant(function: F) -> F:
    """Have the runs of this file check `function`, called with the simulation, at the end of each tick.

    Raises TypeError for what is no function, and for a coroutine or generator function.
    """
    if not callable(function) or not hasattr(function, "__name__"):
        raise TypeError(f"@invariant decorates a function of the simulation, not {function!r:.60}")
    if any(is_deferred(function) for is_deferred in DEFERRED):
        raise TypeError(f"the invariant {function.__name__} would not run when it is called: no async, no yield in it")
    setattr(function, MARK, True)
    return function


def invariants_in(namespace: Iterable[object]) -> list[Invariant]:
    """Return the decorated functions among the values of a module's namespace, each once, in their order."""
    marked = [each for each in namespace if callable(each) and getattr(each, MARK, False) is True]
    return list(dict.fromkeys(marked))


class InvariantChecker:
    """Checks one invariant of a run."""

    def __init__(self, simulation: Any, function: Invariant) -> None:
        self._simulation = simulation
        self._function = function
        self._broken = False

    def __call__(self, now: Instant) -> None:
        """Check it at `now`. Raises EventError if the function raises anything but AssertionError."""
        breach = self._breach(now)
        if breach is not None and not self._broken:
            self._simulation.violate(Violation(now, self._name, (), breach))
        self._broken = breach is not None

    @property
    def _name(self) -> str:
        return self._function.__name__

    def _breach(self, now: Instant) -> str | None:
        """Return in which way the invariant is broken; None if it holds."""
        function = self._function
        try:
            answer = function(self._simulation)
        except AssertionError as error:
            return words(error).removeprefix(type(error).__name__).removeprefix(": ") or self._rule()
        except BaseException as error:
            if is_ctrl_c(error):
                raise
            raise EventError(described(f"invariant {self._name}", now, function, error)) from error
        if answer is None or answer is True:
            return None
        if answer is False:
            return self._rule()
        if isinstance(answer, str):
            return answer
        wrong = TypeError(
            f"returned {answer!r:.60}; None and True mean that it holds, False or a text that it does not"
        )
        raise EventError(described(f"invariant {self._name}", now, function, wrong))

    def _rule(self) -> str:
        """Return the first line of the function's docstring, or that it does not hold."""
        lines = (self._function.__doc__ or "").strip().splitlines()
        return lines[0].rstrip(".") if lines else "it does not hold"
