"""The queue for a goal: of robots that drive to one place the later ones wait at a distance from it.

Where all of them drove up to it, none could leave. Nobody leads the queue: a robot that is near the goal goes on, of
those that wait about as far away the first in the order goes next, and who stands on the goal is waited for until it
has left. The more go first, the farther away a robot waits, so that they do not close a ring around the one that
leaves. It costs nothing where goals differ.
"""

from collections.abc import Sequence
from typing import Final

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, distance
from rmr.node.motion.grid import TIGHT_MARGIN_M
from rmr.node.motion.priority import Heard, order_key
from rmr.node.motion.route import Route

NEAR_RADII: Final = 6.0
"""Way before the goal at which the next robot waits: the one that leaves has room to pass."""
EACH_RADII: Final = 3.0
"""How much farther away each of those waits that come after it, up to `QUEUED_MAX`."""
QUEUED_MAX: Final = 5
SLACK_RADII: Final = 0.5
"""A robot that is nearer to the goal than where it waits, by more than this, drives on."""
BESIDE: Final = 1.5
"""Robots within this many times the distance at which one stands on a goal are in a ring that waits for itself."""
WAITING_RADII: Final = NEAR_RADII + (QUEUED_MAX + 1) * EACH_RADII
"""Robots nearer to the goal than this wait for it."""


def hold_m(route: Route, shape: RobotShape, ahead: int) -> float:
    """Return the arc length of `route` at which a robot waits, metres, if so many go first: never in a passage."""
    radii = NEAR_RADII + EACH_RADII * (min(ahead, QUEUED_MAX) - 1)
    before = route.length_m - radii * shape.radius
    return before if route.gate_m is None else max(before, route.clear_m)


def is_one_goal(one: Point | None, other: Point | None, shape: RobotShape) -> bool:
    """Return whether a robot at the one goal stands on the other."""
    return one is not None and other is not None and distance(*one, *other) < 2.0 * shape.radius + TIGHT_MARGIN_M


def robots_ahead(
    goal: Point, here: Point, mine: int, shape: RobotShape, others: Sequence[Heard], parked: Sequence[Point]
) -> int:
    """Return how many robots have `goal` before one that is `here`, the one that stands there included.

    `mine` is its key in the order; `others` drive, and stand where they are `parked`.
    """
    radius = shape.radius
    reach = 2.0 * radius + TIGHT_MARGIN_M
    near = (NEAR_RADII - SLACK_RADII) * radius
    away = distance(*here, *goal)
    ahead = sum(distance(*place, *goal) < reach for place in parked)
    for other in others:
        its = distance(other.pose.x, other.pose.y, *goal)
        if its >= WAITING_RADII * radius:
            continue
        comes = is_one_goal(other.goal, goal, shape)
        if its < reach:
            ahead += away >= reach and not _waits_for(here, other, others, reach)
        elif not comes:
            continue
        elif its < near:
            ahead += its < away
        elif away >= near:  # who is farther off by a zone could not get past those that wait
            zone_m = NEAR_RADII * radius
            ahead += (int(its / zone_m), order_key(other.rank, other.robot)) < (int(away / zone_m), mine)
    return ahead


def _waits_for(here: Point, other: Heard, others: Sequence[Heard], reach: float) -> bool:
    """Return whether `other` wants to be `here`, or where one stands who does, or where one stands who wants to there.

    Robots that stand on each other's goals would wait for ever. They all go, and pass each other. Each has to see
    it, and sees places a little differently: who is beside a goal counts as there.
    """
    reach *= BESIDE
    wants = other.goal
    for _ in others:
        if wants is None or distance(*wants, *here) < reach:
            return wants is not None
        place = wants
        wants = next((each.goal for each in others if distance(each.pose.x, each.pose.y, *place) < reach), None)
    return False
