"""Wheel commands that reach the world too late: it drops them, so the robot brakes, and says here why it does.

A bus or a machine that delays messages by `COMMAND_AGE_MAX` and more makes robots stand although their nodes drive.
"""

import logging
from typing import Any, Final

from rmr.base.time import Duration, Instant, in_seconds, seconds
from rmr_world.robot_body import COMMAND_AGE_MAX

ROW_MIN: Final = 6
"""Late commands in a row that are told: 0.1 s of commands, after which the wheels have braked."""
TELL_EVERY: Final[Duration] = seconds(5)
"""Least lab time between two warnings about one robot."""

log = logging.getLogger("rmr")


class LateCommands:
    """The late commands of each robot: how many, and how late the latest was."""

    def __init__(self) -> None:
        self._row: dict[int, int] = {}
        self._count: dict[int, int] = {}
        self._worst: dict[int, Duration] = {}
        self._told: dict[int, Instant] = {}

    def note(self, robot: int, stamp: Instant, now: Instant) -> None:
        """Take note of a command of `robot` that was decided at `stamp` and has arrived `now`, in lab time."""
        age = now - stamp
        if age <= COMMAND_AGE_MAX:
            self._row[robot] = 0
            return
        self._row[robot] = self._row.get(robot, 0) + 1
        self._count[robot] = self._count.get(robot, 0) + 1
        self._worst[robot] = max(age, self._worst.get(robot, 0))
        due = self._told.get(robot, now - TELL_EVERY) + TELL_EVERY
        if self._row[robot] >= ROW_MIN and now >= due:
            self._told[robot] = now
            log.warning(
                "robot %d brakes: its wheel commands arrive %.0f ms late, and after %.0f ms they are dropped; "
                "the bus is delayed or the machine is too slow",
                robot,
                in_seconds(age) * 1000,
                in_seconds(COMMAND_AGE_MAX) * 1000,
            )

    def report(self) -> list[list[Any]]:
        """Return [robot, number of late commands, how late the latest was in seconds] for each robot with any."""
        return [
            [robot, count, round(in_seconds(self._worst[robot]), 3)] for robot, count in sorted(self._count.items())
        ]
