"""Why a drive finds no way: the reason that a failed action gives to people.

In this order: what makes the goal itself a place where no hull fits; the obstacles that close every way; the robots
that stand on the goal, or along the ways that there would be without them. No decision depends on it.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from rmr.base.arena import Arena, Disc, Obstacle
from rmr.base.geometry import Point, distance, point_segment_distance
from rmr.node.motion.astar import plan
from rmr.node.motion.grid import PATH_MARGIN_M, TIGHT_MARGIN_M

NAMED_MAX: Final = 5
"""How many robots are named at most."""


class Obstruction(NamedTuple):
    """What is in the way."""

    words: str = ""
    """Subject and verb; empty where it is not known."""
    robots: tuple[int, ...] = ()
    """The robots that are; none where an obstacle is."""


def what_bars(arena: Arena, start: Point, goal: Point, parked: Mapping[int, Point]) -> str:
    """Return what is in the way from `start` to `goal`, in words; empty where that is not known.

    `parked` holds where the other robots stand.
    """
    return obstruction(arena, start, goal, parked).words


def obstruction(arena: Arena, start: Point, goal: Point, parked: Mapping[int, Point]) -> Obstruction:
    """Return what is in the way from `start` to `goal`; `parked` holds where the other robots stand."""
    radius = arena.shape.radius
    if not _within(arena, goal):
        return Obstruction(f"({goal.x:g}, {goal.y:g}) is outside the arena")
    if arena.clearance(*goal) < radius + TIGHT_MARGIN_M:
        return Obstruction(f"{closest_solid(arena, *goal)} leaves no room for a robot at ({goal.x:g}, {goal.y:g})")
    found = plan(arena, start, goal)
    if found is None:
        solid = solid_between(arena, start, goal)
        return Obstruction(
            f"{solid} is in the way, and there is no way around it" if solid else "obstacles close every way"
        )
    keep = 2.0 * radius + PATH_MARGIN_M
    standing = tuple([robot for robot, place in parked.items() if distance(*place, *goal) < keep])
    if standing:
        return Obstruction(f"{robots_named(standing)} at the goal", standing)
    along = _along_every_way(arena, start, goal, found.points, parked)
    if along:
        return Obstruction(f"{robots_named(along)} in the way", along)
    # No single robot stands on the shortest way, so those nearest to it leave too little room between them.
    close = near_polyline(arena, found.points, parked, 2.0 * keep)
    return Obstruction(f"{robots_named(close)} too near to the way", close) if close else Obstruction()


def _along_every_way(
    arena: Arena, start: Point, goal: Point, way: Sequence[Point], parked: Mapping[int, Point]
) -> tuple[int, ...]:
    """Return the robots on the `way` that there is without any, on the next one around these, and so on."""
    named = list(near_polyline(arena, way, parked))
    newest: Sequence[int] = named
    while newest:
        around = plan(arena, start, goal, [parked[robot] for robot in named])
        left = {robot: place for robot, place in parked.items() if robot not in named}
        newest = () if around is None else near_polyline(arena, around.points, left)
        named += newest
    return tuple(sorted(named))


def near_polyline(
    arena: Arena, way: Sequence[Point], places: Mapping[int, Point], within_m: float | None = None
) -> tuple[int, ...]:
    """Return the robots of `places` that are on a polyline, or nearer to it than `within_m`."""
    keep = 2.0 * arena.shape.radius + PATH_MARGIN_M if within_m is None else within_m
    return tuple(
        [
            robot
            for robot, place in places.items()
            if any(point_segment_distance(*place, *a, *b) < keep for a, b in pairwise(way))
        ]
    )


def robots_near(arena: Arena, way: Sequence[Point], parked: Mapping[int, Point]) -> str:
    """Return the robots that stand on a polyline, as subject and verb; empty if there are none."""
    near = near_polyline(arena, way, parked)
    return robots_named(near) if near else ""


def robots_named(robots: Sequence[int], verb: str = "stand") -> str:
    """Return the subject and the verb of a sentence: `robot 3 stands`, or `robots 3 and 4 stand`."""
    return f"{robots_listed(robots)} {verb}{'s' if len(robots) == 1 else ''}"


def robots_listed(robots: Sequence[int]) -> str:
    """Return `robot 3`, or `robots 3 and 4`."""
    if len(robots) == 1:
        return f"robot {robots[0]}"
    named = [str(robot) for robot in robots[:NAMED_MAX]]
    if len(robots) > NAMED_MAX:
        return f"robots {', '.join(named)} and {len(robots) - NAMED_MAX} more"
    return f"robots {', '.join(named[:-1])} and {named[-1]}"


def closest_solid(arena: Arena, x: float, y: float) -> str:
    """Return the name of the obstacle or wall that is nearest to (x, y)."""
    if not _within(arena, Point(x, y)):
        return "the wall"
    wall = min(x, y, arena.width - x, arena.height - y)
    nearest = min(arena.obstacles, key=lambda obstacle: obstacle.distance(x, y), default=None)
    return "the wall" if nearest is None or wall < nearest.distance(x, y) else obstacle_named(nearest)


def obstacle_named(obstacle: Obstacle) -> str:
    """Return what a person recognises an obstacle of the lab file by: where it lies."""
    if isinstance(obstacle, Disc):
        return f"the round obstacle at ({obstacle.centre.x:g}, {obstacle.centre.y:g})"
    x0, y0, x1, y1 = obstacle.extent
    return f"the obstacle from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g})"


def solid_between(arena: Arena, start: Point, goal: Point) -> str:
    """Return the name of the first obstacle that a hull would meet on the straight way; empty if there is none.

    The straight way to a goal outside the arena meets the wall.
    """
    if not _within(arena, goal):
        return "the wall"
    steps = max(1, int(distance(*start, *goal) / arena.cell))
    for k in range(steps + 1):
        x = start.x + (goal.x - start.x) * k / steps
        y = start.y + (goal.y - start.y) * k / steps
        for obstacle in arena.obstacles:
            if obstacle.distance(x, y) < arena.shape.radius:
                return obstacle_named(obstacle)
    return "the wall" if arena.clearance(*goal) < arena.shape.radius else ""


def _within(arena: Arena, point: Point) -> bool:
    return 0.0 <= point.x <= arena.width and 0.0 <= point.y <= arena.height
