"""The loads of a lab in the simulator: at its instant a robot begins to distribute the program over the robots' radio.

The robot is the first of those that get the program and whose process runs. What became of a load stands in the report.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rmr.base.time import Instant, in_seconds
from rmr.load.load_endpoint import BUSY
from rmr.load.load_messages import LoadError
from rmr.load.program_loader import RunningProgram
from rmr.node.actions.dispatcher import Handler
from rmr_sim.event import Event
from rmr_sim.robot_programs import RobotPrograms
from rmr_sim.simulated_robot import SimulatedRobot
from rmr_sim.simulation import Simulation
from rmr_world.lab import ProgramLoad
from rmr_world.lab_program import LoadedProgram

NOBODY: Final = "no robot that gets it runs"


class LoadEvent(Event):
    """A robot begins to distribute a program."""

    def __init__(self, loads: "ProgramLoads", load: ProgramLoad, program: LoadedProgram) -> None:
        super().__init__(load.at)
        self._loads = loads
        self._load = load
        self._program = program

    def callback(self, simulation: Any) -> None:
        """Let the first robot that can distribute the program."""
        self._loads.begin(simulation.now, self._load, self._program)


class ProgramLoads:
    """All loads of one run."""

    def __init__(self, simulation: Simulation, first: LoadedProgram, handlers: Mapping[str, Handler]) -> None:
        self._simulation = simulation
        self._under_way: dict[int, dict[str, Any]] = {}
        """By robot that distributes it, the entry of the report."""
        running = RunningProgram(first.octets, first.digest)
        for robot in simulation.robots:
            robot.programs = RobotPrograms(robot, simulation.kernel, simulation.seed, running, handlers, self._switched)
        simulation.checkers.append(self._look)

    def begin(self, now: Instant, load: ProgramLoad, program: LoadedProgram) -> None:
        """Begin a load."""
        roster = self._simulation.lab.roster
        wanted = load.robots or roster
        entry: dict[str, Any] = {"begin_s": round(in_seconds(now), 3), "file": load.program.name}
        self._simulation.loads.append(entry)
        able = [robot for robot in self._simulation.robots if robot.robot in wanted and self._can(robot)]
        if not able:
            self._failed(entry, program, wanted, NOBODY)
            return
        robot = able[0]
        assert robot.programs is not None
        try:
            robot.programs.coordinate(now, program.octets, program.digest, wanted, named=bool(load.robots))
        except LoadError as error:
            self._failed(entry, program, wanted, str(error) or BUSY)
            return
        entry["by"] = robot.robot
        self._under_way[robot.robot] = entry

    @staticmethod
    def _can(robot: SimulatedRobot) -> bool:
        return robot.reachable and robot.programs is not None and not robot.programs.awaited

    @staticmethod
    def _failed(entry: dict[str, Any], program: LoadedProgram, robots: Sequence[int], why: str) -> None:
        entry |= {"program": f"{program.digest:08x}", "switched": False, "at_s": None}
        entry["robots"] = {str(robot): {"ready": False, "problem": why} for robot in robots}

    def _switched(self, robot: int, now: Instant, running: RunningProgram) -> None:
        self._simulation.program_switched(robot, now, running.digest, late=now > running.version)

    def _look(self, _now: Instant) -> None:
        """Take the results that have come, and end the loads whose robot has died."""
        for robot in self._simulation.robots:
            entry = self._under_way.get(robot.robot)
            if entry is None or robot.programs is None:
                continue
            results = robot.programs.endpoint.results
            if results:
                entry |= results.pop().as_dict()
                del self._under_way[robot.robot]
            elif robot.programs.endpoint.coordinator is None:
                entry |= {"switched": None, "problem": f"robot {robot.robot}, which distributed it, has died"}
                del self._under_way[robot.robot]


def attach_loads(
    simulation: Simulation, first: LoadedProgram, loads: Sequence[tuple[ProgramLoad, LoadedProgram]], handlers: Any
) -> None:
    """Let `simulation`, which has not run yet, perform `loads`; `first` is the program of its robots."""
    all_loads = ProgramLoads(simulation, first, handlers)
    for load, program in loads:
        simulation.schedule(LoadEvent(all_loads, load, program))
