"""Writes the true poses of all robots, and what each shows of itself: estimated pose, route, state, trace, radio.

Hosts look at the robot as often as they like; a message is written when something has changed, and not more often than
its channel allows.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final

from rmr.base.geometry import Point, Pose
from rmr.base.time import NS_PER_S, TICK_HZ, Duration, Instant, seconds
from rmr.record.foxglove_messages import estimate_frame, robot_frame, transforms_json
from rmr.record.record_writer import RecordWriter

SLACK: Final[Duration] = 1_000
"""Ticks begin at whole nanoseconds: six of them may be a little shorter than a tenth of a second."""
POSES_TICKS: Final = TICK_HZ // 10
"""Ticks between two looks at the true poses."""


class PoseRecorder:
    """The channel `/tf`, true poses: ten times a second while any robot moves, once a second while none does."""

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


class RobotObserver:
    """One robot, of one incarnation or of several in a row."""

    def __init__(self, robot: int, writer: RecordWriter) -> None:
        self.robot = robot
        self.writer = writer
        self._frame = estimate_frame(robot)
        self._pose: Pose | None = None
        self._points: Sequence[Point] | None = None
        self._status: Mapping[str, Any] = {}
        self.look_due: Instant = 0
        """When to look at the robot's pose and route."""
        self._status_due: Instant = 0

    def look(self, now: Instant, pose: Pose | None, points: Sequence[Point] | None) -> None:
        """Take the robot's estimated pose and the points of its route, the same object while it is the same route."""
        self.look_due = now + NS_PER_S // 10 - SLACK
        if pose is not None and pose is not self._pose and pose != self._pose:
            self._pose = pose
            estimate = (self._frame, pose.x, pose.y, pose.theta)
            self.writer.write("/tf_estimates", now, partial(transforms_json, now, (estimate,)))
        if points is not self._points:
            self._points = points
            rounded = [[round(x, 3), round(y, 3)] for x, y in points or ()]
            self.writer.write("/routes", now, {"robot": self.robot, "points": rounded})

    def status_due(self, now: Instant) -> bool:
        """Return whether it is time for the robot's state."""
        return now + SLACK >= self._status_due

    def status(self, now: Instant, status: Mapping[str, Any]) -> None:
        """Take the robot's state."""
        self._status_due = now + NS_PER_S
        if status != self._status:
            self._status = status
            self.writer.write("/status", now, status)

    def trace(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Take entries of the robot's trace."""
        for entry in entries:
            self.writer.write("/trace", seconds(entry["t"]), entry)

    def transmission(self, at: Instant, frame: Callable[[], bytes]) -> None:
        """Take a transmission of the robot's radio, as a function that returns it as JSON."""
        self.writer.write("/frames", at, frame)
