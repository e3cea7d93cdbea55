"""What actions and crossings may ask of their robot: its wheels, its places, its program, the others.

The parts that they share are built one after the other, so `RobotServices` is made early and joined to those that are
made after it (`join`). Its users see it through `rmr.node.parts`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rmr.base.arena import Area
from rmr.base.geometry import Point, Pose, distance
from rmr.base.time import Duration, Instant
from rmr.base.values import Value
from rmr.bytecode.provided import PREDICATES
from rmr.node import payloads
from rmr.node.actions.action_log import ActionBegun
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import ActionFailed, Dispatcher, Handler, Permit, RunningAction
from rmr.node.actions.node_handle import NodeHandle
from rmr.node.crossing.blocked_way import barring, blocked_words
from rmr.node.crossing.crossings import Crossings
from rmr.node.crossing.station_area import full_words
from rmr.node.executive import Executive
from rmr.node.logic.machine_runner import MachineRunner
from rmr.node.motion.navigator import Navigator
from rmr.node.parts import Radio
from rmr.node.peers.perception import LostRobot, Percept
from rmr.node.peers.presence import Presence
from rmr.node.robot_state import RobotState
from rmr.vm.provenance import OUTSIDE, Cause

NO_WHEELS: Final = "the robot has no wheels"


class RobotServices:
    """One robot, as its actions and crossings see it."""

    def __init__(self, state: RobotState, radio: Radio, handlers: Mapping[str, Handler]) -> None:
        """`handlers` are the host's own; they go before the provided ones."""
        self.config = state.config
        self.program = state.program
        self.robot = state.robot
        self.arena = state.config.arena
        self.senses = state.senses
        self.peers = state.peers
        self.driver = state.driver
        self.state: dict[str, Any] = {}
        """What the robot's actions remember (`RobotHandle.state`)."""
        self.action_log = state.action_log
        self.blocked = ""
        """Which dead robots bar the way of the drive under way, in words; empty if none do."""
        self._robot_state = state
        self._radio = radio
        self._handlers = handlers

    def join(
        self, actions: Dispatcher, crossings: Crossings, presence: Presence, runner: MachineRunner, executive: Executive
    ) -> None:
        """Take the parts that are made later; before that only what needs none of them may be asked."""
        self.actions = actions
        self.crossings = crossings
        self._presence = presence
        self._runner = runner
        self._executive = executive

    def take_over(self, other: "RobotServices") -> None:
        """Go on with what the actions remember."""
        self.state = other.state

    @property
    def now(self) -> Instant:
        """The instant of the present call."""
        return self._robot_state.now

    def tell(self, event: object) -> None:
        """Report `event` to the checkers of the run."""
        self._robot_state.tell(event)

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Record an entry of the trace (`rmr.node.trace`)."""
        self._robot_state.trace(now, what, **fields)

    def insert(self, now: Instant, name: str, args: Sequence[Value], cause: Cause = OUTSIDE) -> None:
        """Insert a fact of this robot from outside, or by what `cause` names.

        Raises ValueError when the program does not know it.
        """
        index = self.program.index(name)
        if index is None:
            raise ValueError(f"the program knows no predicate {name}")
        self._robot_state.machine.insert(now, index, tuple(args), cause)
        self._robot_state.mark_dirty()

    def withdraw(self, now: Instant, name: str, args: Sequence[Value], cause: Cause) -> None:
        """Withdraw a sensed fact of this robot, as the handler of an action does; nothing happens if it does not hold.

        Raises ValueError when the program does not know it, it is not sensed, or the robot itself senses it.
        """
        index = self.program.index(name)
        if index is None:
            raise ValueError(f"the program knows no predicate {name}")
        provided = PREDICATES.get(name)
        if provided is not None and provided.sensed:
            raise ValueError(f"{name} is withdrawn by the robot itself, as what it senses changes")
        self._robot_state.machine.withdraw(now, index, tuple(args), cause)
        self._robot_state.mark_dirty()

    def broadcast_failure(self, assertion: int | None) -> None:
        """Tell the others that a deadline of `assertion` was missed (None: none in particular)."""
        self._radio.transmit(payloads.encode_failure(self._robot_state.digest, assertion), None)

    # -- actions ----------------------------------------------------------------------------------------------

    def handle(self, running: RunningAction) -> NodeHandle:
        """Return the handle of an action that starts, and report the start."""
        crossing = self.crossings.crossing(running)
        turn = None if crossing is None else crossing.told
        self.tell(ActionBegun(running.serial, running.text(self.robot), turn))
        return NodeHandle(self, running)

    def action_ended(self, now: Instant, running: RunningAction, failure: str | None) -> None:
        """Handle the end of an action."""
        self._runner.ended(now, running, failure)

    def handler(self, action: str) -> Handler:
        """Return what carries out an action; the host's own handlers go before the provided ones."""
        return self._handlers.get(action) or PROVIDED[action]

    def provided(self, action: str) -> Handler:
        """Return the built-in handler of an action, whatever the host's own handlers are."""
        return PROVIDED[action]

    def drives_to_area(self, action: int) -> bool:
        """Return whether an action drives to the area that it names: it may be gated."""
        return self.handler(self.program.predicates[action].name).to_area

    def expected(self, action: int) -> Duration:
        """Return how long an action takes, as far as is known before it has been done."""
        takes = self.handler(self.program.predicates[action].name).takes
        return self.config.turn if takes is None else takes

    def needs_no_queue(self, since: Instant) -> bool:
        """Return whether the robot need not line up: it has entered after `since`, wasted a slot, or is beyond."""
        return self.crossings.needs_no_queue(since)

    # -- wheels and places ------------------------------------------------------------------------------------

    @property
    def motion(self) -> Navigator:
        """The navigator. Raises ActionFailed without a body."""
        if self.driver is None:
            raise ActionFailed(NO_WHEELS)
        return self.driver.navigator

    @property
    def pose(self) -> Pose | None:
        """Where the robot is, as far as it knows."""
        return None if self.driver is None else self.driver.localiser.pose

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

    def known_dead(self, now: Instant) -> dict[int, LostRobot]:
        """Return the robots that count as dead, and would be heard if they lived: they stand where they were last.

        One that was heard last beyond the radio's sure reach may live and be elsewhere by now.
        """
        lost = self.peers.lost(now)
        pose = self.pose
        if not lost or pose is None or self.config.reaches_all:
            return lost
        surely_hears = self.config.surely_hears
        return {robot: body for robot, body in lost.items() if surely_hears(distance(pose.x, pose.y, *body.place))}

    def barred_by_lost(self, goal: Point) -> str:
        """Return which dead robots bar every way to `goal`, in words; empty if none do."""
        pose = self.pose
        lost = self.known_dead(self.now)
        robots = () if pose is None else barring(self.arena, Point(pose.x, pose.y), goal, lost)
        return blocked_words(self.arena, goal, robots, lost) if robots else ""

    def halt(self) -> None:
        """Stop the wheels."""
        self.blocked = ""
        if self.driver is not None:
            self.driver.navigator.stop()

    def let_navigate(self) -> bool:
        """Let the body's own driver drive until `halt`; return False if it has none."""
        if self.driver is None or not self.config.navigates:
            return False
        self.driver.let_navigate()
        return True

    @property
    def navigation_failure(self) -> str:
        """Why the body's own driver has failed; empty if it has not."""
        return "" if self.driver is None else self.driver.own.failure

    def take_place(self, area: Area, permit: Permit | None) -> Point:
        """Choose the robot's place in `area`; the others hear of it. Raises ActionFailed without a body."""
        if self.driver is None:
            raise ActionFailed(NO_WHEELS)
        if permit is not None and permit.waits:  # it was let go since the dead have all places
            blocked = full_words(self.arena, area, self.known_dead(self.now))
            if blocked:
                self.trace(self.now, "blocked", reason=blocked)
                raise ActionFailed(f"no way there: {blocked}")
        rank, place = (permit.rank, permit.place) if permit else (0, 0)
        return self.driver.take_place(self.now, area, rank, place, self.peers)

    def depart(self, goal: Point, *, final_heading: float | None, permit: Permit | None) -> None:
        """Set out for `goal`; by a gated crossing through its hold line. Needs a body and a pose."""
        self._robot_state.mark_dirty()
        self.crossings.depart(self.now, goal, final_heading, permit)
        self.announce(self.now)

    def goes_on(self) -> bool:
        """Set out for the place that the robot has taken since it drove to the one where it is; False: it took none."""
        return self.crossings.destinations.goes_on()

    @property
    def driving(self) -> RunningAction | None:
        """The action that has the wheels."""
        return self.actions.driving

    @property
    def acts(self) -> bool:
        """Whether an action is under way."""
        return bool(self.actions.running)

    @property
    def frame_ends(self) -> Instant:
        """When the next frame of 1/60 s begins."""
        return self._executive.frame_ends

    def announce(self, now: Instant) -> None:
        """Say hello at once: something that matters to the others has changed."""
        self._presence.hello_soon(now)
