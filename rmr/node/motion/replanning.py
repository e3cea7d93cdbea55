"""The route of a drive that was ordered, around parked robots and around those of a deadlock.

Where there is no route around all of them, it is planned as if some had left: they may be gone when the robot gets
there. Otherwise robots that stand in each other's way would wait for each other.
"""

from collections.abc import Sequence

from rmr.base.arena import Arena
from rmr.base.geometry import Point
from rmr.base.grid_path import GridPath
from rmr.node.motion.astar import plan
from rmr.node.motion.grid import off_goal
from rmr.node.motion.keep_right import gated_route
from rmr.node.motion.leader_path import follower_route
from rmr.node.motion.route import DriveOrder, Route, leader_route, off_queue


def obstacles_of(arena: Arena, start: Point, order: DriveOrder, parked: Sequence[Point]) -> Sequence[Point]:
    """Return those of `parked` around which a drive from `start` goes.

    Robots that stand before `start` in the gate's queue are no obstacles: they go first. The dead go no more.
    """
    if not order.through_gate:
        return parked
    dead = [place for place in parked if place in order.lost] if order.lost else []
    return [*off_queue(arena, start, [place for place in parked if place not in order.lost]), *dead]


def ordered_route(arena: Arena, start: Point, order: DriveOrder, parked: Sequence[Point]) -> Route | None:
    """Return the route from `start` that `order` asks for, around those `parked`; None when there is none."""
    parked = obstacles_of(arena, start, order, parked)
    if not order.through_gate:
        return leader_route(arena, start, order.goal, parked, through_gate=False)
    own = gated_route(arena, start, order.goal, parked, behind=order.behind, via=order.via)
    if order.shared is None or own is None or own.gate_m is None or not _leads_on(arena, own, order.shared):
        return own  # a way that passes nothing is not shared
    route = follower_route(arena, start, order.goal, parked, order.shared, behind=order.behind)
    serves = route is None or (order.via in (None, route.passage) and route.passage == own.passage)
    return route if serves else own


def _leads_on(arena: Arena, route: Route, shared: GridPath) -> bool:
    """Return whether `shared` leads in the direction of `route`: a robot may have turned round since it was offered."""
    cells = shared.cells()
    first, last = (
        route.project((column + 0.5) * arena.cell, (row + 0.5) * arena.cell, 0.0, route.length_m)
        for column, row in (cells[0], cells[-1])
    )
    return first < last


def is_barred(arena: Arena, start: Point, order: DriveOrder, parked: Sequence[Point]) -> bool:
    """Return whether `parked` robots bar every way from `start` to the goal of `order`."""
    return plan(arena, start, order.goal, obstacles_of(arena, start, order, parked)) is None


def route_as_if_left(
    arena: Arena,
    start: Point,
    order: DriveOrder,
    parked: tuple[Point, ...],
    around: tuple[Point, ...],
    *,
    at_goal: bool,
) -> Route | None:
    """Return a route as if some of those `around` had left, where there is none around all of them.

    Those are the ones that stand on the goal, before which the robot waits, and, but with `at_goal`, all that are not
    `parked`.
    """
    route = ordered_route(arena, start, order, off_goal(around, order.goal, arena.shape.radius))
    if route is not None or at_goal or around == parked:
        return route
    return ordered_route(arena, start, order, off_goal(parked, order.goal, arena.shape.radius))
