"""Whether the dead bar a way, for robots that stand where the dead were heard last."""

from rmr.base.arena import Arena, Polygon
from rmr.base.geometry import Point
from rmr.node.crossing.blocked_way import barring
from rmr.node.peers.perception import LostRobot

WALLS = tuple(
    Polygon((Point(1.2, low), Point(1.8, low), Point(1.8, high), Point(1.2, high)))
    for low, high in ((0.0, 0.6), (0.9, 1.5))
)


def test_a_dead_robot_bars_a_passage_for_one_that_stands_where_it_was_heard_last():
    arena = Arena(3.0, 1.5, 0.05, WALLS)
    lost = {2: LostRobot(place=Point(1.02, 0.75), silent_since=0)}
    goal = Point(2.6, 0.39)
    for x in (0.7, 0.85, 0.93):
        assert barring(arena, Point(x, 0.75), goal, lost) == (2,), x
