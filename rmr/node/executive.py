"""The priority executive of one robot (paper V.B.3).

Lab time is cut into frames of 1/60 s. In each frame the tasks run in the order of their priority; when the
frame's time is used up, what is left is skipped until the next frame, lowest priority first, and counted. A
call between two frames (a frame of the radio has arrived, a deadline is due) runs only the tasks that react to
input. The executive reads no clock: the host says how much time the call has used.

Where many robots share a few cores their frames begin one after the other, each at its own phase of the 1/60 s, as in
time division: else all would want the cores at the same instant, and the last would wait for all others.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rmr.base.time import FRAME, Duration, Instant, tick_index, tick_start

FRAME_BUDGET: Final[Duration] = FRAME
"""Processor time that all tasks of one call may use together."""


@dataclass(slots=True)
class ExecutiveTask:
    """One entry of the executive's table, highest priority first."""

    name: str
    run: Callable[[Instant], None]
    periodic: bool
    """Runs once a frame; else at every call."""
    skipped: int = 0


class Executive:
    """Runs a table of tasks frame by frame."""

    def __init__(self, tasks: list[ExecutiveTask], spent: Callable[[], Duration] | None, phase: Duration = 0) -> None:
        """`spent` is None in virtual time, which no task uses up; each frame begins `phase` after the lab's."""
        self.tasks = tasks
        self._between = [task for task in tasks if not task.periodic]
        self._spent = spent
        self._phase = phase
        self._frame = -1
        self.frame_ends: Instant = 0
        """When the next frame begins."""
        self._due = False
        self.frames_due = 0
        """Frames in which the robot had to act because it was busy."""
        self.frames_late = 0
        """Those of them that the host let pass."""

    def follow(self, other: "Executive") -> None:
        """Go on in the frame and with the counters of `other`, which has the same tasks."""
        for task, before in zip(self.tasks, other.tasks, strict=True):
            task.skipped = before.skipped
        self._frame = other._frame
        self.frame_ends = other.frame_ends
        self._due = other._due
        self.frames_due = other.frames_due
        self.frames_late = other.frames_late

    @property
    def skipped(self) -> int:
        """How many task runs were left out for want of time."""
        return sum(task.skipped for task in self.tasks)

    def tick(self, now: Instant) -> None:
        """Run what is due at `now`, in priority order."""
        tasks = self._between
        if now >= self.frame_ends:
            tasks = self.tasks
            self._begin(tick_index(now - self._phase))
        spent = self._spent
        if spent is None:
            for task in tasks:
                task.run(now)
            return
        # Asked before each task: one that has begun is not interrupted, and those after it have lower priority.
        for task in tasks:
            if spent() > FRAME_BUDGET:
                task.skipped += 1
            else:
                task.run(now)

    def _begin(self, frame: int) -> None:
        """Begin a frame."""
        # Frames count as late only while the robot was busy: an idle one is not called, and misses nothing.
        if self._due:
            self.frames_due += frame - self._frame
            self.frames_late += frame - self._frame - 1
        self._frame = frame
        self.frame_ends = tick_start(frame + 1) + self._phase

    def next_frame(self, busy: bool) -> Instant | None:
        """Return when the next frame must begin, or None when nothing periodic goes on."""
        self._due = busy
        return self.frame_ends if busy else None
