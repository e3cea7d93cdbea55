"""Why a drive finds no way: the reason names the obstacle, the wall or the robots in the way."""

import pytest

from rmr.base.arena import Arena, Disc, Polygon
from rmr.base.geometry import Point
from rmr.node.motion.obstruction import robots_named, what_bars

WALL = Polygon((Point(1.0, 0.0), Point(1.1, 0.0), Point(1.1, 1.0), Point(1.0, 1.0)))
OPEN, PARTED = Arena(2.0, 1.0, 0.05), Arena(2.0, 1.0, 0.05, obstacles=(WALL,))
START, GOAL = Point(0.3, 0.5), Point(1.7, 0.5)


@pytest.mark.parametrize(
    ("arena", "goal", "parked", "words"),
    [
        (OPEN, GOAL, {}, ""),
        (OPEN, GOAL, {3: Point(1.0, 0.1)}, ""),
        (OPEN, GOAL, {3: GOAL}, "robot 3 stands at the goal"),
        (OPEN, GOAL, {3: Point(1.0, 0.5), 4: Point(1.0, 0.6)}, "robots 3 and 4 stand in the way"),
        (
            OPEN,
            GOAL,
            {3: Point(1.0, 0.38), 4: Point(1.2, 0.62), 5: Point(1.1, 0.14), 6: Point(1.1, 0.86), 7: Point(0.3, 0.9)},
            "robots 3, 4, 5 and 6 stand in the way",
        ),
        (OPEN, Point(3.0, 0.5), {}, "(3, 0.5) is outside the arena"),
        (OPEN, Point(0.02, 0.5), {}, "the wall leaves no room for a robot at (0.02, 0.5)"),
        (PARTED, GOAL, {}, "the obstacle from (1, 0) to (1.1, 1) is in the way, and there is no way around it"),
        (
            PARTED,
            Point(0.95, 0.5),
            {},
            "the obstacle from (1, 0) to (1.1, 1) leaves no room for a robot at (0.95, 0.5)",
        ),
        (
            Arena(2.0, 1.0, 0.05, obstacles=(Disc(Point(1.7, 0.5), 0.1),)),
            GOAL,
            {},
            "the round obstacle at (1.7, 0.5) leaves no room for a robot at (1.7, 0.5)",
        ),
    ],
)
def test_reason_names_who_or_what_is_in_the_way(arena, goal, parked, words):
    assert what_bars(arena, START, goal, parked) == words


def test_many_robots_in_the_way_are_counted():
    assert robots_named(list(range(1, 8))) == "robots 1, 2, 3, 4, 5 and 2 more stand"
