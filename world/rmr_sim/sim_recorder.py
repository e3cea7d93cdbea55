"""Records a simulated run: looks at the simulation at every tick, and at every frame on the air.

The recording depends on lab, seed and options alone: two of the same run are equal to the octet.
"""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, Final

from rmr.base.time import Instant, in_seconds, seconds
from rmr.node.frame_log import FrameLog
from rmr.node.ports import Spoken
from rmr.node.report import pose_of, route_of, status_of
from rmr.radio.air import Announcement, Confirmed, Received
from rmr.radio.links import Disturbance
from rmr.record.foxglove_messages import grid, log_message, scene
from rmr.record.record_writer import RecordWriter
from rmr.record.robot_observer import POSES_TICKS, PoseRecorder, RobotObserver
from rmr.record.run_about import about_run
from rmr.record.run_files import REPORT, attach_files
from rmr_sim.run_setup import LoadedLab
from rmr_sim.simulated_robot import SimulatedRobot
from rmr_sim.simulation import Simulation
from rmr_world.faults import fault_entry

PROCESS: Final = "sim"
MODE: Final = "simulated"


def simulation_writer(loaded: LoadedLab, seed: int | None, path: Path) -> RecordWriter:
    """Return the recording at `path` of the run of `seed` (None: the lab's)."""
    lab = loaded.lab
    about = about_run(lab.name, MODE, lab.seed if seed is None else seed, lab.roster, PROCESS)
    return RecordWriter(path, about)


class SimulationRecorder:
    """The recording of one simulated run."""

    def __init__(self, simulation: Simulation, loaded: LoadedLab, writer: RecordWriter) -> None:
        """Record `simulation`, which has not run yet."""
        lab = simulation.lab
        self.writer = writer
        self._simulation = simulation
        self._ticks = 0
        self._entries = 0
        self._faults = 0
        self._poses = PoseRecorder(writer)
        self._sent: dict[int, int] = {}
        """Requests of each robot's present incarnation: they are numbered from 1."""
        attach_files(self.writer, lab.arena, loaded.program.octets, lab.path, lab.program, lab.actions)
        self.writer.write("/scene", 0, scene(lab.arena, lab.roster))
        self.writer.write("/floor", 0, grid(lab.arena))
        for text in loaded.warnings:
            self.log(0, "warning", text.splitlines())
        self._observers = [RobotObserver(robot.robot, self.writer) for robot in simulation.robots]
        self._frames = {one.robot: FrameLog(one.robot, one.transmission) for one in self._observers}
        self._attach_to(simulation)

    def _attach_to(self, simulation: Simulation) -> None:
        for robot in simulation.robots:
            station = robot.station
            assert station.take is not None
            station.take = partial(self._taken, self._frames[robot.robot], station.take)
        simulation.ether.on_air = self._on_air
        simulation.subscribers.setdefault(Spoken, []).append(self._requested)
        simulation.before_restart.append(self._restarts)
        simulation.checkers.append(self.tick)

    # -- the radio --------------------------------------------------------------------------------------------

    def _requested(self, robot: int, now: Instant, spoken: Spoken) -> None:
        self._sent[robot] = number = self._sent.get(robot, 0) + 1
        self._frames[robot].requested(now, spoken.payload, number)

    def _on_air(self, announcement: Announcement) -> None:
        self._frames[announcement.source].announced(announcement)

    def _taken(self, frames: FrameLog, take: Callable[[Received | Confirmed], None], out: Received | Confirmed) -> None:
        if isinstance(out, Confirmed):
            frames.confirmed(self._simulation.now, out)
        take(out)

    def _restarts(self, robot: int) -> None:
        self._frames[robot].end()
        if not self._simulation.durable:  # a durable robot goes on counting its frames
            self._sent[robot] = 0

    # -- each tick --------------------------------------------------------------------------------------------

    def tick(self, now: Instant) -> None:
        """Look at the run at the end of a tick."""
        index = self._ticks
        self._ticks += 1
        self._take_faults(now)
        if index % POSES_TICKS == 0:
            world = self._simulation.world
            self._poses.take(now, ((robot, world.pose(robot)) for robot in self._simulation.lab.roster))
            for observer, robot in zip(self._observers, self._simulation.robots, strict=True):
                if robot.alive:
                    self._look(now, observer, robot)
            self._take_trace()

    def _look(self, now: Instant, observer: RobotObserver, robot: SimulatedRobot) -> None:
        node = robot.node
        observer.look(now, pose_of(node), route_of(node))
        if observer.status_due(now):
            observer.status(now, status_of(node, now, robot.station.queued))

    def _take_trace(self) -> None:
        entries = self._simulation.new_entries(self._entries)
        self._entries += len(entries)
        for entry in entries:
            # A replay yields those.
            if entry["what"] not in ("inserted", "removed"):
                self.writer.write("/trace", seconds(entry["t"]), entry)

    def _take_faults(self, now: Instant) -> None:
        records = self._simulation.fault_records
        for record in records[self._faults :]:
            if isinstance(record, Disturbance):
                fault: dict[str, Any] = fault_entry(record, self._simulation.lab.roster)
            else:
                fault = {"at": in_seconds(record.at), record.fault: record.robot}
                if record.until > record.at and record.fault not in ("killed", "restarted"):
                    fault["to"] = in_seconds(record.until)
            self.writer.write("/faults", now, {"fault": fault})
        self._faults = len(records)

    # -- log and end ------------------------------------------------------------------------------------------

    def log(self, now: Instant, level: str, lines: Iterable[str]) -> None:
        """Write log lines."""
        for line in lines:
            self.writer.write("/log", now, log_message(now, level, PROCESS, line))

    def close(self, report: bytes | None, lines: Iterable[str] = ()) -> None:
        """Write what has not been written yet, the warnings `lines` and the report of the run, and the index."""
        now = self._simulation.now
        self._simulation.take_traces()
        self._take_trace()
        self._take_faults(now)
        for frames in self._frames.values():
            frames.end()
        self.log(now, "warning", lines)
        if report is not None:
            self.writer.attach(REPORT, report, now)
        self.writer.close()
