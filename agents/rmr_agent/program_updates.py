"""New programs for a robot in its process: the endpoint of loads, between bus, radio and node.

An operator talks to the robot over the bus. Robots talk to each other over the radio: one that distributes a program,
and one that was away and asks. The host calls `advance` in each of its turns, before the node.
"""

import json
import logging
from collections.abc import Callable, Mapping
from typing import Final

from rmr.base.streams import stream
from rmr.base.time import NEVER, Instant, in_seconds
from rmr.bus import wire
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.load.load_endpoint import ALL, LOAD_HANDLE, OPERATOR, LoadEndpoint
from rmr.load.load_messages import LoadError
from rmr.load.program_loader import Preview, ProgramLoader, RunningProgram
from rmr.load.robot_fit import UnfitError, fitting_program
from rmr.mind.durable_node import DurableNode
from rmr.node.actions.dispatcher import Handler
from rmr.node.config import NodeConfig
from rmr.node.node import Node
from rmr.node.ports import Received
from rmr.radio.network import NetworkStation
from rmr.radio.station import Station
from rmr.vm.carrying import preview
from rmr_agent.bytecode import Loaded, RefusedError

log = logging.getLogger("rmr")


class ProgramUpdates:
    """The part of one incarnation that gets new programs."""

    def __init__(
        self,
        node: Node,
        config: NodeConfig,
        station: Station | NetworkStation,
        loaded: Loaded,
        handlers: Mapping[str, Handler],
        answer: Callable[[wire.Message], None],
        now: Callable[[], Instant],
        configure: Callable[[Program], NodeConfig] | None = None,
    ) -> None:
        """`answer` sends to the operator. `configure` is given for a robot that waits for its first program.

        It returns the node's configuration, and raises RefusedError if the facts of the lab do not fit the program.
        """
        self._configure = configure
        self._node = node
        self._config = config
        self._station = station
        self._loaded = loaded
        self._handlers = handlers
        self._answer = answer
        self._now = now
        self._began = False
        rng = stream(f"{config.seed}/robot{config.robot}/load")
        running = RunningProgram(loaded.octets, loaded.digest) if loaded.octets else None
        loader = ProgramLoader(config.robot, running, self._fit, self._preview, rng, station.payload_max)
        self.endpoint = LoadEndpoint(loader, self._send)

    def _fit(self, octets: bytes, digest: int) -> Program:
        try:
            return self._fitting(octets, digest)
        except UnfitError as error:
            log.warning("refuses to be loaded with program %08x: %s", digest, error)
            raise

    def _fitting(self, octets: bytes, digest: int) -> Program:
        if isinstance(self._node, DurableNode):
            raise UnfitError("its state on disk belongs to its program")
        try:
            if why := self._loaded.distrusts(octets):
                raise UnfitError(why)
        except codec.BytecodeError as error:
            raise UnfitError(str(error)) from error
        config = self._config
        program = fitting_program(octets, digest, config.arena, config.finish, self._handlers)
        if self._configure is not None:
            try:
                self._configure(program)
            except RefusedError as error:
                raise UnfitError(str(error)) from error
        return program

    def _preview(self, program: Program) -> Preview:
        carried, ended = preview(self._node.machine, program)
        return Preview(carried, tuple(ended))

    def _send(self, payload: bytes, destination: int) -> None:
        if destination == OPERATOR:
            self._answer(wire.Load(payload))
        else:
            self._station.request(self._now(), payload, None if destination == ALL else destination, LOAD_HANDLE)

    # -- what comes in ------------------------------------------------------------------------------------------

    def heard(self, now: Instant, frame: Received) -> None:
        """Handle a frame of another robot."""
        self.endpoint.received(now, frame.payload, frame.source)

    def told(self, now: Instant, body: wire.Message) -> None:
        """Handle a message of an operator."""
        if isinstance(body, wire.Load):
            self.endpoint.received(now, body.payload, OPERATOR)
        elif isinstance(body, wire.LoadOrder):
            try:
                digest = codec.digest(body.program)
                self.endpoint.coordinate(now, body.program, digest, body.robots, dry=body.dry, named=body.named)
            except (codec.BytecodeError, LoadError) as error:
                self._answer(wire.LoadOutcome(b"", str(error)))

    # -- turns --------------------------------------------------------------------------------------------------

    @property
    def next_wake(self) -> Instant:
        """When `advance` has something to do."""
        return self.endpoint.next_wake

    @property
    def waits(self) -> bool:
        """Whether the robot has no program yet."""
        return self.endpoint.loader.running is None

    def may_start(self, now: Instant) -> bool:
        """Return whether the node may be started: the robot knows which program the others run.

        A robot whose earlier process has died asks them, and waits for the answers.
        """
        if not self._began:
            self._began = True
            self.endpoint.loader.begin(now, away=self._config.epoch > 0 or self.waits)
        self.advance(now)
        return self.endpoint.loader.settled

    def advance(self, now: Instant) -> None:
        """Do what is due, and switch if that is."""
        if now >= self.endpoint.next_wake:
            self.endpoint.wake(now)
        switch = self.endpoint.switch(now)
        if switch is None:
            self._node.hold_offers(now, self.endpoint.loader.due < NEVER)
        else:
            if self._configure is not None:
                self._node.config = self._configure(switch.program)
                self._configure = None
            changed = self._node.change_program(now, switch.program, switch.running.digest)
            late = "" if now - switch.running.version < LATE else ", as it was away"
            log.info(
                "runs program %08x since %.3f s%s: keeps %d facts",
                switch.running.digest,
                in_seconds(now),
                late,
                changed.carried.facts,
            )
            for text in changed.ended():
                log.info("ended with the old program: %s", text)
            for text in changed.in_doubt:
                log.info("settled by the rules of the old program: %s", text)
        for result in self.endpoint.results:
            self._answer(wire.LoadOutcome(json.dumps(result.as_dict()).encode(), ""))
        self.endpoint.results.clear()


LATE: Final = 1_000_000_000
"""Delay after which a switch is one of a robot that was away."""
