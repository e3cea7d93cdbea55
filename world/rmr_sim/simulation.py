"""One simulated run: world, radios and nodes of a lab in virtual time.

The robots are the very nodes that a robot process hosts. Their radios share medium access and the rules of reception
with those of processes, but live in one ether, where no announcement is late. The world advances at each 1/60 s tick;
robots that stand still are sampled less often, as in processes. Robots whose program needs no bodies have none
(`rmr_sim.simulated_robot`).
"""

import heapq
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from rmr.base.kernel import EVENT
from rmr.base.time import NEVER, Duration, Instant, in_seconds, tick_start
from rmr.base.values import Value
from rmr.bytecode.program import Program
from rmr.coord.timing import Timing
from rmr.mind.mind_log import MindSink
from rmr.mind.recorded_node import RecordedNode
from rmr.node.actions.dispatcher import Handler
from rmr.node.actions.user_file import same_folder
from rmr.node.config import GivenFact, NodeConfig
from rmr.node.node import Node
from rmr.node.ports import Ports
from rmr.node.trace import TraceLevel
from rmr.radio.links import Disturbance
from rmr_sim.event import Event, EventError, FaultEvent, FaultRecord, call_observer, checked, instant
from rmr_sim.robot_host import RobotHost
from rmr_sim.simulated_robot import MakeNode, SimulatedRobot, needs_bodies
from rmr_sim.violation import VIOLATIONS_MAX, Violation
from rmr_world.disturbances import LINGER
from rmr_world.lab import Lab, Restart
from rmr_world.quorum import ALL, is_met, met_at
from rmr_world.schema import TICK

if TYPE_CHECKING:
    from rmr_sim.disk import Disk

IDLE_SAMPLE_TICKS: Final = 6
"""A robot whose body stands is sampled every sixth tick (10 Hz, the beacons' rate)."""

EVENTS_MAX: Final = 200_000
"""Bound of the events in one tick, twice the bound of a file: stops events that schedule others without end."""


