"""What the world adds to the recording of a run: the scene, true poses, disturbances of the radio."""

from collections.abc import Callable, Iterable
from typing import Any

from rmr.base.geometry import Pose
from rmr.base.time import Instant
from rmr.bus.process_recorder import ProcessRecorder
from rmr.radio.links import Disturbance
from rmr.record.foxglove_messages import grid, scene
from rmr.record.record_writer import RecordWriter
from rmr.record.robot_observer import PoseRecorder
from rmr_world.faults import fault_entry
from rmr_world.lab import Lab


class WorldRecorder:
    """The world's part of the recording; without a `recorder` it is none."""

    def __init__(self, recorder: ProcessRecorder | None, lab: Lab, seed: int, run: Callable[[], int]) -> None:
        """`run` returns the number of the world's session."""
        self._recorder = recorder
        self._lab = lab
        self._seed = seed
        self._run = run
        self._writer: RecordWriter | None = None
        self._poses: PoseRecorder | None = None

    def begin(self, now: Callable[[], Instant], poses: Iterable[tuple[int, Pose]]) -> None:
        """Begin the file, with the scene and the first poses; `now` is lab time."""
        lab = self._lab
        if self._recorder is None:
            return
        self._writer = writer = self._recorder.begin(lab.name, self._seed, lab.roster, self._run(), now)
        first = max(0, now())  # of a world that goes on: the part before has what was earlier
        writer.write("/scene", first, scene(lab.arena, lab.roster))
        writer.write("/floor", first, grid(lab.arena))
        self._poses = PoseRecorder(writer)
        self.poses(first, poses)
        for disturbance in () if first else lab.disturbances:
            self.fault(0, fault_entry(disturbance))

    def poses(self, now: Instant, poses: Iterable[tuple[int, Pose]]) -> None:
        """Take the true poses, by robot."""
        if self._poses is not None:
            self._poses.take(now, poses)

    def added(self, now: Instant, disturbance: Disturbance) -> None:
        """Take a disturbance that `rmr fault` has added."""
        self.fault(now, fault_entry(disturbance))

    def fault(self, now: Instant, entry: dict[str, Any]) -> None:
        """Take a fault, as an entry of a lab file."""
        if self._writer is not None:
            self._writer.write("/faults", now, {"fault": entry})
