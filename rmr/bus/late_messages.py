"""Messages that come too late to be used: how many, how late, and when it is time to say so.

A bus or a machine that delays messages by `LIMIT` and more makes robots stand: the world drops their wheel commands,
and they drive on no sample that old.
"""

from typing import Final

from rmr.base.time import Duration, Instant, milliseconds, seconds

LIMIT: Final[Duration] = milliseconds(100)
"""Age at which a wheel command is dropped (`rmr_world.robot_body`), and at which a robot drives on a sample no more
(`rmr.node.driver`)."""
ROW_MIN: Final = 6
"""Late messages in a row that are told: after 0.1 s of late commands the wheels have braked."""
TELL_EVERY: Final[Duration] = seconds(5)
"""Least lab time between two warnings."""


class LateMessages:
    """The late messages of one robot and one kind."""

    def __init__(self) -> None:
        self.count = 0
        self.worst: Duration = 0
        """Age of the latest one."""
        self._newest: Instant = 0
        """Of the messages noted; bounded by their arrival."""
        self._row = 0
        self._due: Instant | None = None

    def note(self, stamp: Instant, now: Instant) -> bool:
        """Take note of a message of the instant `stamp` that has arrived `now`; return whether to warn.

        One of an earlier instant than another was overtaken, or is forged: it says nothing of how late they come.
        """
        if stamp < self._newest:
            return False
        self._newest = min(stamp, now)
        age = now - stamp
        if age <= LIMIT:
            self._row = 0
            return False
        self._row += 1
        self.count += 1
        self.worst = max(age, self.worst)
        if self._row < ROW_MIN or (self._due is not None and now < self._due):
            return False
        self._due = now + TELL_EVERY
        return True
