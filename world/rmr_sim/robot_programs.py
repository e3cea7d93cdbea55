"""A simulated robot's part in the distribution of programs: the endpoint of loads, between its radio and its node.

It is there only in a lab with loads: without, no frame is sent and nothing is asked, so that runs stay as they are. A
stopped robot hears nothing; a slow one takes part as always, for its radio runs by itself.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

from rmr.base.kernel import ROBOT, Alarm, Kernel
from rmr.base.streams import stream
from rmr.base.time import NEVER, Instant, milliseconds
from rmr.bytecode.program import Program
from rmr.load.load_endpoint import ALL, LOAD_HANDLE, LoadEndpoint
from rmr.load.program_loader import Preview, ProgramLoader, RunningProgram
from rmr.load.robot_fit import fitting_program
from rmr.node.actions.dispatcher import Handler
from rmr.node.node import Node
from rmr.node.ports import Received
from rmr.vm.carrying import preview


class LoadedRobot(Protocol):
    """What is needed of the robot."""

    robot: int
    node: Node

    @property
    def payload_max(self) -> int:
        """Octets that fit a frame."""

    @property
    def reachable(self) -> bool:
        """Whether its process runs."""

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Queue a frame."""

    def change_program(self, now: Instant, program: Program, digest: int) -> None:
        """Let the node go on with another program."""

    def hold_offers(self, now: Instant, *, held: bool) -> None:
        """Let the node offer nothing by ensemble rules while `held`."""

    def begin(self, now: Instant) -> None:
        """Start the node."""


class RobotPrograms:
    """The endpoint of one robot."""

    def __init__(
        self,
        robot: LoadedRobot,
        kernel: Kernel,
        seed: int,
        first: RunningProgram,
        handlers: Mapping[str, Handler],
        switched: Callable[[int, Instant, RunningProgram], None],
    ) -> None:
        """`first` is the program that the robot is started with; `switched` is told of every switch."""
        self._robot = robot
        self._kernel = kernel
        self._seed = seed
        self._first = first
        self._handlers = handlers
        self._switched = switched
        self._starts = 0
        self.awaited = False
        """Whether the node waits to be started until the robot knows which program the others run."""
        self._alarm = Alarm(kernel, ROBOT, self._wake)
        self.endpoint = self._endpoint()

    def _endpoint(self) -> LoadEndpoint:
        robot = self._robot
        rng = stream(f"{self._seed}/robot{robot.robot}/load")
        loader = ProgramLoader(robot.robot, self._first, self._fit, self._preview, rng, robot.payload_max)
        return LoadEndpoint(loader, self._send)

    def _fit(self, octets: bytes, digest: int) -> Program:
        config = self._robot.node.config
        return fitting_program(octets, digest, config.arena, config.finish, self._handlers)

    def _preview(self, program: Program) -> Preview:
        carried, ended = preview(self._robot.node.machine, program)
        return Preview(carried, tuple(ended))

    def _send(self, payload: bytes, destination: int) -> None:
        self._robot.transmit(payload, None if destination == ALL else destination, LOAD_HANDLE)

    # -- the robot ----------------------------------------------------------------------------------------------

    def killed(self) -> None:
        """Forget everything: the process is gone."""
        self.awaited = False
        self._alarm.set(NEVER)

    def restarted(self, now: Instant) -> None:
        """Begin anew with the first program, and ask the others before the node starts."""
        self.endpoint = self._endpoint()
        self.awaited = True
        self.endpoint.loader.begin(now, away=True)
        self._wake(now)

    def received(self, frame: Received) -> None:
        """Handle a frame; a stopped robot loses it."""
        if self._robot.reachable:
            now = self._kernel.now
            self.endpoint.received(now, frame.payload, frame.source)
            self._wake(now)

    def coordinate(self, now: Instant, octets: bytes, digest: int, robots: tuple[int, ...], *, named: bool) -> None:
        """Distribute a program to `robots`. Raises LoadError."""
        self.endpoint.coordinate(now, octets, digest, robots, named=named)
        self._wake(now)

    def _wake(self, now: Instant) -> None:
        if not self._robot.reachable:
            self._alarm.set(now + milliseconds(50))  # interval at which a stopped robot is looked at again
            return
        self.endpoint.wake(now)
        due = self.endpoint.switch(now)
        if due is None:
            self._robot.hold_offers(now, held=self.endpoint.loader.due < NEVER)
        else:
            self._robot.change_program(now, due.program, due.running.digest)
            self._switched(self._robot.robot, now, due.running)
        if self.awaited and self.endpoint.loader.settled:
            self.awaited = False
            self._robot.begin(now)
        wake = self.endpoint.next_wake
        self._alarm.set(wake if wake == NEVER else max(wake, now + 1))
