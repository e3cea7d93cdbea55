"""One simulated robot: its node and its radio station, and the part of a process that hosts them.

The host hands over samples and frames and calls the node: at each tick while the robot drives, else at the time that
the node asks for. A fault of the process changes what the host does, and costs nothing in its absence:

    state    calls of the node        station          input in the meantime
    served   as the node asks         on               handed over at once
    slow     once in a given time     on               queued until the call
    stalled  none                     held             queued, as in a stopped process
    dead     none, never again        off              lost

The body is not affected: it stays in the world, and its wheels brake when no command has come for a while
(`robot_body.WATCHDOG`). A restarted robot has a new node, of the next epoch, and a station without memory. The counters
and actions of its earlier nodes stay in the report. A durable robot's node is brought back from its disk instead.
"""

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeVar

from rmr.base.geometry import Pose, Twist
from rmr.base.kernel import EVENT, ROBOT, Alarm
from rmr.base.streams import stream
from rmr.base.time import NEVER, Duration, Instant
from rmr.base.values import Value
from rmr.bytecode.program import Program
from rmr.mind.recorded_node import RecordedNode
from rmr.node.node import Node
from rmr.node.payloads import LOAD_OCTET
from rmr.node.ports import FRAMES_MAX, SAMPLES_MAX, Confirmed, Ports, Received, Sensed
from rmr.node.report import off_m, robot_report
from rmr_sim.robot_host import RobotHost
from rmr_world.incarnations import merged_report, with_lost_jobs

if TYPE_CHECKING:  # loaded by the runs that have such robots
    from rmr_sim.disk import Disk
    from rmr_sim.robot_programs import RobotPrograms
from collections.abc import Mapping

from rmr.bytecode.program import Kind
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler
from rmr_world.lab import Lab

SENSED_BY_BODIES: Final = frozenset({"at", "pose", "obstacle", "neighbor", "range", "silent"})
"""Facts that need a body. Neighbors are known from hellos, which carry a position."""


def needs_bodies(lab: Lab, program: Program, handlers: Mapping[str, Handler]) -> bool:
    """Return whether anything in the run may depend on wheels or senses.

    A user's handlers may use both. An effect on a sensed predicate holds only while nothing senses it.
    """
    if lab.finish_pattern is not None and lab.finish_pattern.name in SENSED_BY_BODIES:
        return True
    for predicate in program.predicates:
        if predicate.kind is Kind.SENSED and predicate.name in SENSED_BY_BODIES:
            return True
        if predicate.kind is Kind.ACTION:
            provided = None if predicate.name in handlers else PROVIDED.get(predicate.name)
            if provided is None or provided.wheels or provided.at_once:
                return True
            effects = (*predicate.effects, *predicate.else_effects)
            if any(program.predicates[effect.predicate].kind is Kind.SENSED for effect in effects):
                return True
    return False


T = TypeVar("T")

MakeNode = Callable[[Ports, int, Instant | None], Node]
"""Makes the node of an incarnation from the robot's ports, its epoch, and when the one before it was killed."""


def _taken(queue: deque[T]) -> list[T]:
    """Empty `queue` and return its items."""
    taken = list(queue)
    queue.clear()
    return taken


