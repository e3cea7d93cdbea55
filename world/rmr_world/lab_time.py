"""Lab time, kept by the world: zero before the start, then real time from an origin, then constant.

All other clocks of the lab follow this one. It runs with the machine's monotonic clock. After a long stop of the world
itself (a stopped process, a suspended machine) it is set back to the time of the physics, so that no deadline passes
while no robot could move.
"""

from rmr.base.time import Duration, Instant


class LabTime:
    """Lab time from monotonic instants (ns)."""

    def __init__(self) -> None:
        self.state = "waiting"
        """One of `rmr.bus.wire.CLOCK_STATES`."""
        self._origin = 0
        self._standing: Instant = 0
        self.stands = False
        """Whether it stands although it runs: a world that was interrupted waits for its robots."""

    def start(self, monotonic: int, delay: Duration) -> None:
        """Set lab time to 0 at `monotonic` + `delay`; it is negative until then, while the start is announced."""
        self.state = "running"
        self._origin = monotonic + delay

    def stand(self, at: Instant) -> None:
        """Let lab time that was running stand at an instant."""
        self.state = "running"
        self._standing = at
        self.stands = True

    def go_on(self, monotonic: int) -> None:
        """Let it run on from where it stands."""
        self._origin = monotonic - self._standing
        self.stands = False

    def stop(self, monotonic: int) -> None:
        """Stop lab time; it cannot be started again."""
        self._standing = self.at(monotonic)
        self.state = "stopped"

    def set_back(self, by: Duration) -> None:
        """Go back `by` nanoseconds."""
        self._origin += by

    def at(self, monotonic: int) -> Instant:
        """Return lab time at a monotonic instant."""
        return monotonic - self._origin if self.state == "running" and not self.stands else self._standing
