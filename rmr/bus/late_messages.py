"""Messages that come too late to be used: how many, how late, and when it is time to say so.

A bus or a machine that delays messages by `LIMIT` and more makes robots stand: the world drops their wheel commands, so
they brake (`LateCommands`), and they drive on no sample that old (`LateSamples`). Whoever drops them says why.
"""

import logging
from typing import Any, Final

from rmr.base.time import Duration, Instant, in_seconds, milliseconds, seconds

LIMIT: Final[Duration] = milliseconds(100)
"""Age at which a wheel command is dropped (`rmr_world.robot_body`), and at which a robot drives on a sample no more
(`rmr.node.driver`)."""
ROW_MIN: Final = 6
"""Late messages in a row that are told: after 0.1 s of late commands the wheels have braked."""
TELL_EVERY: Final[Duration] = seconds(5)
"""Least lab time between two warnings."""
log = logging.getLogger("rmr")


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


class LateSamples(LateMessages):
    """The samples of its body that reach one robot too late."""

    def __init__(self, robot: int) -> None:
        super().__init__()
        self._robot = robot

    def note(self, stamp: Instant, now: Instant) -> bool:
        """Take note of a sample of the instant `stamp` that has arrived `now`; warn, and return whether it did."""
        due = super().note(stamp, now)
        if due:
            log.warning(
                "robot %d stands: its samples arrive %.0f ms late, and it drives on none older than %.0f ms; "
                "the bus is delayed or the machine is too slow",
                self._robot,
                in_seconds(now - stamp) * 1000,
                in_seconds(LIMIT) * 1000,
            )
        return due


class LateCommands:
    """The wheel commands of each robot that reach the world too late: how many, and how late the latest was."""

    def __init__(self) -> None:
        self._robots: dict[int, LateMessages] = {}

    def note(self, robot: int, stamp: Instant, now: Instant) -> None:
        """Take note of a command of `robot` that was decided at `stamp` and has arrived `now`, in lab time."""
        if self._robots.setdefault(robot, LateMessages()).note(stamp, now):
            log.warning(
                "robot %d brakes: its wheel commands arrive %.0f ms late, and after %.0f ms they are dropped; "
                "the bus is delayed or the machine is too slow",
                robot,
                in_seconds(now - stamp) * 1000,
                in_seconds(LIMIT) * 1000,
            )

    def report(self) -> list[list[Any]]:
        """Return [robot, number of late commands, how late the latest was in seconds] for each robot with any."""
        late = [(robot, each) for robot, each in sorted(self._robots.items()) if each.count]
        return [[robot, each.count, round(in_seconds(each.worst), 3)] for robot, each in late]
