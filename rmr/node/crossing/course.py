"""The course of a crossing: the place that the robot has taken, until its route there is planned."""

from dataclasses import dataclass

from rmr.base.geometry import Point
from rmr.base.time import Instant


@dataclass(slots=True)
class Course:
    """Where the robot is sent while it is under way."""

    destination: Point | None = None
    """The place that the robot has taken, until its route there is planned."""
    planned_at: Instant = 0
    """When a route was planned last."""
    replan_from: Instant = 0
    """Before the entrance a route is planned from then on, since the newest slot is near."""

    def send(self, destination: Point | None) -> None:
        """Send the robot to `destination`; None: no longer anywhere else."""
        self.destination = destination

    def planned(self, now: Instant) -> None:
        """Note that a route has been planned."""
        self.destination = None
        self.planned_at = now
