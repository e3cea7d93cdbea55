"""The route of a drive that was ordered, around parked robots and around those of a deadlock.

Where there is no route around all of them, it is planned as if some had left: they may be gone when the robot gets
there. Otherwise robots that stand in each other's way would wait for each other.
"""

from collections.abc import Sequence

from rmr.base.arena import Arena
from rmr.base.geometry import Point
from rmr.node.motion.grid import off_goal
from rmr.node.motion.keep_right import gated_route
from rmr.node.motion.route import DriveOrder, Route, follower_route, leader_route, off_queue


def ordered_route(arena: Arena, start: Point, order: DriveOrder, parked: Sequence[Point]) -> Route | None:
    """Return the route from `start` that `order` asks for, around those `parked`; None when there is none.

    Robots that stand before `start` in the gate's queue are no obstacles: they go first. The dead go no more.
    """
    if order.through_gate:
        dead = [place for place in parked if place in order.lost] if order.lost else []
        parked = [*off_queue(arena, start, [place for place in parked if place not in order.lost]), *dead]
    if order.through_gate and order.shared is not None:
        route = follower_route(arena, start, order.goal, parked, order.shared, behind=order.behind)
        if route is None or order.via in (None, route.passage):
            return route
    if order.through_gate:
        return gated_route(arena, start, order.goal, parked, behind=order.behind, via=order.via)
    return leader_route(arena, start, order.goal, parked, through_gate=False)


def replanned(
    arena: Arena,
    start: Point,
    order: DriveOrder,
    parked: tuple[Point, ...],
    around: tuple[Point, ...],
    *,
    at_goal: bool,
) -> Route | None:
    """Return a route `around` all obstacles, else one as if some of them had left.

    Those are the ones that stand on the goal (`at_goal`), or all but the `parked` robots.
    """
    route = ordered_route(arena, start, order, around)
    if route is not None:
        return route
    if at_goal:
        elsewhere = off_goal(around, order.goal, arena.shape.radius)
        return ordered_route(arena, start, order, elsewhere)
    return None if around == parked else ordered_route(arena, start, order, parked)
