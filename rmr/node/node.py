"""One robot's mind: the same object in a robot process and in the simulator.

It joins the virtual machine, the coordination core, the exchange of facts, localisation and the navigator, and
runs them as the executive's tasks in the order of the paper's priorities: motor control with stop-if-dangerous,
radio, localisation, runtime system, telemetry. It reads no clock, opens nothing, and knows neither zenoh nor
the source language. The host calls `tick` at `next_wake` and whenever the link or the body has something new.
"""

import heapq
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.streams import stream
from rmr.base.time import NEVER, Instant, in_seconds, next_tick
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.program import Anything, Kind, Program
from rmr.coord.coordination import Coordination
from rmr.coord.events import Send
from rmr.node import wire
from rmr.node.actions import ActionFailed, Dispatcher, Handler, Running, check_handlers
from rmr.node.config import NodeConfig
from rmr.node.driver import Driver
from rmr.node.exchange import Exchange
from rmr.node.executive import Executive, Task
from rmr.node.motion.navigator import Navigator
from rmr.node.perception import Peers, Percept
from rmr.node.ports import Confirmed, Ports, Received
from rmr.node.provided import PROVIDED, NodeHandle
from rmr.node.sensedfacts import SensedFacts
from rmr.node.talk import Talk
from rmr.node.turn import Phase, Turn
from rmr.node.turns import Turns
from rmr.node.wire import Hello
from rmr.vm.events import ActionDerived, FactSent, GoalSent, JobFinished, JobMissed, JobStarted, RuleFired, VmEvent
from rmr.vm.machine import Machine

