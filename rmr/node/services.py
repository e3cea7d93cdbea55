"""What actions and crossings may ask of their robot: its wheels, its places, its program, the others.

The parts that they share are built one after the other, so `RobotServices` is made early and joined to those that are
made after it (`actions`, `turns`, `presence`, `runner`, `executive`). Its users see it through `rmr.node.parts`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from rmr.base.arena import Area
from rmr.base.geometry import Point
from rmr.base.time import Instant
from rmr.base.values import Symbol, Value
from rmr.bytecode.program import Program
from rmr.node import payloads
from rmr.node.actions.action_log import ActionLog
from rmr.node.actions.built_in import PROVIDED, NodeHandle
from rmr.node.actions.dispatcher import ActionFailed, ActionPermit, Dispatcher, Handler, RunningAction
from rmr.node.config import NodeConfig
from rmr.node.crossing.destination import bound_for, redirect
from rmr.node.crossing.turn import Phase, Turn
from rmr.node.crossing.turns import Turns
from rmr.node.driver import Driver
from rmr.node.executive import Executive
from rmr.node.logic.machine_runner import MachineRunner
from rmr.node.logic.sensed_facts import SensedFacts
from rmr.node.motion.navigator import Navigator
from rmr.node.parts import Radio
from rmr.node.peers.perception import Peers, Percept
from rmr.node.peers.presence import Presence
from rmr.node.tick_state import TickState
from rmr.node.trace import Trace
from rmr.vm.machine import Machine

NO_WHEELS = "the robot has no wheels"


class RobotServices:
    """One robot, as its actions and crossings see it."""

    actions: Dispatcher
    turns: Turns
    presence: Presence
    runner: MachineRunner
    executive: Executive

    def __init__(
        self,
        config: NodeConfig,
        program: Program,
        machine: Machine,
        handlers: Mapping[str, Handler],
        clock: TickState,
        notes: Trace,
        senses: SensedFacts,
        peers: Peers,
        driver: Driver | None,
        radio: Radio,
        digest: int,
    ) -> None:
        self.config = config
        self.program = program
        self.robot = config.robot
        self.arena = config.arena
        self.senses = senses
        self.peers = peers
        self.driver = driver
        self.state: dict[str, Any] = {}
        """What the robot's actions remember (`RobotHandle.state`)."""
        self.action_log = ActionLog()
        self._machine = machine
        self._handlers = handlers
        self._clock = clock
        self._notes = notes
        self._radio = radio
        self._digest = digest

    @property
    def now(self) -> Instant:
        """The instant of the present call."""
        return self._clock.now

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Note something for whoever watches the robot (`rmr.node.trace`)."""
        self._notes.note(now, what, **fields)

    def insert(self, now: Instant, name: str, args: Sequence[Value]) -> None:
        """Insert a fact of this robot from outside. Raises ValueError when the program does not know it."""
        index = self.program.index(name)
        if index is None:
            raise ValueError(f"the program knows no predicate {name}")
        self._machine.insert(now, index, tuple(args))
        self._clock.mark_dirty()

    def leads(self, now: Instant, name: Symbol, does: bool) -> None:
        """State whether the robot leads an event of assertion `name`."""
        if does:
            self.senses.add(now, "leads", (name,))
        else:
            self.senses.drop(now, "leads", (name,))

    def broadcast_failure(self, assertion: int | None) -> None:
        """Tell the others that a deadline of `assertion` was missed (None: none in particular)."""
        self._radio.transmit(payloads.encode_failure(self._digest, assertion), None)

    # -- actions ----------------------------------------------------------------------------------------------

    def handle(self, running: RunningAction) -> NodeHandle:
        """Return the handle of an action that starts, and note the start in trace and report."""
        text = running.text(self.robot)
        self.action_log.begin(self.now, text)
        self.trace(self.now, "action", action=text)
        return NodeHandle(self, running)

    def action_ended(self, now: Instant, running: RunningAction, failure: str | None) -> None:
        """Handle the end of an action."""
        self.runner.ended(now, running, failure)

    def handler(self, action: str) -> Handler:
        """Return what carries out an action; the host's own handlers go before the provided ones."""
        return self._handlers.get(action) or PROVIDED[action]

    def provided(self, action: str) -> Handler:
        """Return the built-in handler of an action, whatever the host's own handlers are."""
        return PROVIDED[action]

    def drives_to_area(self, action: int) -> bool:
        """Return whether an action drives to the area that it names: it may be gated."""
        return self.handler(self.program.predicates[action].name).to_area

    # -- wheels and places ------------------------------------------------------------------------------------

    @property
    def motion(self) -> Navigator:
        """The navigator. Raises ActionFailed without a body."""
        if self.driver is None:
            raise ActionFailed(NO_WHEELS)
        return self.driver.navigator

    def percept(self) -> Percept:
        """Return what the robot senses now."""
        return Percept(None, (), False) if self.driver is None else self.driver.percept

    def drive(self, v: float, w: float) -> None:
        """Drive by hand, m/s and rad/s, and give up the place that the robot leaves.

        Raises ActionFailed without a body.
        """
        navigator = self.motion
        if self.driver is not None and v != 0.0:
            self.driver.place = None
        navigator.drive(v, w)

    def halt(self) -> None:
        """Stop the wheels."""
        if self.driver is not None:
            self.driver.navigator.stop()

    def take_place(self, area: Area, turn: ActionPermit | None) -> Point:
        """Choose the robot's place in `area`; the others hear of it. Raises ActionFailed without a body."""
        if self.driver is None:
            raise ActionFailed(NO_WHEELS)
        rank, place = (turn.rank, turn.place) if turn else (0, 0)
        return self.driver.take_place(self.now, area, rank, place, self.peers)

    def depart(self, goal: Point, *, final_heading: float | None, turn: ActionPermit | None) -> None:
        """Set out for `goal`; by a gated `turn` through its gate. Needs a body and a pose."""
        assert self.driver is not None
        assert turn is None or isinstance(turn, Turn)
        self._clock.mark_dirty()
        gated = turn is not None and turn.gated and turn.phase is not Phase.LEFT
        shared = self.turns.leading.shared(turn.event, turn.way) if turn is not None and gated else None
        self.driver.depart(self.now, goal, self.peers, heading=final_heading, gated=gated, shared=shared)
        if turn is not None:
            turn.bound = None
            turn.planned_at = self.now
        if turn is not None and gated:
            self.turns.apply_gate(turn)
        self.presence.hello_soon(self.now)

    def bound_for(self) -> Point | None:
        """Return the place to which the robot drives, or the slot on which it stands."""
        return bound_for(self)

    def change_place(self, now: Instant, place: Point) -> None:
        """Have the driving action go to another place: on a turn the way is planned in time, else at once."""
        running = self.actions.driving
        if running is not None and isinstance(running.turn, Turn):
            redirect(self, now, place, running.turn)
        else:
            self.depart(place, final_heading=None, turn=None)
