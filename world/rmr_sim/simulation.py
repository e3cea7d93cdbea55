"""One simulated run: world, radios and nodes of a lab in virtual time.

The robots are the very nodes that a robot process hosts. Their radios share medium access and the rules of reception
with those of processes, but live in one ether, where no announcement is late. The world advances at each 1/60 s tick;
robots that stand still are sampled less often, as in processes.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from rmr.base.geometry import Twist
from rmr.base.kernel import EVENT, ROBOT, Alarm, Kernel
from rmr.base.streams import stream
from rmr.base.time import Instant, in_seconds, tick_start
from rmr.bytecode.program import Program
from rmr.coord.values import Values
from rmr.node.actions import Handler
from rmr.node.config import NodeConfig
from rmr.node.node import Node
from rmr.node.ports import Confirmed, Ports, Received, Sensed
from rmr.node.report import robot_report
from rmr.node.trace import Level
from rmr.radio.ether import Ether
from rmr.radio.security import LEVELS, Security, run_key
from rmr_sim.event import Event
from rmr_world.lab import Lab
from rmr_world.physics import World

IDLE_SAMPLE_TICKS = 6
"""A robot that stands still is sampled every sixth tick (10 Hz, the beacons' rate)."""


class SimulatedRobot:
    """A node with its station and its body in the world."""

    def __init__(self, simulation: "Simulation", robot: int, node_of: Any) -> None:
        self._simulation = simulation
        self.robot = robot
        seed = simulation.seed
        self.x, self.y, _ = simulation.world.pose(robot)
        self.station = simulation.ether.add(
            robot, stream(f"{seed}/robot{robot}/csma"), self._take, self.x, self.y, security=simulation.security(robot)
        )
        self._received: list[Received] = []
        self._confirmed: list[Confirmed] = []
        self._samples: list[Sensed] = []
        self.still = True
        self.node: Node = node_of(Ports(self, self))
        self.node_alarm = Alarm(simulation.kernel, ROBOT, self.tick)

    # -- the node's ports -------------------------------------------------------------------------------------

    @property
    def payload_max(self) -> int:
        """Octets that fit a frame."""
        return self.station.payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int) -> None:
        """Queue a frame."""
        self.station.request(payload, destination, handle)

    def receive(self) -> list[Received]:
        """Return the frames that have arrived."""
        received, self._received = self._received, []
        return received

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that have become known."""
        confirmed, self._confirmed = self._confirmed, []
        return confirmed

    def sense(self) -> list[Sensed]:
        """Return the new samples."""
        samples, self._samples = self._samples, []
        return samples

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Command the wheels."""
        self.still = twist.v == 0.0 and twist.w == 0.0
        self._simulation.world.act(self.robot, twist, stamp, self._simulation.kernel.now)

    # -- the host's part --------------------------------------------------------------------------------------

    def sample(self, now: Instant) -> None:
        """Take a sample of the world."""
        sample = self._simulation.world.sense(self.robot, now)
        self.x, self.y, _ = sample.truth
        self.station.move(self.x, self.y)
        self._samples.append(sample)

    def tick(self, now: Instant) -> None:
        """Let the node run, and see to what it wants next."""
        self.node.tick(now)
        self.node_alarm.set(max(self.node.next_wake, now + 1))

    def _take(self, out: Received | Confirmed) -> None:
        if isinstance(out, Confirmed):
            self._confirmed.append(out)
        else:
            self._received.append(out)
        self.node_alarm.set(self._simulation.kernel.now)


