"""The lab's faults of robots as events of the simulation; disturbances of the radio are set from the beginning."""

from typing import Protocol

from rmr.base.time import Duration, Instant
from rmr_sim.event import Event
from rmr_world.lab import Fault, Kill, Outage, Restart, Slow, Stall


class FaultTarget(Protocol):
    """The methods of `Simulation` that faults call."""

    def kill(self, robot: int) -> None:
        """Kill the process of `robot`."""

    def is_dead(self, robot: int) -> bool:
        """Return whether `robot` has been killed and not been restarted."""

    def restart(self, robot: int) -> None:
        """Start `robot` again, without memory."""

    def stall(self, robot: int, until: Instant) -> None:
        """Stop the process of `robot` until `until`."""

    def slow(self, robot: int, until: Instant, every: Duration) -> None:
        """Call the node of `robot` once in `every` nanoseconds only, until `until`."""

    def silence(self, robot: int, until: Instant) -> None:
        """Let `robot` receive no localisation pulse until `until`."""


class FaultEvent(Event):
    """A fault of a robot happens. A fault with an end ends by itself."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.at if isinstance(fault, Kill | Restart) else fault.start)
        self.fault = fault

    def callback(self, simulation: FaultTarget) -> None:
        """Apply the fault."""
        match self.fault:
            case Kill(robot=robot):
                simulation.kill(robot)
            case Restart(robot=robot):
                if simulation.is_dead(robot):  # a user's event may have restarted it already
                    simulation.restart(robot)
            case Stall(end=end, robot=robot):
                simulation.stall(robot, end)
            case Slow(end=end, robot=robot, every=every):
                simulation.slow(robot, end, every)
            case Outage(end=end, robot=robot):
                simulation.silence(robot, end)
