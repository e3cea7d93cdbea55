"""Who or what keeps a robot standing: the rule that limits its speed now, and the robot or the obstacle behind it.

For people, and asked after a tick by whoever explains a run: no decision of the robot depends on it, and a robot that
is not asked spends nothing on it. A robot is known by the place that its hellos report; a body that no hello accounts
for is named by where it is.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from rmr.base.geometry import Point, Pose, distance, point_segment_distance
from rmr.node.motion.goal_queue import WAITING_RADII
from rmr.node.motion.hazards import HazardScene
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.obstruction import closest_solid, obstruction, robots_listed, robots_named
from rmr.node.motion.priority import Heard, order_key, share_of_speed
from rmr.node.motion.queueing import queue_reach
from rmr.node.motion.route import off_queue
from rmr.node.motion.speed_control import REVERSE_POLL_M

SAME_RADII: Final = 2.0
"""A body nearer than this to the reported place of a robot is that robot."""
NO_WAY: Final = "no way"
"""What stands for a rule where a robot finds no way to its goal."""
BUMPED: Final = "bumped"
"""What stands for a rule where a robot drives against a hull or an obstacle."""


class Neighbourhood(NamedTuple):
    """The others, as one robot knows them at one instant."""

    places: Mapping[int, tuple[Point, Point]]
    """Where each of them was at its last hello, and where it is now if it has driven on since: it is in between."""
    standing: Mapping[int, Point]
    """Where those stand that are parked or dead."""
    driving: Sequence[Heard]
    """What those said that drive."""
    unplaced: tuple[int, ...]
    """Robots of the roster that have never said where they are."""


class Hindrance(NamedTuple):
    """Why a robot stands, or drives slowly."""

    rule: str
    """A name of `HAZARDS` or `ESCAPES`, NO_WAY or BUMPED."""
    robots: tuple[int, ...] = ()
    """The robots that are the reason, by id."""
    place: str = ""
    """The obstacle or the unknown body that is, in words."""


def hindrance(navigator: Navigator, rule: str, others: Neighbourhood) -> Hindrance:
    """Return who is behind `rule`, which limits the robot's speed in this tick."""
    scene = navigator.control.scene
    match rule:
        case "listen":
            return Hindrance(rule, others.unplaced)
        case "silence" | "overdue":
            return Hindrance(rule, tuple(sorted(navigator.hearing.unheard(scene.now, scene.pose))) or others.unplaced)
        case "right_of_way":
            return Hindrance(rule, _going_first(navigator, others))
        case "queue":
            return Hindrance(rule, _ahead_in_queue(navigator, others))
        case "goal":
            return Hindrance(rule, _at_goal(navigator, others))
        case "ways":
            return _for_body(scene, rule, others)
        case "reverse_guard":
            return _at(scene.pose, -REVERSE_POLL_M, navigator, rule, others)
        case "shield":
            return _at(scene.pose, 0.0, navigator, rule, others)
        case _:  # nobody is behind it
            return Hindrance(rule)


def hindrance_words(why: Hindrance) -> str:
    """Return a hindrance as a clause of a sentence about the robot: `it waits to hear robot 3`."""
    whom = robots_listed(why.robots) if why.robots else why.place
    if why.rule == NO_WAY:
        return f"it finds no way: {robots_named(why.robots)} in it" if why.robots else f"it finds no way: {whom}"
    words = _CLAUSES.get(why.rule)
    if words is None:
        return f"it makes room by the escape {why.rule}" if why.rule else ""
    return words.format(whom or "another robot")


_CLAUSES: Final = {
    "listen": "it waits to hear {} for the first time",
    "majority": "it hears too few robots that hear it",
    "silence": "it waits to hear {}",
    "overdue": "it waits to hear {}",
    "right_of_way": "it gives {} the right of way",
    "queue": "it waits behind {} in the queue",
    "goal": "it waits for its goal, which {} has first",
    "ways": "it stands for {}",
    "reverse_guard": "it cannot back up for {}",
    "shield": "it keeps its distance from {}",
    "sight": "it looks before it drives: a robot that is not heard may be near",
    "promise": "it has promised the others to stay",
    "unwatched": "its newest sample is too old",
    BUMPED: "it drives against {}",
}
"""By rule, what a robot does that it limits; the braces stand for the robots or the obstacle."""


