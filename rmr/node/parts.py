"""What the parts of a node are handed of each other: narrow protocols, so that no part imports the node itself.

A part imports the parts below it as they are (`rmr.node.robot_state` and what that joins) and gets what lies beside or
above it as one of these protocols. `rmr.node.node` joins the parts and is imported by hosts alone; `tests/architecture`
says so.
"""

from typing import Any, Protocol

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point
from rmr.base.time import Instant
from rmr.node.actions.action_log import ActionLog
from rmr.node.actions.dispatcher import Handler, Permit
from rmr.node.config import NodeConfig
from rmr.node.motion.navigator import Navigator
from rmr.node.peers.perception import Peers, Percept


class Radio(Protocol):
    """The way out to other robots."""

    def transmit(self, payload: bytes, destination: int | None) -> int:
        """Hand a payload to the radio (None: for everybody); return the handle by which its outcome will be known."""


class RunnerHost(Protocol):
    """What carries out actions, and the report's list of them."""

    action_log: ActionLog

    def handler(self, action: str) -> Handler:
        """Return what carries out an action; the host's own handlers go before the provided ones."""


class Queue(Protocol):
    """What a waiting action asks about the robot's crossings."""

    @property
    def slot_wasted(self) -> bool:
        """Whether a slot has been wasted: the robot could not get to the gate."""

    @property
    def beyond(self) -> bool:
        """Whether the robot has the bottleneck behind it."""

    def entered_since(self, instant: Instant) -> bool:
        """Return whether a turn of this robot has begun after `instant`."""


class DrivingHost(Protocol):
    """What drives, and places to drive to."""

    config: NodeConfig
    arena: Arena
    peers: Peers

    def percept(self) -> Percept:
        """Return what the robot senses now."""

    def take_place(self, area: Area, permit: Permit | None) -> Point:
        """Choose the robot's place in `area`; the others hear of it. Raises ActionFailed without a body."""

    def depart(self, goal: Point, *, final_heading: float | None, permit: Permit | None) -> None:
        """Set out for `goal`; by a gated crossing through its gate."""

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Note something for whoever watches the robot."""


class ActionHost(DrivingHost, Protocol):
    """What the provided actions ask of their robot."""

    @property
    def now(self) -> Instant:
        """The instant of the present call."""

    @property
    def crossings(self) -> Queue:
        """The robot's crossings."""

    @property
    def motion(self) -> Navigator:
        """The navigator. Raises ActionFailed without a body."""

    def halt(self) -> None:
        """Stop the wheels."""

    def broadcast_failure(self, assertion: int | None) -> None:
        """Tell the others that a deadline of `assertion` was missed (None: none in particular)."""
