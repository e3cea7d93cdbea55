"""Drives that are not begun, or not ended: how long they take, and which part of their route a leader shares."""

from collections.abc import Sequence

from rmr.base.arena import Arena
from rmr.base.geometry import Point, Pose
from rmr.base.grid_path import GridPath
from rmr.node.motion.estimate import Estimate, estimate_of
from rmr.node.motion.follow import Follower
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.leader_path import shared_part
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.replanning import ordered_route
from rmr.node.motion.route import DriveOrder


def estimate(arena: Arena, pose: Pose, goal: Point, parked: Sequence[Point] = ()) -> Estimate | None:
    """Return the estimate of a drive from `pose` to `goal`; None if there is no route."""
    order = DriveOrder(goal, None, through_gate=True)
    route = ordered_route(arena, Point(pose.x, pose.y), order, parked)
    if route is None:
        return None
    turn = abs(Follower(route, arena.shape).heading_error(pose))
    return estimate_of(arena.shape, route, EntryGate(arena.shape, holding=False).commit_line_m(route), turn)


def estimate_of_drive(navigator: Navigator) -> Estimate | None:
    """Return the estimate of the drive under way through its gate; None without a gate."""
    route = navigator.route
    if route is None or route.gate_m is None:
        return None
    shape = navigator.arena.shape
    found = estimate_of(shape, route, EntryGate(shape, holding=False).commit_line_m(route), 0.0)
    return found._replace(approach=navigator.eta_gate())


def shared_path(arena: Arena, pose: Pose, goal: Point, behind: frozenset[str] = frozenset()) -> GridPath | None:
    """Return the part of the route from `pose` to `goal` that the robot shares when it leads (paper IV.D.1)."""
    order = DriveOrder(goal, None, through_gate=True, behind=behind)
    route = ordered_route(arena, Point(pose.x, pose.y), order, ())
    return None if route is None else shared_part(arena, route)
