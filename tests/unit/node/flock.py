"""Robots without bodies in virtual time: nodes, a link that carries frames in 5 ms, and faults to order."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random
from textwrap import dedent
from typing import Any

from rmr.base.arena import NOWHERE
from rmr.base.kernel import RADIO, ROBOT, Alarm, Kernel
from rmr.base.time import NEVER, Instant, milliseconds, seconds
from rmr.base.values import Value
from rmr.bytecode.codec import decode, encode
from rmr.bytecode.program import Kind, Program
from rmr.lang.compiler import compile_source
from rmr.node.actions.dispatcher import ActionFailed, Handler, RobotHandle
from rmr.node.config import NodeConfig
from rmr.node.node import Node
from rmr.node.payloads import PAYLOAD_OCTETS_MAX
from rmr.node.ports import Confirmed, Ports, Received
from rmr.node.trace import TraceLevel

LATENCY = milliseconds(5)

Passes = Callable[[Instant, int, int, bytes], bool]
"""Whether a frame gets through: (now, source, destination, payload)."""


class _Robot:
    """A node's link and its timer."""

    payload_max = PAYLOAD_OCTETS_MAX

    def __init__(self, flock: "Flock", robot: int, node_of: Callable[[Ports], Node], ports: dict[str, Any]) -> None:
        self.flock = flock
        self.robot = robot
        self.received: list[Received] = []
        self.confirmed: list[Confirmed] = []
        self.node = node_of(Ports(self, None, **ports))
        self.alarm = Alarm(flock.kernel, ROBOT, self.tick)

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: int = NEVER) -> None:
        targets = [destination] if destination is not None else [r for r in self.flock.robots if r != self.robot]
        now = self.flock.kernel.now
        for target in targets:
            if self.flock.passes(now, self.robot, target, payload):
                self.flock.kernel.at(now + LATENCY, RADIO, self._arrival(target, payload, destination is not None))
        self.flock.kernel.at(now + LATENCY, RADIO, self._confirmation(handle))

    def _arrival(self, target: int, payload: bytes, unicast: bool) -> Callable[[Instant], None]:
        def arrive(now: Instant) -> None:
            robot = self.flock.robots[target]
            robot.received.append(Received(payload, self.robot, unicast, -50.0, 255, now))
            robot.alarm.set(now)

        return arrive

    def _confirmation(self, handle: int) -> Callable[[Instant], None]:
        def confirm(now: Instant) -> None:
            self.confirmed.append(Confirmed(handle, "ok"))
            self.alarm.set(now)

        return confirm

    def receive(self) -> list[Received]:
        received, self.received = self.received, []
        return received

    def confirmations(self) -> list[Confirmed]:
        confirmed, self.confirmed = self.confirmed, []
        return confirmed

    def tick(self, now: Instant) -> None:
        self.node.tick(now)
        self.flock.busy[self.robot] = bool(self.node.outstanding)
        self.alarm.set(max(self.node.next_wake, now + 1))


class Flock:
    """Robots 1.. that run one program; every action takes `action_s` seconds, and `action_s` < 0 makes it fail."""

    def __init__(
        self,
        source: str,
        robots: int | Sequence[int] = 2,
        *,
        action_s: float = 0.0,
        failing: Sequence[str] = (),
        passes: Passes = lambda *_: True,
        debug: bool = True,
        trace: TraceLevel = TraceLevel.FACTS,
        roster: Sequence[int] = (),
        epoch: int = 0,
        predecessor_ended: Instant | None = None,
        **ports: Any,
    ) -> None:
        compilation = compile_source(dedent(source), "flock.rmr")
        assert compilation.program is not None, compilation.diagnostics
        self.program: Program = decode(encode(compilation.program, debug=debug))
        self.kernel = Kernel()
        self.passes = passes
        self.busy: dict[int, bool] = {}
        ids = tuple(robots) if isinstance(robots, Sequence) else tuple(range(1, robots + 1))

        def handler(name: str) -> Handler:
            async def perform(robot: RobotHandle, *_args: Value) -> None:
                if action_s > 0:
                    await robot.sleep(action_s)
                if name in failing:
                    raise ActionFailed("as told")

            return Handler(name, perform)

        handlers = {p.name: handler(p.name) for p in self.program.predicates if p.kind is Kind.ACTION}
        turn = max(seconds(action_s), milliseconds(10))

        def node_of(robot: int) -> Callable[[Ports], Node]:
            config = NodeConfig(robot, tuple(roster) or ids, NOWHERE, 1, epoch=epoch, trace=trace, turn=turn)
            life = replace(config, predecessor_ended=predecessor_ended)
            return lambda given: Node(life, self.program, given, handlers, 7)

        self.robots = {robot: _Robot(self, robot, node_of(robot), ports) for robot in ids}
        for robot in self.robots.values():
            robot.node.start(0)
            robot.alarm.set(0)
            self.busy[robot.robot] = True

    @property
    def now_s(self) -> float:
        return self.kernel.now / 1e9

    def node(self, robot: int) -> Node:
        return self.robots[robot].node

    def run(self, until_s: float = 60.0) -> "Flock":
        """Run until nothing is outstanding any more, at the latest until `until_s`."""
        step = milliseconds(1)
        while any(self.busy.values()) and self.kernel.now < seconds(until_s):
            self.kernel.run_until(min(self.kernel.now + step, seconds(until_s)))
        return self

    def wait(self, until_s: float) -> "Flock":
        """Run until `until_s` whether or not anything is outstanding."""
        self.kernel.run_until(seconds(until_s))
        return self

    def insert(self, robot: int, name: str, *args: Value) -> None:
        """Insert a fact from outside."""
        self.node(robot).insert(self.kernel.now, name, args)
        self.robots[robot].alarm.set(self.kernel.now)
        self.busy[robot] = True

    def facts(self, robot: int) -> list[str]:
        return self.node(robot).machine.facts()

    def noted(self, robot: int, what: str) -> list[dict[str, Any]]:
        """Return a robot's notes of one kind."""
        return [entry for entry in self.node(robot).trace_log if entry["what"] == what]


def losing(rng: Random, loss: float) -> Passes:
    """Return a link that loses every frame with the same probability."""
    return lambda *_: rng.random() >= loss
