"""The recording of one robot in its process: what of a turn, of the trace and of the radio goes into it."""

import time
from collections.abc import Iterable, Mapping
from typing import Any

from rmr.base.time import Instant
from rmr.bus import wire
from rmr.bus.process_recorder import ProcessRecorder
from rmr.mind.mind_log import MindSink
from rmr.node.frame_log import FrameLog
from rmr.node.report import pose_of, route_of, status_of
from rmr.record.robot_observer import RobotObserver
from rmr_agent.clock import LabClock
from rmr_agent.incarnation import Incarnation


class RobotRecording:
    """The recording of one robot, incarnation by incarnation; without a recorder it records nothing."""

    def __init__(self, robot: int, recorder: ProcessRecorder | None) -> None:
        """`recorder` is shared by the robots of the process."""
        self._robot = robot
        self._recorder = recorder
        self._observer: RobotObserver | None = None
        self._frames: FrameLog | None = None
        self._incarnation: Incarnation | None = None

    def open(self, known: wire.Map, run: int, clock: LabClock) -> MindSink | None:
        """Begin to record the robot in the world's run; return what takes the log of its mind, None if nothing does."""
        self.end()
        if self._recorder is None:
            return None
        writer = self._recorder.begin(known.lab, known.seed, known.roster, run, lambda: clock.at(time.monotonic_ns()))
        self._observer = RobotObserver(self._robot, writer)
        return writer.mind

    def follow(self, incarnation: Incarnation) -> None:
        """Record what `incarnation` does from now on."""
        if self._observer is not None:
            self._frames = FrameLog(self._robot, self._observer.transmission)
            self._incarnation = incarnation
            incarnation.link.frames = self._frames
            incarnation.after_turn = self._look

    def _look(self, now: Instant) -> None:
        """Look at the robot after a turn."""
        observer = self._observer
        if observer is not None and now >= observer.look_due and self._incarnation is not None:
            node = self._incarnation.node
            observer.look(now, pose_of(node), route_of(node))

    def trace(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Take what the robot has noted."""
        if self._observer is not None:
            self._observer.trace(entries)

    def status(self, now: Instant) -> None:
        """Look at the robot's state."""
        incarnation = self._incarnation
        observer = self._observer
        if observer is None or incarnation is None or not incarnation.started or not observer.status_due(now):
            return
        observer.status(now, status_of(incarnation.node, now, incarnation.link.station.queued))

    def end(self) -> None:
        """Write what is left of this incarnation."""
        if self._frames is not None:
            self._frames.end()
        self._observer = None
        self._frames = None
        self._incarnation = None
