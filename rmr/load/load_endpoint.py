"""A robot's end of the distribution of programs: its loader, and the coordinator while it distributes one itself.

The host hands over what arrives, and sends what leaves: to robots over the radio, to an operator over the bus. What a
robot says to itself, as the coordinator of a load that concerns itself, never leaves.
"""

from collections.abc import Callable, Collection
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.load.load_coordinator import LoadCoordinator, LoadResult
from rmr.load.load_messages import LoadError
from rmr.load.load_pace import BUS_OCTETS_MAX, radio_pace
from rmr.load.program_loader import Out, ProgramLoader, Switch

OPERATOR: Final = -2
"""The sender of what comes over the bus, as on the bus itself."""
BUSY: Final = "the robot distributes another program: wait for its end"

Send = Callable[[bytes, int], None]
"""Sends a payload to a robot, to all (`ALL`), or to the operator (`OPERATOR`)."""
LOAD_HANDLE: Final = 0
"""Handle of the frames by which programs are distributed; those of a node are numbered from 1."""
ALL: Final = -3


class LoadEndpoint:
    """One robot's part in loads."""

    def __init__(self, loader: ProgramLoader, send: Send) -> None:
        self.loader = loader
        self.coordinator: LoadCoordinator | None = None
        self.results: list[LoadResult] = []
        """Of the loads that this robot has coordinated; the host clears it."""
        self._send = send

    @property
    def next_wake(self) -> Instant:
        """When `wake` has something to do."""
        coordinating = NEVER if self.coordinator is None else self.coordinator.next_wake
        return min(self.loader.next_wake, coordinating)

    def coordinate(
        self,
        now: Instant,
        program: bytes,
        digest: int,
        robots: Collection[int],
        *,
        dry: bool = False,
        named: bool = False,
    ) -> None:
        """Distribute a program over the radio. Raises LoadError if another one is under way, or it is too large."""
        if self.coordinator is not None:
            raise LoadError(BUSY)
        pace = radio_pace(self.loader.octets_max)
        self.coordinator = LoadCoordinator(program, digest, robots, pace, dry=dry, named=named)
        self.coordinator.start(now)
        self._deal(now)

    def received(self, now: Instant, payload: bytes, source: int) -> None:
        """Handle a message of another robot or an operator."""
        if self.coordinator is not None:
            self.coordinator.received(now, payload, source)
        self.loader.received(now, payload, source)
        self._deal(now)

    def wake(self, now: Instant) -> None:
        """Do what is due, but for the switch: for that the host asks `switch`."""
        if self.coordinator is not None and now >= self.coordinator.next_wake:
            self.coordinator.wake(now)
        if now >= self.loader.next_wake:
            self.loader.wake(now)
        self._deal(now)

    def switch(self, now: Instant) -> Switch | None:
        """Return the switch that is due; None if there is none."""
        return self.loader.take(now) if self.loader.due <= now else None

    def _deal(self, now: Instant) -> None:
        """Send what is to leave, and pass on what the robot says to itself."""
        coordinator = self.coordinator
        while self.loader.out or (coordinator is not None and coordinator.out):
            if coordinator is not None:
                said, coordinator.out = coordinator.out, []
                for out in said:
                    self._leave(now, out, by_coordinator=True)
            answers, self.loader.out = self.loader.out, []
            for out in answers:
                self._leave(now, out, by_coordinator=False)
        if coordinator is not None and coordinator.result is not None:
            self.results.append(coordinator.result)
            self.coordinator = None

    def _leave(self, now: Instant, out: Out, *, by_coordinator: bool) -> None:
        own = self.loader.robot
        octets_max = BUS_OCTETS_MAX if out.destination == OPERATOR else self.loader.octets_max
        payload = out.message.encode(octets_max)
        if by_coordinator and out.destination in (None, own):
            self.loader.received(now, payload, own)
        if out.destination != own:
            self._send(payload, ALL if out.destination is None else out.destination)
        elif not by_coordinator and self.coordinator is not None:
            self.coordinator.received(now, payload, own)