RESTLESS_CALLS = 60
"""Calls in a row after which a program that still has satisfied rules counts as one that never becomes quiet."""
TRACE_MAX = 4096
"""Trace entries kept for the host; the oldest go first."""
ACTIONS_MAX = 1024
"""Started actions kept for the report; the oldest go first."""


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
        self._ports = ports
        known = {**PROVIDED, **handlers}
        check_handlers(program, known)
        name = f"{config.seed}/robot{config.robot}"
        self.machine = Machine(program, config.robot, stream(f"{name}/vm"))
        self.senses = SensedFacts(program, self.machine)
        self.peers = Peers()
        self.driver: Driver | None = None
        """None: a robot without a body."""
        if ports.body is not None:
            self.driver = Driver(config.robot, config.roster, config.arena, ports.body)
        self._coordination = Coordination(config.robot, stream(f"{name}/coord"), lambda: max(1, len(config.roster) - 1))
        self.turns = Turns(self, self._coordination, digest)
        self.talk = Talk(self, Exchange(digest, config.epoch, stream(f"{name}/exchange")), digest)
        self.actions = Dispatcher(self, known)
        self._handlers = known
        self.executive = Executive(
            [
                Task("motor", self._motor, periodic=True),
                Task("radio", self._radio, periodic=False),
                Task("localisation", self._localise, periodic=False),
                Task("runtime", self._runtime, periodic=False),
                Task("telemetry", self._telemetry, periodic=True),
            ],
            ports.spent,
        )
        self._started = False
        self._restless = 0
        self._told_restless = False
        self._coord_handles: dict[int, int] = {}
        self._next_handle = 0
        self._later: list[tuple[Instant, int, Send]] = []
        self._later_sequence = 0
        self.action_log: deque[tuple[float, str]] = deque(maxlen=ACTIONS_MAX)
        self.trace_log: list[dict[str, Any]] = []
        self.finish_at: Instant | None = None
        self.next_wake: Instant = 0

    # -- life -----------------------------------------------------------------------------------------------

    def start(self, now: Instant) -> None:
        """Insert the initial facts and begin."""
        self.now = now
        self._started = True
        self.machine.start(now)
        robot = self.robot
        for other in self.config.roster:
            if other != robot:
                self.senses.add(now, "peer", (Robot(other),))
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

    def tick(self, now: Instant) -> None:
        """Run all that is due at `now`."""
        self.now = now
        if not self._started:
            return
        self.executive.tick(now)
        frame = self.executive.next_frame(now, self._busy())
        self.next_wake = min(
            frame or NEVER,
            self._coordination.next_wake,
            self.machine.next_wake if self.machine.quiescent else next_tick(now),
            self.actions.next_wake,
            self.talk.next_wake,
            self.turns.next_wake,
            self._later[0][0] if self._later else NEVER,
        )

    def _busy(self) -> bool:
        """Return whether something goes on that every frame matters to; else the robot sleeps until it is due."""
        return self.actions.polling or (self.driver is not None and self.driver.moving)

    # -- tasks ----------------------------------------------------------------------------------------------

    def _motor(self, now: Instant) -> None:
        if self.driver is not None:
            self.driver.step(now, self.turns.rank, self.peers)

    def _radio(self, now: Instant) -> None:
        for frame in self._ports.link.receive():
            self._receive(now, frame)
        for outcome in self._ports.link.confirmations():
            self._confirm(now, outcome)
        self.talk.wake(now)

    def _receive(self, now: Instant, frame: Received) -> None:
        self.peers.heard(now, frame.source, frame.rssi_dbm)
        if not frame.payload:
            self.talk.malformed += 1
        elif frame.payload[0] < 0x10:
            self._coordination.receive(now, frame.payload, frame.source)
        else:
            self.talk.receive(now, frame)

    def _confirm(self, now: Instant, outcome: Confirmed) -> None:
        handle = self._coord_handles.pop(outcome.handle, None)
        if handle is not None:
            self._coordination.confirmed(now, handle, outcome.status)

    def transmit(self, payload: bytes, destination: int | None, coord_handle: int | None = None) -> None:
        """Hand a payload to the radio."""
        self._next_handle += 1
        if coord_handle is not None:
            self._coord_handles[self._next_handle] = coord_handle
        self._ports.link.transmit(payload, destination, self._next_handle)

    def _localise(self, now: Instant) -> None:
        senses = self.senses
        if self.driver is not None:
            for area in self.driver.state(now, senses):
                self.trace(now, "at", area=area.name)
        if senses.used("neighbor"):
            senses.replace(now, "neighbor", [(Robot(other),) for other in self.peers.neighbors(now)])
        if senses.used("range"):
            senses.replace(now, "range", self.talk.ranges(now))

    def _runtime(self, now: Instant) -> None:
        self._coordinate(now)
        self._reason(now)
        self.actions.step(now)
        self.turns.step(now)
        self._coordinate(now)
        if self.machine.next_wake <= now:
            self._reason(now)
            self._coordinate(now)
        self.talk.flush()
        self._watch_quiescence(now)
        if self.finish_at is None and self.finished():
            self.finish_at = now
            self.trace(now, "finished")

    def _watch_quiescence(self, now: Instant) -> None:
        """Tell once of a program that never becomes quiet; it goes on within its budget of firings a call."""
        self._restless = 0 if self.machine.quiescent else self._restless + 1
        if self._restless == RESTLESS_CALLS and not self._told_restless:
            self._told_restless = True
            self.trace(now, "restless", firings=self.machine.firings)

    def _reason(self, now: Instant) -> None:
        self.machine.run(now)
        missed: int | None = None
        for event in self.machine.drain():
            if isinstance(event, ActionDerived):
                self._derived(now, event, missed)
            else:
                self._vm_event(now, event)
            missed = event.job.assertion if isinstance(event, JobMissed) else None

    def _coordinate(self, now: Instant) -> None:
        coordination = self._coordination
        if coordination.next_wake <= now:
            coordination.wake(now)
        for out in coordination.drain():
            if not isinstance(out, Send):
                self.turns.handle(now, out)
            elif out.at > now:
                self._later_sequence += 1
                heapq.heappush(self._later, (out.at, self._later_sequence, out))
            else:
                self._send(out)
        while self._later and self._later[0][0] <= now:
            self._send(heapq.heappop(self._later)[2])

    def _send(self, out: Send) -> None:
        self.transmit(out.payload, out.destination, out.handle or None)

    def _vm_event(self, now: Instant, event: VmEvent) -> None:
        match event:
            case FactSent() | GoalSent():
                self.talk.send(now, event)
            case JobStarted(job=job):
                self.trace(now, "job_started", job=job.text, deadline_s=in_seconds(job.deadline))
                self.turns.started(now, job)
            case JobFinished(job=job):
                self.trace(now, "job_finished", job=job.text)
                self.turns.finished(now, job)
            case JobMissed(job=job):
                self.trace(now, "deadline_missed", job=job.text)
            case RuleFired() if self._restless:
                pass  # a program that spins would push everything else out of the trace
            case _:
                self.trace(now, type(event).__name__, event=repr(event))

    def _derived(self, now: Instant, event: ActionDerived, missed: int | None) -> None:
        if event.executor != self.robot:
            self.talk.send_action(now, event)
            return
        name = self.program.predicates[event.predicate].name
        jobs = self.machine.serves(event.predicate, event.args)
        turn = self.turns.serving(now, jobs[0]) if jobs else None
        self.actions.derive(now, Running(event.serial, name, event.args, self._handlers[name], turn, now, missed))

    def _telemetry(self, now: Instant) -> None:
        self.talk.telemetry(now)

    # -- what actions ask -------------------------------------------------------------------------------------

    def handle(self, running: Running) -> NodeHandle:
        """Return the handle of a starting action, which is noted in the report."""
        self.action_log.append((round(in_seconds(self.now), 3), running.text(self.robot)))
        self.trace(self.now, "action", action=running.text(self.robot))
        return NodeHandle(self, running)

    def action_ended(self, now: Instant, running: Running, failure: str | None) -> None:
        """Insert an action's effects."""
        if failure is None:
            failure = self._take_effect(now, running)
        self.trace(now, "action_ended", action=running.text(self.robot), failure=failure)
        if isinstance(running.turn, Turn):
            self.turns.action_ended(now, running.turn)
        self.machine.complete(now, running.serial, failure is None)

    def _take_effect(self, now: Instant, running: Running) -> str | None:
        """Insert the effect that the handler names if the program declares none; return why it does not fit.

        As with declared effects, a sensed fact is left to the senses; one that the program does not know is nobody's.
        """
        name, action = running.handler.effect, self.program.index(running.name)
        effect = None if name is None else self.program.index(name)
        if effect is None or action is None or self.program.predicates[action].effects:
            return None
        if self.program.predicates[effect].kind is not Kind.SENSED:
            try:
                self.machine.insert(now, effect, running.args)
            except ValueError as error:
                return f"its effect does not fit: {error}"
        return None

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
        return self._handlers[self.program.predicates[action].name].to_area

    def serving(self, turn: Turn) -> Running | None:
        """Return the action that serves `turn`, held or under way."""
        waiting = (*self.actions.running, *self.actions.held, *self.actions.queue)
        return next((running for running in waiting if running.turn is turn), None)

    @property
    def bound_for(self) -> Point | None:
        """Where the robot is going, or the slot on which it stands."""
        if self.driver is None:
            return None
        return self.driver.navigator.goal if self.actions.driving is not None else self.driver.place

    def take_place(self, area: Area, turn: Turn | None) -> Point:
        """Choose the robot's place in `area`; the others hear of it. Raises ActionFailed without a body."""
        if self.driver is None:
            raise ActionFailed("the robot has no wheels")
        return self.driver.take_place(self.now, area, turn.rank if turn else 0, self.peers)

    def depart(self, goal: Point, *, final_heading: float | None, turn: Turn | None) -> None:
        """Set out for `goal`; with a gated turn through its gate."""
        assert self.driver is not None
        gated = turn is not None and turn.gated and turn.phase is not Phase.LEFT
        shared = self.turns.shared.get((turn.event, turn.way)) if turn is not None and gated else None
        self.driver.depart(self.now, goal, self.peers, heading=final_heading, gated=gated, shared=shared)
        if turn is not None and gated:
            self.turns.apply_gate(turn)
        self.talk.hello_soon(self.now)

    def heed_claim(self, source: int, hello: Hello) -> None:
        """Go to another place when a robot that goes first has taken this one's."""
        running = self.actions.driving
        if self.driver is None or running is None:
            return
        place = self.driver.choose_again(self.now, source, hello, self.peers)
        if place is not None:
            self.depart(place, final_heading=None, turn=running.turn if isinstance(running.turn, Turn) else None)

    def rank_changed(self, now: Instant, turn: Turn) -> None:
        """Handle a new place in the schedule: tell the program, and take another slot while still outside."""
        name = Symbol(turn.job.name)
        others = [args for args in self.senses.of("turn") if args[0] != name]
        self.senses.replace(now, "turn", [*others, (name, turn.rank)])
        running = self.serving(turn)
        if turn.goal is None or running is None or running.started is None or turn.phase is Phase.INSIDE:
            return
        if turn.goal.slotted and running.handler.to_area and running in self.actions.running:
            self.depart(self.take_place(turn.goal, turn), final_heading=None, turn=turn)

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
        """Return whether the finish fact holds."""
        if self.config.finish is None:
            return False
        name, patterns = self.config.finish
        for args in self.senses.of(name):
            if all(isinstance(p, Anything) or p.value == a for p, a in zip(patterns, args, strict=False)):
                return True
        index = self.program.index(name)
        return index is not None and self.machine.holds(index, patterns)

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Note something for whoever watches the robot."""
        if len(self.trace_log) >= TRACE_MAX:
            del self.trace_log[: TRACE_MAX // 2]
        self.trace_log.append({"t": round(in_seconds(now), 4), "robot": self.robot, "what": what, **fields})