class SimulatedRobot:
    """A node with its station and its body in the world."""

    def __init__(
        self, host: RobotHost, robot: int, make_node: MakeNode, bodily: bool, disk: "Disk | None" = None
    ) -> None:
        """A robot without a body (`bodily`) is not sampled. One with a `disk` goes on from there when it restarts."""
        self._disk = disk
        self.restarts = 0
        """Number of restarts so far."""
        self.bodily = bodily
        self._host = host
        self._make_node = make_node
        self.robot = robot
        self.x, self.y, _ = host.world.pose(robot)
        rng = stream(f"{host.seed}/robot{robot}/csma")
        self.station = host.ether.add(robot, rng, self._take, self.x, self.y, security=host.security(robot, 0))
        self._samples: deque[Sensed] = deque(maxlen=SAMPLES_MAX)
        self._received: deque[Received] = deque(maxlen=FRAMES_MAX)
        self._confirmed: deque[Confirmed] = deque(maxlen=FRAMES_MAX)
        self.alive = True
        self.served = True
        """Whether the host serves the robot normally: neither dead, stalled nor slow."""
        self._killed_at: Instant | None = None
        self._stalled_until: Instant = 0
        self._slow_until: Instant = 0
        self._every: Duration = 0
        self.node = make_node(self._ports, 0, None)
        self.node_alarm = Alarm(host.kernel, ROBOT, self.tick)
        self._slow_alarm = Alarm(host.kernel, ROBOT, self._slow_tick)
        self._called: Instant = NEVER
        """Wake-up time that the host has been told, of a robot without a body; NEVER if none."""
        self._samples_dropped = 0
        self._frames_dropped = 0
        """Samples and frames of this incarnation that full queues have dropped."""
        self.programs: RobotPrograms | None = None
        """The robot's part in the distribution of programs; None in a lab without loads."""
        self._past: list[dict[str, Any]] = []
        """Parts of the report of the earlier incarnations, the oldest first."""

    # -- the node's ports -------------------------------------------------------------------------------------

    @property
    def _ports(self) -> Ports:
        return Ports(self, self if self.bodily else None)

    @property
    def payload_max(self) -> int:
        """Octets that fit a frame."""
        return self.station.payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Queue a frame."""
        self.station.request(payload, destination, handle, due)

    def receive(self) -> list[Received]:
        """Return the frames that have arrived."""
        return _taken(self._received) if self._received else []

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that have become known."""
        return _taken(self._confirmed) if self._confirmed else []

    def sense(self) -> list[Sensed]:
        """Return the new samples."""
        return _taken(self._samples) if self._samples else []

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Command the wheels."""
        self._host.world.act(self.robot, twist, stamp, self._host.kernel.now)

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        """Do nothing: a simulated body has no driver of its own, and is not asked."""

    # -- the host's part --------------------------------------------------------------------------------------

    def sample(self, now: Instant) -> None:
        """Take a sample of the world."""
        sample = self._host.world.sense(self.robot, now)
        self.x, self.y, _ = sample.truth
        self.station.move(self.x, self.y)
        if len(self._samples) == SAMPLES_MAX:
            self._samples_dropped += 1
        self._samples.append(sample)

    def tick(self, now: Instant) -> None:
        """Call the node, and arrange its next call."""
        self.node.tick(now)
        if self.node.notes.entries:
            self._host.take_trace(self.node)
        self.wake_in_frame(now)

    def wake_in_frame(self, now: Instant) -> None:
        """Arrange the node's next call if it is due before the next tick, at which all robots are served anyway."""
        wake = self.node.next_wake
        if wake < self._host.frame_end:
            self.node_alarm.set(wake if wake > now else now + 1)
            return
        if self.node_alarm.when < NEVER:
            self.node_alarm.set(NEVER)
        if not self.bodily and wake != self._called:
            self._called = wake
            if wake < NEVER:
                self._host.call(self.station.index, wake)

    def _take(self, out: Received | Confirmed) -> None:
        if isinstance(out, Confirmed):
            if not self.node.awaits(out):
                return
            if len(self._confirmed) == FRAMES_MAX:
                self._frames_dropped += 1
            self._confirmed.append(out)
        elif self.programs is not None and out.payload[:1] == LOAD_OCTET:
            self.programs.received(out)
            return
        elif self.served and not self._received and self.node.overhear(self._host.kernel.now, out):
            return
        else:
            if len(self._received) == FRAMES_MAX:
                self._frames_dropped += 1
            self._received.append(out)
        if self.served:
            self.node_alarm.set(self._host.kernel.now)

    def insert(self, name: str, args: tuple[Value, ...]) -> None:
        """Insert a fact from outside; a dead robot holds none. Raises ValueError if the program cannot hold it."""
        if self.alive:
            now = self._host.now
            self.node.insert(now, name, args)
            if self.served:
                self.node_alarm.set(now)

    def facts(self, name: str) -> list[tuple[Value, ...]]:
        """Return the arguments without the owner of the facts of predicate `name` that hold, oldest first.

        A dead robot holds none. Raises ValueError if the program has no such predicate.
        """
        index = self.node.program.index(name)
        if index is None:
            raise ValueError(f"the program knows no predicate {name}")
        return list(self.node.machine.held(index)) if self.alive else []

    def finished(self) -> bool:
        """Return whether it lives and holds the finish fact."""
        return self.alive and self.node.finished()

    # -- faults -----------------------------------------------------------------------------------------------

    def kill(self) -> None:
        """Kill the process: its node is not called any more and its station is off."""
        if self.alive:
            self._killed_at = self._host.now
        self.alive = False
        if self._disk is not None:
            self._disk.end(self.node)
        else:
            self.end_log()
        self._stalled_until = self._slow_until = 0
        self.station.switch_off()
        if self.programs is not None:
            self.programs.killed()
        self._settle(self._host.now)

    def restart(self) -> None:
        """Start the next incarnation. Raises ValueError while the robot lives, or if a secured radio allows no more."""
        if self.alive:
            raise ValueError(f"robot {self.robot} lives: kill it before it is started again")
        epoch = self.restarts = self.restarts + 1
        now = self._host.now
        rng = stream(f"{self._host.seed}/robot{self.robot}/csma/{epoch}")
        self.x, self.y, _ = self._host.world.pose(self.robot)
        self.station.move(self.x, self.y)
        self.station.switch_on(rng, self._host.security(self.robot, epoch))
        if self._disk is None:
            self._past.append(with_lost_jobs(robot_report(self.node, {})))
        for queue in (self._samples, self._received, self._confirmed):
            queue.clear()
        self._samples_dropped = self._frames_dropped = 0
        self.alive = True
        self.node = self._make_node(self._ports, epoch, self._killed_at)
        if self.programs is None:
            self.node.start(now)
        else:
            self.programs.restarted(now)
        self._settle(now)

    def end_log(self) -> None:
        """End the log of the node's inputs, if there is one: the node is not called any more."""
        node = self.node
        if isinstance(node, RecordedNode):
            node.not_delivered(self._samples_dropped, self._frames_dropped)
            node.end_log()

    def stall(self, until: Instant) -> None:
        """Stop the process until `until`; a longer stop under way is not shortened."""
        if self.alive:
            self._stalled_until = max(self._stalled_until, until)
            self._settle(self._host.now)
            self._host.kernel.at(until, EVENT, self._settle)

    def slow(self, until: Instant, every: Duration) -> None:
        """Call the node once in `every` nanoseconds only, until `until`; of two such faults the slower applies."""
        if self.alive:
            now = self._host.now
            self._every = max(every, self._every) if now < self._slow_until else every
            self._slow_until = max(self._slow_until, until)
            self._settle(now)
            self._host.kernel.at(until, EVENT, self._settle)

    @property
    def reachable(self) -> bool:
        """Whether its process runs: it is neither dead nor stopped."""
        return self.alive and self._host.now >= self._stalled_until

    def hold_offers(self, now: Instant, *, held: bool) -> None:
        """Let the node offer nothing by ensemble rules while `held`."""
        if self.node.hold_offers(now, held) and self.served:
            self.node_alarm.set(now)

    def change_program(self, now: Instant, program: Program, digest: int) -> None:
        """Let the node go on with another program."""
        self.node.change_program(now, program, digest)
        if self.served:
            self.tick(now)

    def begin(self, now: Instant) -> None:
        """Start the node of a robot that has waited for its program."""
        self.node.start(now)
        self._settle(now)

    def _settle(self, now: Instant) -> None:
        """Set station, alarms and `served` according to the faults at `now`."""
        stalled = now < self._stalled_until
        slow = now < self._slow_until
        if stalled:
            self.station.hold()
        elif self.alive and self.station.held:
            self.station.resume(now)
        waits = self.programs is not None and self.programs.awaited
        self.served = self.alive and not stalled and not slow and not waits
        self.node_alarm.set(now if self.served else NEVER)
        self._slow_alarm.set(now + self._every if slow and not stalled else NEVER)
        self._host.sort_out()

    def _slow_tick(self, now: Instant) -> None:
        self.node.tick(now)
        self._host.take_trace(self.node)
        self._slow_alarm.set(now + self._every)

    # -- the report -------------------------------------------------------------------------------------------

    def report(self) -> dict[str, Any]:
        """Return the robot's part of the report, over all of its incarnations."""
        part = robot_report(self.node, self.station.counters.as_dict(), self.restarts)
        if not self.alive:
            part = with_lost_jobs(part)
        part = merged_report(self._past, part)
        part["distance_m"] = round(self._host.world.distance_m(self.robot), 3)
        part["off_m"] = off_m(self.node, self._host.world.pose(self.robot))
        return part
