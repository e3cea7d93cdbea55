"""Loads a user's file of events (``--events FILE.py``): events of one run, and invariants that it checks.

The file's function `events(lab, seed)` returns the events; invariants are the functions that `invariant` decorates.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rmr.base.mistake import is_ctrl_c, place, words
from rmr.node.actions.user_file import UserFileError, run_file
from rmr_sim.event import Event, checked
from rmr_sim.user_invariants import Invariant, invariants_in
from rmr_world.lab import Lab
from rmr_world.lab_program import ProgramError

EVENTS_MAX = 100_000
"""Bound of the events of one run from the file, which stops an endless generator. Events may schedule others later."""


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