class Simulation:
    """A lab's run in virtual time."""

    def __init__(
        self,
        lab: Lab,
        program: Program,
        digest: int,
        seed: int,
        handlers: Mapping[str, Handler] | None = None,
        trace: Level = Level.NOTES,
        key: bytes | None = None,
        values: Values | None = None,
    ) -> None:
        """`key` is the lab's, where its radio is secured; `values` are those of coordination, where they are others.

        Raises `rmr.node.actions.MissingHandlers` when the program declares an action that nothing carries out.
        """
        self.lab = lab
        self._key = None if key is None else run_key(key, "simulator", lab.name, seed)
        self.seed = seed
        self.kernel = Kernel()
        self.world = World(lab, seed)
        self.radio = lab.radio.config
        radio_seed = seed if lab.radio.seed is None else lab.radio.seed
        self.ether = Ether(self.kernel, self.radio, radio_seed, lab.pan, lab.disturbances)
        self.observers: list[Callable[[Instant], None]] = []
        """Called with the instant of each tick when all has happened that belongs to it."""
        self._stopping = False
        self._trace: list[dict[str, Any]] = []
        facts = tuple((fact.name, fact.owner, fact.args) for fact in replace(lab, seed=seed).initial_facts)
        pattern = lab.finish_pattern
        finish = None if pattern is None else (pattern.name, pattern.patterns)
        roster = lab.roster

        def node_of(robot: int) -> Any:
            config = NodeConfig(
                robot,
                roster,
                lab.arena,
                seed,
                self.radio,
                facts,
                finish,
                trace=trace,
                values=values or Values(),
            )
            return lambda ports: Node(config, program, ports, handlers or {}, digest)

        self.robots = [SimulatedRobot(self, robot, node_of(robot)) for robot in roster]

    def security(self, robot: int) -> Security | None:
        """Return what secures the frames of `robot`; None: nothing does."""
        level = LEVELS[self.lab.radio.security]
        if level is None:
            return None
        assert self._key is not None, "a lab whose radio is secured comes with its key"
        return Security(level, self._key, robot)

    def run(self) -> bool:
        """Run until every robot holds the finish fact or the lab's duration is over; return whether all finished.

        A lab without a finish fact is finished when its duration is over.
        """
        for robot in self.robots:
            robot.node.start(0)
        index = 0
        while True:
            now = tick_start(index)
            self.kernel.run_until(now - 1 if now else 0)
            self.kernel.now = now
            self._tick(now, index)
            for observe in self.observers:
                observe(now)
            if self.lab.finish and all(robot.node.finished() for robot in self.robots):
                return True
            if now >= self.lab.duration:
                return not self.lab.finish
            if self._stopping:
                return False
            index += 1

    def schedule(self, event: Event) -> None:
        """Let `event` happen at its instant."""
        self.kernel.at(event.at, EVENT, lambda _now: event.callback(self))

    def stop(self) -> None:
        """End the run after the present tick; it has not finished then."""
        self._stopping = True

    def _tick(self, now: Instant, index: int) -> None:
        self.world.step(now)
        for robot in self.robots:
            if robot.still and (index + robot.robot) % IDLE_SAMPLE_TICKS:
                if robot.node.next_wake <= now:
                    robot.tick(now)
                continue
            robot.sample(now)
            robot.tick(now)
        self._take_traces()

    def _take_traces(self) -> None:
        """Take over what the robots noted, of which they themselves keep the newest part alone."""
        for robot in self.robots:
            self._trace += robot.node.trace_log
            robot.node.trace_log.clear()

    @property
    def now(self) -> Instant:
        """Virtual time."""
        return self.kernel.now

    def robot_parts(self) -> dict[int, dict[str, Any]]:
        """Return every robot's part of the report."""
        parts: dict[int, dict[str, Any]] = {}
        for robot in self.robots:
            part = robot_report(robot.node, robot.station.counters.as_dict())
            part["distance_m"] = round(self.world.distance_m(robot.robot), 3)
            parts[robot.robot] = part
        return parts

    @property
    def time_s(self) -> float:
        """From the first tick to the last robot's finish, seconds of lab time."""
        ends = [robot.node.finish_at for robot in self.robots]
        known = [end for end in ends if end is not None]
        return in_seconds(max(known) if len(known) == len(ends) else self.now)

    def trace(self) -> list[dict[str, Any]]:
        """Return what the robots noted, in order of time, then of their ids."""
        self._take_traces()
        return sorted(self._trace, key=lambda entry: (entry["t"], entry["robot"]))
