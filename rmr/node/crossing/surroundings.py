"""What the crossings of a robot use of it, as protocols and values. Nothing here knows the robot's node or driver."""

from dataclasses import dataclass
from typing import Any, Protocol

from rmr.base.arena import Area
from rmr.base.geometry import Point, Pose
from rmr.base.grid_path import GridPath
from rmr.base.time import Instant
from rmr.bytecode.program import Program
from rmr.node.actions.dispatcher import Permit, RunningAction
from rmr.node.config import NodeConfig
from rmr.node.crossing.approach import Approach
from rmr.node.logic.sensed_facts import SensedFacts
from rmr.node.motion.navigator import Navigator
from rmr.node.peers.perception import Localiser, Peers


class Wheels(Protocol):
    """A robot's body and its places."""

    localiser: Localiser
    navigator: Navigator
    approach: Approach
    place: Point | None

    def listens(self, now: Instant, peers: Peers) -> bool:
        """Return whether the robot stands until it has heard where all others are."""

    def place_of(self, now: Instant, area: Area, rank: int, place: int, peers: Peers) -> Point:
        """Return the robot's place in `area` by its rank."""

    def depart(
        self, now: Instant, goal: Point, peers: Peers, *, heading: float | None, gated: bool, shared: GridPath | None
    ) -> None:
        """Set out for `goal`, through the hold line if `gated`."""


class CrossingRobot(Protocol):
    """What crossings ask of their robot."""

    @property
    def frame_ends(self) -> Instant:
        """When the next frame begins."""

    @property
    def driving(self) -> RunningAction | None:
        """The action that has the wheels."""

    def drives_to_area(self, action: int) -> bool:
        """Return whether an action drives to the area that it names."""

    def take_place(self, area: Area, permit: Permit | None) -> Point:
        """Choose the robot's place in `area`."""

    def depart(self, goal: Point, *, final_heading: float | None, permit: Permit | None) -> None:
        """Set out for `goal`; the others hear of it."""

    def announce(self, now: Instant) -> None:
        """Say hello at once."""

    def trace(self, now: Instant, what: str, **fields: Any) -> None:
        """Note something for whoever watches the robot."""

    def tell(self, event: object) -> None:
        """Tell whoever checks the run that `event` has happened."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The parts of one robot around its crossings."""

    robot: CrossingRobot
    config: NodeConfig
    program: Program
    facts: SensedFacts
    peers: Peers
    wheels: Wheels | None
    """None: a robot without a body."""

    @property
    def pose(self) -> Pose | None:
        """Where the robot is, as far as it knows."""
        return None if self.wheels is None else self.wheels.localiser.pose
