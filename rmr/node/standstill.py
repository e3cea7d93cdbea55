"""What a robot's wheels do in a tick, and for whom they stand: for whoever explains a run, never for the robot itself.

A robot counts as kept standing in the sense of the deadlock detector: it gets no more than a quarter of its full speed.
"""

import math
from collections.abc import Collection
from enum import Enum
from typing import NamedTuple

from rmr.base.geometry import Point
from rmr.base.time import Instant, in_seconds
from rmr.node.driver import Driver
from rmr.node.motion.hearing import DEAD
from rmr.node.motion.hindrance import Hindrance, Neighbourhood, barred, hindrance, touched
from rmr.node.motion.priority import Heard
from rmr.node.motion.standoff.detector import KEPT_SHARE
from rmr.node.peers.perception import HEARD, Peers, driving_of


class Motion(Enum):
    """What the wheels do."""

    IDLE = "idle"
    """Nothing: no drive is under way, or it has arrived."""
    LOCATES = "locates"
    """The robot does not know where it is; in a recording with true poses, or is far from where it takes itself."""
    DRIVES = "drives"
    GATED = "gated"
    """It stands, or drives more slowly, so as not to be at the commit line before its slot."""
    STANDS = "stands"
    """It is kept standing, or carries out an escape manoeuvre."""
    UNWATCHED = "unwatched"
    """It stands since its newest sample is too old: its host is late."""


class MotionState(NamedTuple):
    """What the wheels do, and why."""

    motion: Motion
    why: Hindrance = Hindrance("")


def motion_state(
    now: Instant,
    driver: Driver | None,
    peers: Peers,
    robot: int,
    roster: Collection[int],
    drives_since: Instant | None,
) -> MotionState | None:
    """Return what the wheels of `robot` have done in the call of `now`; an action has had them `drives_since`.

    None: the call has come between two frames, or the action has begun in it: its wheels have not been looked at yet.
    """
    if driver is None or drives_since is None:
        return MotionState(Motion.IDLE)
    if driver.localiser.pose is None:
        return MotionState(Motion.LOCATES)
    navigator = driver.navigator
    if navigator.status == "blocked":
        return MotionState(Motion.STANDS, barred(navigator, neighbourhood(now, peers, robot, roster)))
    if navigator.status != "moving":
        return MotionState(Motion.IDLE)
    if drives_since == now or (not driver.held_by and navigator.control.scene.now != now):
        return None
    if driver.held_by:
        unwatched = driver.held_by == "unwatched"
        return MotionState(Motion.UNWATCHED if unwatched else Motion.STANDS, Hindrance(driver.held_by))
    return _limited(now, driver, peers, robot, roster)


def _limited(now: Instant, driver: Driver, peers: Peers, robot: int, roster: Collection[int]) -> MotionState:
    navigator = driver.navigator
    rule = navigator.control.law.limited_by
    slow = driver.speed <= KEPT_SHARE * navigator.arena.shape.speed
    if rule == "gate":
        return MotionState(Motion.GATED)
    if driver.percept.bumped and driver.moving:
        return MotionState(Motion.STANDS, touched(navigator, neighbourhood(now, peers, robot, roster)))
    if slow and rule and rule != "lost":
        return MotionState(Motion.STANDS, hindrance(navigator, rule, neighbourhood(now, peers, robot, roster)))
    if driver.speed < 0.0 or navigator.aside:
        return MotionState(Motion.STANDS, Hindrance(navigator.policy.chosen))
    return MotionState(Motion.DRIVES)


def neighbourhood(now: Instant, peers: Peers, robot: int, roster: Collection[int]) -> Neighbourhood:
    """Return the others as `robot` knows them now. What `peers` keeps for later, and its order, stay as they are."""
    places: dict[int, tuple[Point, Point]] = {}
    standing: dict[int, Point] = {}
    driving: list[Heard] = []
    for other, peer in sorted(peers.known.items()):
        hello = peer.hello
        if hello is None:
            continue
        age = now - peer.hello_at
        was = Point(hello.x, hello.y)
        # Dead reckoning since the hello; one that is parked stays where it is.
        way_m = 0.0 if hello.parked else hello.v * in_seconds(min(age, DEAD))
        places[other] = (was, Point(was.x + way_m * math.cos(hello.theta), was.y + way_m * math.sin(hello.theta)))
        if hello.parked or age > DEAD:
            standing[other] = was
        heard = driving_of(other, hello, peer.hello_at)
        if heard is not None and age <= HEARD:
            driving.append(heard)
    unplaced = tuple([other for other in roster if other != robot and other not in places])
    return Neighbourhood(places, standing, driving, unplaced)