class Simulation(RobotHost):
    """A lab's run in virtual time."""

    def __init__(
        self,
        lab: Lab,
        program: Program,
        digest: int,
        seed: int,
        handlers: Mapping[str, Handler] | None = None,
        trace: TraceLevel = TraceLevel.NOTES,
        key: bytes | None = None,
        timing: Timing | None = None,
        fresh: Callable[[], Mapping[str, Handler]] | None = None,
        without: frozenset[str] = frozenset(),
        minds: MindSink | None = None,
        durable: bool = False,
        later: Sequence[Program] = (),
    ) -> None:
        """`key` is the lab's, where its radio is secured; `timing` is that of coordination, where it is another one.

        `fresh` returns handlers of their own for each life of each robot, as processes have; without it all share
        `handlers`. `without` names rules of motion to leave out. `minds` takes the logs of the robots' inputs
        (`rmr.mind`) unless they are `durable`: these go on after a restart from what is on their disks. `later` are the
        programs that robots may be loaded with.

        Raises `rmr.node.actions.dispatcher.MissingHandlers` when an action of the program has no handler.
        """
        super().__init__(lab, seed, key)
        self.checkers: list[Callable[[Instant], None]] = []
        """Callbacks at the end of each tick, with its instant."""
        self.observers: list[Callable[[Instant], None]] = []
        """The same for a user's own callbacks, called after `checkers`. When one fails, `run` raises EventError."""
        self.violations: list[Violation] = []
        """Rules that did not hold, found by the checkers (`rmr_sim.checkers`)."""
        self.violations_omitted = 0
        """Number of violations beyond those in `violations`."""
        self.subscribers: dict[type, list[Callable[[int, Instant, Any], None]]] = {}
        """Callbacks by type of event: called with the robot, the instant and the event."""
        self.fault_records: list[FaultRecord | Disturbance] = []
        """Faults of robots and disturbances of the radio, in the order in which they became known."""
        self.before_restart: list[Callable[[int], None]] = []
        """Callbacks before a robot begins its next incarnation, with its id."""
        self.finished = False
        """Whether the robots of the quorum held the finish fact at one tick."""
        self._stopping = False
        self._happened = 0
        """Events since the last tick."""
        self._fresh = fresh
        self._minds = minds
        self.durable = durable
        """Whether restarted robots go on."""
        self._bodily = any(needs_bodies(lab, each, handlers or {}) for each in (program, *later))
        self.robots = self._robots(program, digest, handlers or {}, self._config(trace, timing or Timing(), without))
        self._served: list[SimulatedRobot] = []
        """Robots that are served normally."""
        self._waiting: list[SimulatedRobot] = []
        """Robots that live and are stalled or slow: their samples and frames are queued."""
        self.sort_out()
        self._by_id = {robot.robot: robot for robot in self.robots}
        self._disturbances: tuple[Disturbance, ...] = ()
        self._befall()

    def _befall(self) -> None:
        """Let the faults and the disturbances of the lab happen."""
        for fault in self.lab.faults:
            self.schedule(FaultEvent(fault))
        for disturbance in self.lab.disturbances:
            self.disturb(disturbance)

    def _robots(
        self, program: Program, digest: int, handlers: Mapping[str, Handler], config: NodeConfig
    ) -> tuple[SimulatedRobot, ...]:
        """Return the robots, each with a function that makes the node of an incarnation."""
        facts = _by_robot(config.facts, config.roster)
        minds = self._minds

        def maker(robot: int, disk: "Disk | None") -> MakeNode:
            lasting = replace(config, robot=robot, facts=tuple(facts[robot]))

            def make(ports: Ports, epoch: int, ended: Instant | None) -> Node:
                own = replace(lasting, epoch=epoch, predecessor_ended=ended)
                acting = handlers if self._fresh is None else self._fresh()
                if disk is not None:
                    from rmr_sim.disk import durable_node  # noqa: PLC0415 - loaded where robots are durable

                    return durable_node(disk, own, program, ports, acting, digest)
                if minds is None:
                    return Node(own, program, ports, acting, digest)
                return RecordedNode(own, program, ports, acting, digest, minds)

            return make

        disks: dict[int, Disk | None] = dict.fromkeys(self.lab.roster)
        if self.durable:
            from rmr_sim.disk import Disk as SimulatedDisk  # noqa: PLC0415 - as above

            disks |= {robot: SimulatedDisk(self.seed, robot) for robot in self.lab.roster}
        return tuple(
            SimulatedRobot(self, robot, maker(robot, its_disk), self._bodily, its_disk)
            for robot, its_disk in disks.items()
        )

    def _config(self, trace: TraceLevel, timing: Timing, without: frozenset[str]) -> NodeConfig:
        """Return the configuration of the first robot, from which those of the others are made."""
        lab = replace(self.lab, seed=self.seed)
        facts = tuple((fact.name, fact.owner, fact.args) for fact in lab.initial_facts)
        pattern = lab.finish_pattern
        return NodeConfig(
            lab.roster[0],
            dict.fromkeys(lab.roster),
            lab.arena,
            self.seed,
            self.radio,
            facts,
            None if pattern is None else (pattern.name, pattern.patterns),
            trace=trace,
            timing=timing,
            witness=self.tell,
            without=without,
        )

    @property
    def firings(self) -> dict[str, int]:
        """Number of firings of each rule of motion, over all robots."""
        return self.robots[0].node.config.firings

    def run(self) -> bool:
        """Run until the lab's quorum holds the finish fact or its duration is over; return whether it finished.

        A lab without a finish fact is finished when its duration is over. The present folder is the same afterwards,
        wherever handlers and events have gone.
        """
        try:
            with same_folder():
                return self._run()
        finally:
            for robot in self.robots:
                robot.end_log()

    def _run(self) -> bool:
        for robot in self.robots:
            robot.node.start(0)
            robot.wake_in_frame(0)
        index = 0
        while True:
            now = tick_start(index)
            self.kernel.run_until(now - 1 if now else 0)
            self.kernel.now = now
            self.frame_end = tick_start(index + 1)
            self._happened = 0
            self._tick(now, index)
            for check in self.checkers:
                check(now)
            for observe in self.observers:
                call_observer(observe, now)
            if self.lab.finish and self._is_finished(now):
                self.finished = True
                return True
            if now >= self.lab.duration:
                return not self.lab.finish
            if self._stopping:
                return False
            index += 1

    def _is_finished(self, now: Instant) -> bool:
        """Return whether the robots that hold the finish fact are as many as the lab's quorum asks for."""
        quorum = self.lab.quorum
        if quorum == ALL:  # the usual case, in each tick: no list is made
            return all(robot.finished() for robot in self.robots)
        holding = [robot.robot for robot in self.robots if robot.finished()]
        return bool(holding) and is_met(quorum, self.lab.roster, self.dead_for_good(now), holding)

    def dead_for_good(self, now: Instant) -> list[int]:
        """Return the robots that have been killed and that no fault of the lab restarts later."""
        later = {fault.robot for fault in self.lab.faults if isinstance(fault, Restart) and fault.at >= now}
        return [robot.robot for robot in self.robots if not robot.alive and robot.robot not in later]

    def violate(self, violation: Violation) -> None:
        """Record a violation, up to the bound of one run."""
        if len(self.violations) < VIOLATIONS_MAX:
            self.violations.append(violation)
        else:
            self.violations_omitted += 1

    def tell(self, robot: int, now: Instant, event: object) -> None:
        """Pass `event`, which happened to or inside `robot`, to the subscribers of its type."""
        for callback in self.subscribers.get(type(event), ()):
            callback(robot, now, event)

    def schedule(self, event: Event) -> None:
        """Schedule `event` at its instant. When its callback fails, `run` raises EventError.

        Raises TypeError if it is no event, or its instant is none.
        """
        self.kernel.at(checked(event).at, EVENT, lambda _now: self._happen(event))

    def _happen(self, event: Event) -> None:
        self._happened += 1
        if self._happened > EVENTS_MAX:
            what = f"event {type(event).__name__} at {in_seconds(self.now):.3f} s"
            raise EventError(f"{what}: {EVENTS_MAX} events in one tick: let it schedule the next one for later")
        event.happen(self)

    def stop(self) -> None:
        """End the run after the present tick; it has not finished then."""
        self._stopping = True

    # -- faults of robots and radio (each method raises LookupError for an unknown robot) ------------------------------

    def _robot(self, robot: int) -> SimulatedRobot:
        if robot not in self._by_id:
            raise LookupError(f"there is no robot {robot} in this run")
        return self._by_id[robot]

    def kill(self, robot: int) -> None:
        """Kill the process of `robot`. Its body stays in the world; the wheels brake 0.1 s later."""
        self._robot(robot).kill()
        self._note(robot, "killed")

    def is_dead(self, robot: int) -> bool:
        """Return whether `robot` has been killed and not been restarted."""
        return not self._robot(robot).alive

    def restart(self, robot: int) -> None:
        """Restart `robot`, without memory unless it is durable. Raises ValueError if it lives."""
        self.take_traces()
        for call in self.before_restart:
            call(robot)
        self._robot(robot).restart()
        self._note(robot, "restarted")

    def stall(self, robot: int, until: Instant) -> None:
        """Stop the process of `robot` until `until`, as by a signal: its input is queued. No effect on a dead robot."""
        self._robot(robot).stall(instant(until))
        self._note(robot, "stalled", until)

    def slow(self, robot: int, until: Instant, every: Duration) -> None:
        """Call the node of `robot` once in `every` nanoseconds only, until `until`. No effect on a dead robot."""
        if every <= TICK:
            raise ValueError(f"a slow robot is called less often than once a tick, which takes {TICK} ns, not {every}")
        self._robot(robot).slow(instant(until), instant(every))
        self._note(robot, "slowed", until)

    def silence(self, robot: int, until: Instant) -> None:
        """Let `robot` receive no pulse of the localisation service until `until`."""
        self.world.silence(self._robot(robot).robot, instant(until))
        self._note(robot, "silenced", until)

    def insert(self, robot: int, name: str, *args: Value) -> None:
        """Insert a fact of `robot` from outside, unless it is dead: its arguments without the owner.

        Raises ValueError when the program cannot hold such a fact.
        """
        self._robot(robot).insert(name, args)

    def disturb(self, disturbance: Disturbance) -> None:
        """Add a disturbance of the radio. Raises ValueError if it is invalid, or there are too many."""
        self.ether.links.replace((*self._disturbances, disturbance))
        self._disturbances = (*self._disturbances, disturbance)
        self.fault_records.append(disturbance)
        if disturbance.until < NEVER:
            self.kernel.at(disturbance.until + LINGER, EVENT, self._forget)

    def end_disturbances(self) -> None:
        """End all disturbances of the radio that are not the lab's."""
        given = self.lab.disturbances
        begun = [one for one in self._disturbances if one in given or one.since < self.now]
        self._disturbances = tuple(
            one if one in given else one._replace(until=min(one.until, self.now)) for one in begun
        )
        self.ether.links.replace(self._disturbances)

    def _forget(self, now: Instant) -> None:
        """Drop the disturbances that are long over: undisturbed links cost less."""
        self._disturbances = tuple(one for one in self._disturbances if now < one.until + LINGER)
        self.ether.links.replace(self._disturbances)

    def program_switched(self, robot: int, now: Instant, digest: int, *, late: bool) -> None:
        """Record that `robot` has switched to another program; `late`: after the others, as it was away."""
        self.switches.append((robot, now, digest, late))

    def _note(self, robot: int, fault: str, until: Instant = NEVER) -> None:
        self.fault_records.append(FaultRecord(self.now, until, robot, fault))
        self._trace.append({"t": round(in_seconds(self.now), 6), "robot": robot, "what": "fault", "fault": fault})

    def sort_out(self) -> None:
        """Update the lists of served and waiting robots."""
        self._served = [robot for robot in self.robots if robot.served]
        self._waiting = [robot for robot in self.robots if robot.alive and not robot.served]

    # -- time ---------------------------------------------------------------------------------------------------

    def _tick(self, now: Instant, index: int) -> None:
        self.world.step(now)
        moves = self.world.awake
        for robot in self._waiting:
            if robot.bodily and (robot.robot in moves or not (index + robot.robot) % IDLE_SAMPLE_TICKS):
                robot.sample(now)
        frame_end = self.frame_end
        for robot in self._served if self._bodily else self._called(frame_end):
            if robot.bodily and (robot.robot in moves or not (index + robot.robot) % IDLE_SAMPLE_TICKS):
                robot.sample(now)
                robot.tick(now)
            elif (wake := robot.node.next_wake) < frame_end:
                if wake <= now:
                    robot.tick(now)
                else:
                    robot.wake_in_frame(now)

    def _called(self, before: Instant) -> list[SimulatedRobot]:
        """Return the served robots without bodies that may be due before then: few, even of a thousand."""
        found = dict[int, None]()
        while self._calls and self._calls[0][0] < before:
            found[heapq.heappop(self._calls)[1]] = None
        return [robot for robot in map(self.robots.__getitem__, sorted(found)) if robot.served]

    def take_traces(self) -> None:
        """Move the traces of all robots to the trace of the run."""
        for robot in self.robots:
            self.take_trace(robot.node)

    def robot_parts(self) -> dict[int, dict[str, Any]]:
        """Return every robot's part of the report."""
        return {robot.robot: robot.report() for robot in self.robots}

    @property
    def time_s(self) -> float:
        """From the first tick until the quorum was met, or to now if it was not; seconds of lab time."""
        ends = {robot.robot: robot.node.finish_at for robot in self.robots if robot.finished()}
        met = met_at(self.lab.quorum, ends) if self.finished else None
        return in_seconds(self.now if met is None else int(met))

    def trace(self) -> list[dict[str, Any]]:
        """Return the trace of all robots, ordered by time, then by id."""
        self.take_traces()
        return sorted(self._trace, key=lambda entry: (entry["t"], entry["robot"]))


def _by_robot(facts: Iterable[GivenFact], roster: Collection[int]) -> dict[int, list[GivenFact]]:
    """Return the facts of each robot, in order."""
    found: dict[int, list[GivenFact]] = {robot: [] for robot in roster}
    for fact in facts:
        for robot in roster if fact[1] is None else (fact[1],):
            if robot in found:
                found[robot].append(fact)
    return found
