"""Writes the true poses of all robots: ten times a second while any moves, once a second while none does."""

from collections.abc import Iterable
from functools import partial
from typing import Final

from rmr.base.geometry import Pose
from rmr.base.time import NS_PER_S, TICK_HZ, Instant
from rmr.record.foxglove_messages import robot_frame, transforms_json
from rmr.record.record_writer import RecordWriter

POSES_TICKS: Final = TICK_HZ // 10
"""Ticks between two looks at the poses."""


class PoseRecorder:
    """The channel `/tf` of one recording."""

    def __init__(self, writer: RecordWriter) -> None:
        self._writer = writer
        self._last: list[tuple[str, float, float, float]] = []
        self._due: Instant = 0

    def take(self, now: Instant, poses: Iterable[tuple[int, Pose]]) -> None:
        """Take the poses of all robots, by id."""
        present = [(robot_frame(robot), pose.x, pose.y, pose.theta) for robot, pose in poses]
        if present != self._last or now >= self._due:
            self._last = present
            self._due = now + NS_PER_S
            self._writer.write("/tf", now, partial(transforms_json, now, present))
