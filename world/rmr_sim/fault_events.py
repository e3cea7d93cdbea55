"""The lab's faults as events of the simulation; those of the radio are in its ether from the beginning."""

from typing import TYPE_CHECKING

from rmr_sim.event import Event
from rmr_world.lab import Fault, Kill, Outage, Restart, Slow, Stall

if TYPE_CHECKING:
    from rmr_sim.simulation import Simulation


class FaultEvent(Event):
    """A fault befalls a robot; what lasts ends by itself."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.at if isinstance(fault, Kill | Restart) else fault.start)
        self.fault = fault

    def callback(self, simulation: "Simulation") -> None:
        """Let it befall the robot."""
        match self.fault:
            case Kill(robot=robot):
                simulation.kill(robot)
            case Restart(robot=robot):
                if simulation.is_dead(robot):  # else a user's event was faster
                    simulation.restart(robot)
            case Stall(end=end, robot=robot):
                simulation.stall(robot, end)
            case Slow(end=end, robot=robot, every=every):
                simulation.slow(robot, end, every)
            case Outage(end=end, robot=robot):
                simulation.silence(robot, end)
