"""One simulated robot: its node and its radio station, and what the host of a process does with them.

The host hands over samples and frames and calls the node: at each tick while the robot drives, else when the node
wants to be called. What can befall a process is befalling the host's part here, and costs nothing while it does not:

    state    the node is called           the station               what comes in meanwhile
    served   as it wants                  on                        is handed over at once
    slow     every so often               on                        waits for the call
    stalled  not at all                   stands still              waits, as in a stopped process
    dead     not at all, and never again  off                       is lost

The body is no part of this: it stays where it is, and its wheels stop when nobody has commanded them for a while.
A robot that starts again has a new node, of a further epoch, and a station that remembers nothing; what the nodes
before it counted and did stays in the report.
"""

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeVar

from rmr.base.geometry import Twist
from rmr.base.kernel import EVENT, ROBOT, Alarm
from rmr.base.streams import stream
from rmr.base.time import NEVER, Duration, Instant
from rmr.base.values import Value
from rmr.node.node import Node
from rmr.node.ports import Confirmed, Ports, Received, Sensed
from rmr.node.report import robot_report
from rmr_world.incarnations import merged_report, with_lost_jobs

if TYPE_CHECKING:
    from rmr_sim.simulation import Simulation

SAMPLES_MAX: Final = 240
"""Samples that wait for a node that is not called, as in a process; the oldest go first."""
FRAMES_MAX: Final = 512
"""Frames, and outcomes, likewise."""

T = TypeVar("T")

MakeNode = Callable[[Ports, int], Node]
"""Of a robot's ports and its epoch."""


def _taken(queue: deque[T]) -> list[T]:
    """Return what waits in `queue`, which is empty then."""
    taken = list(queue)
    queue.clear()
    return taken


