"""What one call of a node knows of itself: its instant, how old its input may be, and what is still to be done.

The node writes it at the beginning of each call; its parts read the instant and mark what they have changed.
"""

from typing import Final

from rmr.base.time import Duration, Instant, milliseconds

SUSPENDED_AFTER: Final[Duration] = milliseconds(150)
"""Time without a call after which the host counts as suspended: input may then be as old as the previous call."""


class TickState:
    """The present call of one node."""

    def __init__(self) -> None:
        self.now: Instant = 0
        self.heard_at: Instant = 0
        """Lower bound of when the frames arrived that are handled in this call."""
        self.due = True
        """Whether the node itself asked for this call; else the host had input for it."""
        self.dirty = True
        """Whether rules, actions or turns have something to look at in this call."""
        self.reschedule = True
        """Whether this call may have changed when the robot is due next; hellos of others alone do not."""

    def begin(self, now: Instant, next_wake: Instant) -> None:
        """Begin a call at `now`; `next_wake` is when the node wanted to be called."""
        self.heard_at = self.now if self.suspended(now) else now
        self.now = now
        self.due = now >= next_wake
        self.reschedule = self.due

    def suspended(self, now: Instant) -> bool:
        """Return whether a call at `now` would come after a suspension of the host."""
        return now - self.now > SUSPENDED_AFTER

    def mark_dirty(self) -> None:
        """Have rules, actions and turns looked at in this call."""
        self.dirty = True
