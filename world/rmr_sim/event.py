"""What happens in a simulated run beside what its robots do: an instant and a callback (paper V.A).

Two steps add an event to a run: subclass `Event` and override `callback`; hand an instance to
`Simulation.schedule`. The simulator's own faults are such events. Events of the same instant happen in the order in
which they were scheduled, before whatever ends on the air then; the tick that begins at that instant comes first.
"""

import traceback
from typing import TYPE_CHECKING

from rmr.base.time import Instant, in_seconds

if TYPE_CHECKING:
    from rmr_sim.simulation import Simulation


class EventError(Exception):
    """A user's event failed; the message says which, and where in its file."""


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
        except EventError:
            raise
        except (Exception, SystemExit) as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            what = f"event {type(self).__name__} at {in_seconds(simulation.now):.3f} s"
            raise EventError(f"{what}: {type(error).__name__}: {error} ({frame.filename}:{frame.lineno})") from error