class SimulatedRobot:
    """A node with its station and its body in the world."""

    def __init__(self, simulation: "Simulation", robot: int, make_node: MakeNode, bodily: bool) -> None:
        """A robot without a body (`bodily`) is not sampled."""
        self.bodily = bodily
        self._simulation = simulation
        self._make_node = make_node
        self.robot = robot
        self.x, self.y, _ = simulation.world.pose(robot)
        rng = stream(f"{simulation.seed}/robot{robot}/csma")
        self.station = simulation.ether.add(
            robot, rng, self._take, self.x, self.y, security=simulation.security(robot, 0)
        )
        self._samples: deque[Sensed] = deque(maxlen=SAMPLES_MAX)
        self._received: deque[Received] = deque(maxlen=FRAMES_MAX)
        self._confirmed: deque[Confirmed] = deque(maxlen=FRAMES_MAX)
        self.alive = True
        self.served = True
        """Whether the host serves it as in the absence of faults."""
        self._stalled_until: Instant = 0
        self._slow_until: Instant = 0
        self._every: Duration = 0
        self.still = True
        self.node = make_node(self._ports, 0)
        self.node_alarm = Alarm(simulation.kernel, ROBOT, self.tick)
        self._slow_alarm = Alarm(simulation.kernel, ROBOT, self._slow_tick)
        self._called: Instant = NEVER
        """When a frame begins, or will have begun, in which one without a body is looked after."""
        self._past: list[dict[str, Any]] = []
        """The parts of the report of the nodes before this one."""

    # -- the node's ports -------------------------------------------------------------------------------------

    @property
    def _ports(self) -> Ports:
        return Ports(self, self if self.bodily else None)

    @property
    def payload_max(self) -> int:
        """Octets that fit a frame."""
        return self.station.payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int) -> None:
        """Queue a frame."""
        self.station.request(payload, destination, handle)

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
        if self.node.notes.entries:
            self._simulation.take_trace(self)
        self.wake_in_frame(now)

    def wake_in_frame(self, now: Instant) -> None:
        """See to it that the node is called if it wants to be before the next frame, when all are looked after."""
        wake = self.node.next_wake
        if wake < self._simulation.frame_end:
            self.node_alarm.set(wake if wake > now else now + 1)
            return
        if self.node_alarm.when < NEVER:
            self.node_alarm.set(NEVER)
        if not self.bodily and wake != self._called:
            self._called = wake
            if wake < NEVER:
                self._simulation.call(self.station.index, wake)

    def _take(self, out: Received | Confirmed) -> None:
        if isinstance(out, Confirmed):
            if not self.node.awaits(out):
                return
            self._confirmed.append(out)
        elif self.served and not self._received and self.node.overhear(self._simulation.kernel.now, out):
            return
        else:
            self._received.append(out)
        if self.served:
            self.node_alarm.set(self._simulation.kernel.now)

    def insert(self, name: str, args: tuple[Value, ...]) -> None:
        """Insert a fact from outside; a dead robot holds none. Raises ValueError if the program cannot hold it."""
        if self.alive:
            now = self._simulation.now
            self.node.insert(now, name, args)
            if self.served:
                self.node_alarm.set(now)

    def finished(self) -> bool:
        """Return whether it lives and holds the finish fact."""
        return self.alive and self.node.finished()

    # -- what befalls it --------------------------------------------------------------------------------------

    @property
    def restarts(self) -> int:
        """How many nodes have been this robot before."""
        return len(self._past)

    def kill(self) -> None:
        """End the process: nothing of it is called or answers any more."""
        self.alive = False
        self._stalled_until = self._slow_until = 0
        self.station.switch_off()
        self._settle(self._simulation.now)

    def restart(self) -> None:
        """Begin a new life. Raises ValueError while the old one lasts, or when a secured radio has none left."""
        if self.alive:
            raise ValueError(f"robot {self.robot} lives: kill it before it is started again")
        epoch, now = self.restarts + 1, self._simulation.now
        rng = stream(f"{self._simulation.seed}/robot{self.robot}/csma/{epoch}")
        self.x, self.y, _ = self._simulation.world.pose(self.robot)
        self.station.move(self.x, self.y)
        self.station.switch_on(rng, self._simulation.security(self.robot, epoch))
        self._past.append(with_lost_jobs(robot_report(self.node, {})))
        for queue in (self._samples, self._received, self._confirmed):
            queue.clear()
        self.alive = self.still = True
        self.node = self._make_node(self._ports, epoch)
        self.node.start(now)
        self._settle(now)

    def stall(self, until: Instant) -> None:
        """Stop the process `until` then; a stop that lasts longer already is not cut short."""
        if self.alive:
            self._stalled_until = max(self._stalled_until, until)
            self._settle(self._simulation.now)
            self._simulation.kernel.at(until, EVENT, self._settle)

    def slow(self, until: Instant, every: Duration) -> None:
        """Have the node called once in `every` nanoseconds only, `until` then; of two such times the slower holds."""
        if self.alive:
            now = self._simulation.now
            self._every = max(every, self._every) if now < self._slow_until else every
            self._slow_until = max(self._slow_until, until)
            self._settle(now)
            self._simulation.kernel.at(until, EVENT, self._settle)

    def _settle(self, now: Instant) -> None:
        """Serve it as far as it lives and what has befallen it is over."""
        stalled, slow = now < self._stalled_until, now < self._slow_until
        if stalled:
            self.station.hold()
        elif self.alive and self.station.held:
            self.station.resume(now)
        self.served = self.alive and not stalled and not slow
        self.node_alarm.set(now if self.served else NEVER)
        self._slow_alarm.set(now + self._every if slow and not stalled else NEVER)
        self._simulation.sort_out()

    def _slow_tick(self, now: Instant) -> None:
        self.node.tick(now)
        self._simulation.take_trace(self)
        self._slow_alarm.set(now + self._every)

    # -- the report -------------------------------------------------------------------------------------------

    def report(self) -> dict[str, Any]:
        """Return its part of the report: what its nodes counted and did, and what the present one holds."""
        part = robot_report(self.node, self.station.counters.as_dict(), self.restarts)
        if not self.alive:
            part = with_lost_jobs(part)
        part = merged_report(self._past, part)
        part["distance_m"] = round(self._simulation.world.distance_m(self.robot), 3)
        return part
