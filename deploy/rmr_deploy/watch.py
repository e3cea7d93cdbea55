"""What the launcher hears on the bus of the run: the latest status of everybody, and the truth of the world.

The launcher is one more client of the star. It knows only what the processes say; whether a process lives at
all is the supervisor's knowledge. Nothing is asked for again: statuses come several times a second, and the last
one of each sender is marked as final.
"""

from collections.abc import Mapping
from typing import Any

from rmr.base.time import Instant, in_seconds
from rmr.bus import wire
from rmr.bus.keys import WORLD, Keys
from rmr.bus.session import Bus, open_when_there

AT_WORK = ("ready", "running", "finished")
"""States of a robot that has its program, its place and its clock."""


class Watch:
    """The newest word of each process of a lab."""

    def __init__(self, bus: Bus, lab: str) -> None:
        self._bus = bus
        self._keys = Keys(lab)
        self.robots: dict[int, wire.Status] = {}
        self.world: wire.Status | None = None
        self.truth: wire.Truth | None = None
        bus.subscribe(self._keys.statuses, self._status)
        bus.subscribe(self._keys.truth, self._truth)

    @classmethod
    async def of(cls, lab: str, endpoint: str) -> "Watch":
        """Return the watch of `lab` as soon as its router answers at `endpoint`."""
        return cls(await open_when_there(wire.OPERATOR_ID, endpoint, lambda: None), lab)

    def _status(self, _key: str, message: wire.Envelope) -> None:
        if not isinstance(message.body, wire.Status):
            return
        if message.sender == wire.WORLD_ID:
            self.world = message.body
        elif message.sender >= 0:
            self.robots[message.sender] = message.body

    def _truth(self, _key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.Truth):
            self.truth = message.body

    @property
    def now(self) -> Instant:
        """The newest lab time heard of; 0 before the lab clock runs."""
        stamps = [status.stamp for status in self.robots.values()]
        stamps += [said.stamp for said in (self.world, self.truth) if said is not None]
        return max(stamps, default=0)

    @property
    def now_s(self) -> float:
        """Likewise, in seconds."""
        return in_seconds(self.now)

    def ready(self, roster: tuple[int, ...]) -> bool:
        """Whether every robot of `roster` is ready, or at work already."""
        return all(self._state(robot) in AT_WORK for robot in roster)

    def running(self, roster: tuple[int, ...]) -> bool:
        """Whether the lab clock runs for a robot of `roster`."""
        return any(self._state(robot) in AT_WORK[1:] for robot in roster)

    def finished(self, roster: tuple[int, ...]) -> bool:
        """Whether every robot of `roster` holds the finish fact."""
        return all((status := self.robots.get(robot)) is not None and status.finished for robot in roster)

    def final(self, robot: int) -> bool:
        """Whether `robot` has said its last."""
        status = self.robots.get(robot)
        return status is not None and status.final

    def report(self, robot: int) -> Mapping[str, Any]:
        """Return the robot's part of the report as last heard; empty when nothing was."""
        status = self.robots.get(robot)
        return {} if status is None else status.report

    def _state(self, robot: int) -> str:
        status = self.robots.get(robot)
        return "starting" if status is None else status.state

    def line(self, robot: int) -> tuple[str, str]:
        """Return the robot's state and its progress for people."""
        status = self.robots.get(robot)
        return ("starting", "") if status is None else (status.state, status.progress)

    def ask_to_stop(self, who: int | str, reason: str) -> None:
        """Ask a robot, or the world, for an orderly end."""
        self._bus.publish(self._keys.stop(who), wire.Stop(reason))

    def ask_world_to_stop(self, reason: str) -> None:
        """Ask the world for an orderly end."""
        self.ask_to_stop(WORLD, reason)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()