def touched(navigator: Navigator, others: Neighbourhood) -> Hindrance:
    """Return what a robot touches that drives and bumps."""
    return _at(navigator.control.scene.pose, 0.0, navigator, BUMPED, others)


def barred(navigator: Navigator, others: Neighbourhood) -> Hindrance:
    """Return what is in the way of a robot that finds no way to its goal."""
    pose = navigator.control.scene.pose
    if navigator.goal is None:
        return Hindrance(NO_WAY)
    found = obstruction(navigator.arena, Point(pose.x, pose.y), navigator.goal, others.standing)
    return Hindrance(NO_WAY, found.robots, found.words if not found.robots else "")


def nearest(places: Mapping[int, tuple[Point, Point]], x: float, y: float, within_m: float) -> int | None:
    """Return the robot of `places` nearest to (x, y); None if none is `within_m`."""
    near = [(point_segment_distance(x, y, *was, *now), robot) for robot, (was, now) in places.items()]
    away, robot = min(near, default=(math.inf, 0))
    return robot if away < within_m else None


def _going_first(navigator: Navigator, others: Neighbourhood) -> tuple[int, ...]:
    """Return the robots that go first and whose predicted paths cross this one's."""
    route = navigator.route
    if route is None:
        return ()
    shape = navigator.arena.shape
    now = navigator.control.scene.now
    s = route.length_m - navigator.remaining_m
    mine = navigator.hearing.order
    first = [other for other in others.driving if order_key(other.rank, other.robot) < mine]
    slowing = [other.robot for other in first if share_of_speed(now, route, s, shape, [other]) < 1.0]
    # The share was worked out up to 0.2 s ago; where it no longer holds all that go first are named.
    return tuple(slowing or [other.robot for other in first])


def _ahead_in_queue(navigator: Navigator, others: Neighbourhood) -> tuple[int, ...]:
    """Return the robots that stand before this one in the queue."""
    pose = navigator.control.scene.pose
    at = Point(pose.x, pose.y)
    reach = queue_reach(navigator.arena.shape)
    near = {robot: place for robot, place in others.standing.items() if distance(*place, *at) < reach}
    return tuple(robot for robot, place in near.items() if not off_queue(navigator.arena, at, [place]))


def _at_goal(navigator: Navigator, others: Neighbourhood) -> tuple[int, ...]:
    """Return the robot that is nearest to the goal of this one."""
    goal = navigator.goal
    if goal is None:
        return ()
    robot = nearest(others.places, *goal, WAITING_RADII * navigator.arena.shape.radius)
    return () if robot is None else (robot,)


def _for_body(scene: HazardScene, rule: str, others: Neighbourhood) -> Hindrance:
    """Return the body that slows the robot most."""
    worst = scene.held_by
    if worst is None:
        return Hindrance(rule)
    pose = scene.pose
    x = pose.x + worst.x * math.cos(pose.theta) - worst.y * math.sin(pose.theta)
    y = pose.y + worst.x * math.sin(pose.theta) + worst.y * math.cos(pose.theta)
    robot = nearest(others.places, x, y, SAME_RADII * scene.arena.shape.radius)
    if robot is not None:
        return Hindrance(rule, (robot,))
    return Hindrance(rule, (), f"a robot near ({x:.1f}, {y:.1f}) that no hello accounts for")


def _at(pose: Pose, ahead_m: float, navigator: Navigator, rule: str, others: Neighbourhood) -> Hindrance:
    """Return what a hull touches, or would touch `ahead_m` from its place: the nearest robot, else an obstacle."""
    x = pose.x + ahead_m * math.cos(pose.theta)
    y = pose.y + ahead_m * math.sin(pose.theta)
    radius = navigator.arena.shape.radius
    robot = nearest(others.places, x, y, 2.0 * radius + 2.0 * REVERSE_POLL_M)
    if robot is not None:
        return Hindrance(rule, (robot,))
    return Hindrance(rule, (), closest_solid(navigator.arena, x, y))
