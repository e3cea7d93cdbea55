"""Loads a user's file of events (``--events FILE.py``): its function `events(lab, seed)` returns those of one run."""

from pathlib import Path

from rmr.base.mistake import place, words
from rmr.node.actions.user_file import UserFileError, run_file
from rmr_sim.event import Event, checked
from rmr_world.lab import Lab
from rmr_world.lab_program import ProgramError

EVENTS_MAX = 100_000
"""Bound of the events of one run from the file, which stops an endless generator. Events may schedule others later."""


def load_events(path: Path | None, lab: Lab, seed: int) -> list[Event]:
    """Return the events of the run of `lab` with `seed`, none without a file. Raises ProgramError if it is wrong."""
    if path is None:
        return []
    try:
        function = getattr(run_file(path, "rmr_user_events"), "events", None)
    except UserFileError as error:
        raise ProgramError(str(error)) from error
    if not callable(function):
        raise ProgramError(f"{path}: has no function events(lab, seed) that returns the run's events")
    found: list[Event] = []
    try:
        for event in function(lab, seed):
            if len(found) == EVENTS_MAX:
                raise ValueError(f"events returned more than {EVENTS_MAX} events")
            found.append(checked(event))
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ProgramError(f"{place(error, str(path))}: {words(error)}") from error
    return found
