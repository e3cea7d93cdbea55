"""Wheel commands that reach the world too late: it drops them, so the robot brakes, and says here why it does."""

import logging
from typing import Any

from rmr.base.time import Instant, in_seconds
from rmr.bus.late_messages import LIMIT, LateMessages

log = logging.getLogger("rmr")


class LateCommands:
    """The late commands of each robot: how many, and how late the latest was."""

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
