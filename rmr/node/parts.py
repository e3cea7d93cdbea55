"""What the parts of a node are handed of each other: narrow protocols, so that no part imports the node itself.

A part imports the parts below it as they are (`rmr.node.robot_state` and what that joins) and gets what lies beside or
above it as one of these protocols. `rmr.node.node` joins the parts and is imported by hosts alone; `tests/architecture`
says so.
"""

from typing import Any, Protocol

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point, Pose
from rmr.base.time import NEVER, Duration, Instant
from rmr.bytecode.program import Program
from rmr.node.actions.dispatcher import Permit, RunningAction
from rmr.node.config import NodeConfig
from rmr.node.driver import Driver
from rmr.node.logic.sensed_facts import SensedFacts
from rmr.node.motion.navigator import Navigator
from rmr.node.peers.perception import LostRobot, Peers


class Radio(Protocol):
    """The way out to other robots."""

    def transmit(self, payload: bytes, destination: int | None, due: Instant = NEVER) -> int:
        """Hand a payload to the radio (None: broadcast); return the handle by which its outcome is reported.

        `due` is the deadline of a delivery's frame.
        """


class DrivingHost(Protocol):
    """What drives, and places to drive to."""

    config: NodeConfig
    arena: Arena
    peers: Peers

    @property
    def pose(self) -> Pose | None:
        """Where the robot is, as far as it knows."""

    def known_dead(self, now: Instant) -> dict[int, LostRobot]:
        """Return the robots that count as dead, and would be heard if they lived: they stand where they were last."""

    def take_place(self, area: Area, permit: Permit | None) -> Point:
        """Choose the robot's place in `area`; the others hear of it. Raises ActionFailed without a body."""

    def depart(self, goal: Point, *, final_heading: float | None, permit: Permit | None) -> None:
        """Set out for `goal`; by a gated crossing through its hold line. The others hear of it."""

    def goes_on(self) -> bool:
        """Set out for the place that the robot has taken since it drove to the one where it is; False: it took none."""

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Record an entry of the trace."""


class ActionHost(DrivingHost, Protocol):
    """What the provided actions ask of their robot."""

    @property
    def now(self) -> Instant:
        """The instant of the present call."""

    def needs_no_queue(self, since: Instant) -> bool:
        """Return whether the robot need not line up: it has entered after `since`, wasted a slot, or is beyond."""

    @property
    def motion(self) -> Navigator:
        """The navigator. Raises ActionFailed without a body."""

    blocked: str
    """Which dead robots bar the way of the drive under way, in words; empty if none do."""

    def barred_by_lost(self, goal: Point) -> str:
        """Return which dead robots bar every way to `goal`, in words; empty if none do."""

    def let_navigate(self) -> bool:
        """Let the body's own driver drive until `halt`; return False if it has none."""

    @property
    def navigation_failure(self) -> str:
        """Why the body's own driver has failed; empty if it has not."""

    def halt(self) -> None:
        """Stop the wheels."""

    def broadcast_failure(self, assertion: int | None) -> None:
        """Tell the others that a deadline of `assertion` was missed (None: none in particular)."""


class CrossingHost(DrivingHost, Protocol):
    """What the crossings of shared resources ask of their robot."""

    program: Program
    driver: Driver | None
    """None: a robot without a body."""
    senses: SensedFacts

    @property
    def driving(self) -> RunningAction | None:
        """The action that has the wheels."""

    @property
    def acts(self) -> bool:
        """Whether an action is under way."""

    @property
    def frame_ends(self) -> Instant:
        """When the next frame of 1/60 s begins."""

    def announce(self, now: Instant) -> None:
        """Say hello at once: something that matters to the others has changed."""

    def drives_to_area(self, action: int) -> bool:
        """Return whether an action drives to the area that it names: it may be gated."""

    def expected(self, action: int) -> Duration:
        """Return how long an action takes, as far as is known before it has been done."""

    def tell(self, event: object) -> None:
        """Report `event` to the checkers of the run."""
