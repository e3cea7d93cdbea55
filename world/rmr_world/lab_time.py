"""Lab time as the world keeps it: zero before the start, then real time from an origin, then still.

All other clocks of the lab follow this one. It runs with the machine's monotonic clock; only when the world
itself was held up for long (a stopped process, a sleeping laptop) is it set back to where the physics stands, so that
nobody's deadline passes while nobody could move.
"""

from rmr.base.time import Duration, Instant


class LabTime:
    """Lab time from monotonic instants (ns)."""

    def __init__(self) -> None:
        self.state = "waiting"
        """One of `rmr.bus.wire.CLOCK_STATES`."""
        self._origin = 0
        self._standing: Instant = 0

    def start(self, monotonic: int, delay: Duration) -> None:
        """Let lab time be 0 at `monotonic` + `delay`; until then it is negative, so that all can hear of it."""
        self.state = "running"
        self._origin = monotonic + delay

    def stop(self, monotonic: int) -> None:
        """Stop lab time for good."""
        self._standing = self.at(monotonic)
        self.state = "stopped"

    def set_back(self, by: Duration) -> None:
        """Go back `by` nanoseconds."""
        self._origin += by

    def at(self, monotonic: int) -> Instant:
        """Return lab time at a monotonic instant."""
        return monotonic - self._origin if self.state == "running" else self._standing
