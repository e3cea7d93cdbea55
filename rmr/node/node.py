"""One robot's mind: the same object in a robot process, in the simulator and in `rmr eval`.

It joins the virtual machine, the coordination core, the exchange of facts, localisation and the navigator, and
runs them as the executive's tasks in the order of the paper's priorities: motor control with stop-if-dangerous,
radio, localisation, runtime system, telemetry. It reads no clock, opens nothing, and knows neither zenoh nor
the source language. The host calls `tick` at `next_wake` and whenever the link or the body has something new.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.streams import Choices, stream
from rmr.base.time import NEVER, Duration, Instant, milliseconds
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.program import Anything, Program
from rmr.coord.coordination import Coordination
from rmr.coord.events import CoordEvent
from rmr.node import wire
from rmr.node.actions.action_log import ActionLog
from rmr.node.actions.built_in import PROVIDED, NodeHandle
from rmr.node.actions.dispatcher import ActionFailed, Dispatcher, Handler, Running, check_handlers
from rmr.node.config import NodeConfig
from rmr.node.crossing.coordination_link import CoordLink
from rmr.node.crossing.turn import Phase, Turn
from rmr.node.crossing.turns import Turns
from rmr.node.driver import Driver
from rmr.node.executive import Executive, Task
from rmr.node.logic.exchange import Exchange
from rmr.node.logic.machine_runner import Mind
from rmr.node.logic.sensed_facts import SensedFacts
from rmr.node.messenger import Talk
from rmr.node.motion.navigator import Navigator
from rmr.node.peers.perception import Peers, Percept
from rmr.node.ports import Confirmed, Ports, Received, Spoken
from rmr.node.trace import Level, Trace
from rmr.vm.engines import new_machine

ROUNDS_MAX: Final = 64
"""How often one call runs the machine again because actions have ended at once; the rest waits for the next frame."""
SLEPT: Final[Duration] = milliseconds(150)
"""A robot that has not been called for so long was stopped: what it hears then may be as old as its last call."""


class Node:
    """One robot."""

    def __init__(
        self, config: NodeConfig, program: Program, ports: Ports, handlers: Mapping[str, Handler], digest: int = 0
    ) -> None:
        """Raise MissingHandlers when an action of `program` has no handler in `handlers` or among the provided."""
        self.config = config
        self.robot = config.robot
        self.program = program
        self.arena = config.arena
        self.now: Instant = 0
        self.heard_at: Instant = 0
        """Not before this instant have the frames come in that are handled now."""
        self.notes = Trace(config.robot, config.trace)
        self._ports = ports
        self._handlers = handlers
        check_handlers(program, {**PROVIDED, **handlers})
        name = f"{config.seed}/robot{config.robot}"
        choices, traced = Choices(f"{name}/vm"), config.trace is Level.FACTS
        self.machine = new_machine(program, config.robot, choices, engine=config.engine, trace=traced)
        self.senses = SensedFacts(program, self.machine)
        self.peers = Peers()
        self.driver: Driver | None = None
        """None: a robot without a body."""
        if ports.body is not None:
            self.driver = Driver(config, ports.body)
        values = replace(config.values, payload_max=ports.link.payload_max)
        core = Coordination(config.robot, stream(f"{name}/coord"), lambda: len(config.roster) - 1, values)
        self.turns = Turns(self, core, digest)
        self.core = core
        """The coordination core, for whoever checks a run to look at."""
        self._coordination = CoordLink(core, self.transmit, self._coordinated)
        exchange = Exchange(digest, config.epoch, stream(f"{name}/exchange"), ports.link.payload_max)
        exchange.tell = self.tell
        self.talk = Talk(self, exchange, digest)
        self.actions = Dispatcher(self)
        self.mind = Mind(self)
        tasks = [
            Task("motor", self._motor, periodic=True),
            Task("radio", self._radio, periodic=False),
            Task("localisation", self._localise, periodic=False),
            Task("runtime", self._runtime, periodic=False),
            Task("telemetry", self._telemetry, periodic=True),
        ]
        self.executive = Executive(tasks, ports.spent, config.phase)
        self._started = False
        self._meets = self.senses.used("neighbor") or self.senses.used("range")
        self._finish_index = None if config.finish is None else program.index(config.finish[0])
        self._finished = False
        self._finish_looked: Instant = 0
        self._stirred = True
        self._rewake = True
        """Whether this call may have changed when the robot is due next; hellos of others alone do not."""
        self._frames_sent = 0
        self._near: Sequence[tuple[int, float]] | None = None
        """The neighbors that the host offered last."""
        self.state: dict[str, Any] = {}
        """What the robot's actions remember (`RobotHandle.state`)."""
        self.action_log = ActionLog()
        self.finish_at: Instant | None = None
        self.next_wake: Instant = 0

    # -- life -----------------------------------------------------------------------------------------------

    def start(self, now: Instant) -> None:
        """Insert the initial facts and begin."""
        self.now = now
        self._started = True
        self.machine.start(now)
        robot = self.robot
        if self.senses.used("peer"):
            self.senses.replace(now, "peer", [(Robot(other),) for other in self.config.roster if other != robot])
        for name, owner, args in self.config.facts:
            if owner is None or owner == robot:
                self.insert(now, name, args)
        self.talk.start(now)
        self.next_wake = now

    def insert(self, now: Instant, name: str, args: Sequence[Value]) -> None:
        """Insert a fact of this robot from outside. Raises ValueError when the program does not know it."""
        index = self.program.index(name)
        if index is None:
            raise ValueError(f"the program knows no predicate {name}")
        self.machine.insert(now, index, tuple(args))
        self._stirred = True
        self.next_wake = min(self.next_wake, now)

    def tick(self, now: Instant) -> None:
        """Run all that is due at `now`."""
        self.heard_at = now if now - self.now <= SLEPT else self.now
        self.now = now
        if not self._started:
            return
        self._rewake = now >= self.next_wake
        self.executive.tick(now)
        if not self._rewake:
            return
        executive, machine = self.executive, self.machine
        wake = min(executive.next_frame(self._busy()) or NEVER, self._coordination.next_wake)
        wake = min(wake, executive.frame_ends if machine.busy else machine.due)
        wake = min(wake, self.actions.next_wake)
        wake = min(wake, self.talk.next_wake)
        self.next_wake = min(wake, self.turns.next_wake)

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` as it arrives, if no task has to look at it; else return False: it is to wait for a call.

        In a crowd nearly all that is heard are hellos that change nothing but where a robot is known to be.
        """
        if not self._started or self._meets or now - self.now > SLEPT:
            return False
        if self.talk.overhear(now, frame):
            return True
        return self.config.profile.overhears_passing and self._overhear_passing(now, frame)

    def _overhear_passing(self, now: Instant, frame: Received) -> bool:
        """Take in what a robot in the bottleneck says, which all of a crowd hear and hardly any has to do with."""
        if frame.source not in self.peers.known or not self._coordination.overhear(now, frame.payload):
            return False
        self.peers.heard(now, frame.source, frame.rssi_dbm)
        return True

    def awaits(self, outcome: Confirmed) -> bool:
        """Return whether `outcome` matters here: else it need not be handed over. That of no broadcast does."""
        return self._coordination.awaits(outcome)

    def _busy(self) -> bool:
        """Return whether something goes on that every frame matters to; else the robot sleeps until it is due."""
        return self.actions.polling or (self.driver is not None and self.driver.moving)

    # -- tasks ----------------------------------------------------------------------------------------------

    def stir(self) -> None:
        """Take note that rules, actions or turns have something to look at in this call."""
        self._stirred = True

    def _motor(self, now: Instant) -> None:
        self._stirred = True
        if self.driver is not None:
            self.driver.step(now, self._rank, self.peers)

    def _rank(self) -> int:
        return self.turns.rank

    def _radio(self, now: Instant) -> None:
        for frame in self._ports.link.receive():
            self._receive(now, frame)
        for outcome in self._ports.link.confirmations():
            self._rewake = True
            self._coordination.confirm(now, outcome)
        self.talk.wake(now)

    def _coordinated(self, now: Instant, event: CoordEvent) -> None:
        self.tell(event)
        self.turns.handle(now, event)

    def _receive(self, now: Instant, frame: Received) -> None:
        self.peers.heard(now, frame.source, frame.rssi_dbm)
        if not frame.payload:
            self.talk.drop(now, frame.source, "a frame without content")
            return
        if frame.payload[0] != wire.Kind.HELLO:
            self._rewake = True
        if frame.payload[0] < wire.Kind.FACT:
            self._coordination.receive(now, frame.payload, frame.source)
        else:
            self.talk.receive(now, frame)

    def tell(self, event: object) -> None:
        """Tell whoever checks the run that `event` has happened."""
        if self.config.witness is not None:
            self.config.witness(self.robot, self.now, event)

    def transmit(self, payload: bytes, destination: int | None) -> int:
        """Hand a payload to the radio; return the handle by which it will tell the outcome."""
        self._frames_sent += 1
        if self.config.witness is not None:
            self.tell(Spoken(payload))
        self._ports.link.transmit(payload, destination, self._frames_sent)
        return self._frames_sent

    def _localise(self, now: Instant) -> None:
        if self.driver is not None:
            for area in self.driver.state(now, self.senses):
                self.trace(now, "at", area=area.name)
        if self._meets:
            self._meet(now)

    def _meet(self, now: Instant) -> None:
        """State who is near, and how far away, as the host offers it or as frames tell."""
        senses = self.senses
        if self._ports.neighbors is None:
            senses.replace(now, "neighbor", [(Robot(other),) for other in self.peers.neighbors(now)])
            senses.replace(now, "range", self.talk.ranges(now))
            return
        near = self._ports.neighbors()
        if near is not self._near:
            self._near = near
            senses.replace(now, "neighbor", [(Robot(other),) for other, _ in near])
            senses.replace(now, "range", [(Robot(other), metres) for other, metres in near])

    def _runtime(self, now: Instant) -> None:
        """Let rules fire and actions go on until nothing more happens at this instant.

        What others say changes nothing here as a rule: then this costs nothing.
        """
        if not (self._stirred or now >= self.next_wake or self._is_due(now)):
            return
        self._stirred, self._rewake = False, True
        machine, actions, coordination = self.machine, self.actions, self._coordination
        for _ in range(ROUNDS_MAX):
            if coordination.due(now):
                coordination.run(now)
            if machine.has_due(now):
                if machine.due == now:
                    actions.resume(now)  # what ends at the very instant of a deadline is in time
                self.mind.run(now)
            actions.step(now)
            self.turns.step(now)
            if coordination.due(now):
                coordination.run(now)
            self.talk.flush(now)
            more = machine.has_due(now) and (self.mind.settle(now) or self.mind.due(now))
            if not (more or actions.released(now)):
                break
        self.mind.watch_quiescence(now)
        if self._finish_looked <= machine.called_at or self._finish_looked <= self.senses.changed:
            self._finish_looked = now
            self._finished = self._holds_finish()
        if self.finish_at is None and self._finished:
            self.finish_at = now
            self.trace(now, "finished")

    def _is_due(self, now: Instant) -> bool:
        """Return whether there is something to do that was not foreseen at the end of the last call."""
        return self.machine.busy or self._coordination.due(now) or self.actions.released(now)

    def _telemetry(self, now: Instant) -> None:
        self.talk.telemetry(now)

    # -- what actions ask -------------------------------------------------------------------------------------

    def handle(self, running: Running) -> NodeHandle:
        """Return the handle of a starting action, which is noted in the report."""
        self.action_log.begin(self.now, running.text(self.robot))
        self.trace(self.now, "action", action=running.text(self.robot))
        return NodeHandle(self, running)

    def action_ended(self, now: Instant, running: Running, failure: str | None) -> None:
        """Handle the end of an action."""
        self.mind.ended(now, running, failure)

    def handler(self, action: str) -> Handler:
        """Return what carries out an action; the host's own handlers go before the provided ones."""
        return self._handlers.get(action) or PROVIDED[action]

    def provided(self, action: str) -> Handler:
        """Return what rmr itself carries out an action with, whatever the host's own handlers are."""
        return PROVIDED[action]

    def drive(self, v: float, w: float) -> None:
        """Drive by hand, m/s and rad/s; who leaves its place gives it up. Raises ActionFailed without a body."""
        navigator, driver = self.motion, self.driver
        if driver is not None and v != 0.0:
            driver.place = None
        navigator.drive(v, w)

    def halt(self) -> None:
        """Stop the wheels."""
        if self.driver is not None:
            self.driver.navigator.stop()

    def percept(self) -> Percept:
        """Return what the robot senses now."""
        return Percept(None, (), False) if self.driver is None else self.driver.percept

    @property
    def motion(self) -> Navigator:
        """Return the navigator. Raises ActionFailed without a body."""
        if self.driver is None:
            raise ActionFailed("the robot has no wheels")
        return self.driver.navigator

    def drives_to_area(self, action: int) -> bool:
        """Return whether an action drives to the area that it names: it may be gated."""
        return self.handler(self.program.predicates[action].name).to_area

    def take_place(self, area: Area, turn: Turn | None) -> Point:
        """Choose the robot's place in `area`; the others hear of it. Raises ActionFailed without a body."""
        if self.driver is None:
            raise ActionFailed("the robot has no wheels")
        rank, place = (turn.rank, turn.place) if turn else (0, 0)
        return self.driver.take_place(self.now, area, rank, place, self.peers)

    def depart(self, goal: Point, *, final_heading: float | None, turn: Turn | None) -> None:
        """Set out for `goal`; with a gated turn through its gate."""
        assert self.driver is not None
        self._stirred = True
        gated = turn is not None and turn.gated and turn.phase is not Phase.LEFT
        shared = self.turns.leading.shared(turn.event, turn.way) if turn is not None and gated else None
        self.driver.depart(self.now, goal, self.peers, heading=final_heading, gated=gated, shared=shared)
        if turn is not None:
            turn.bound, turn.planned_at = None, self.now
        if turn is not None and gated:
            self.turns.apply_gate(turn)
        self.talk.hello_soon(self.now)

    def leads(self, now: Instant, name: Symbol, does: bool) -> None:
        """State whether the robot leads an event of assertion `name`."""
        if does:
            self.senses.add(now, "leads", (name,))
        else:
            self.senses.drop(now, "leads", (name,))

    def broadcast_failure(self, assertion: int | None) -> None:
        """Tell the others that a deadline of `assertion` was missed (None: none in particular)."""
        self.transmit(wire.encode_failure(self.talk.digest, assertion), None)

    # -- what hosts ask ---------------------------------------------------------------------------------------

    def finished(self) -> bool:
        """Return whether the finish fact holds, as of the last call."""
        return self._finished

    def _holds_finish(self) -> bool:
        if self.config.finish is None:
            return False
        name, patterns = self.config.finish
        for args in self.senses.of(name):
            if all(isinstance(p, Anything) or p.value == a for p, a in zip(patterns, args, strict=False)):
                return True
        return self._finish_index is not None and self.machine.holds(self._finish_index, patterns)

    @property
    def outstanding(self) -> tuple[str, ...]:
        """What goes on or is waited for, in words; schedules, beacons and hellos do not count."""
        machine, talk = self.machine, self.talk
        checks = (
            ("a satisfied rule", not machine.quiescent),
            ("a fact under way", not talk.exchange.idle),
            ("an action", not self.actions.idle),
            ("a deadline", machine.quiescent and machine.next_wake < NEVER),
        )
        return tuple([words for words, holds in checks if holds])

    @property
    def trace_log(self) -> list[dict[str, Any]]:
        """What the robot has noted since the host last cleared it."""
        return self.notes.entries

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Note something for whoever watches the robot (`rmr.node.trace`)."""
        self.notes.note(now, what, **fields)
