"""A robot that does not get anywhere loses its right of way; one parked at the goal stops no detour."""

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, Pose
from rmr.base.time import seconds
from rmr.node.motion.grid import off_goal
from rmr.node.motion.priority import STOOD, Heard, Standing


def heard(x: float, t: float) -> Heard:
    return Heard(2, Pose(x, 0.5, 0.0), None, 0, seconds(t))


def test_a_robot_that_goes_back_and_forth_stands() -> None:
    standing = Standing(RobotShape())
    for i in range(5):
        standing.update(seconds(0.5 * i), [heard(1.2 + 0.06 * (i % 2), 0.5 * i)])
        assert (2 in standing.points) == (seconds(0.5 * i) >= STOOD)


def test_a_robot_that_drives_on_does_not_stand() -> None:
    standing = Standing(RobotShape())
    for i in range(9):
        standing.update(seconds(0.5 * i), [heard(0.2 + 0.1 * i + 0.02 * i, 0.5 * i)])
        assert not standing.points


def test_who_stands_at_the_goal_is_left_out_and_others_are_not() -> None:
    goal = Point(0.2, 0.75)
    assert off_goal([Point(0.21, 0.75), Point(1.0, 0.5)], goal, 0.07) == [Point(1.0, 0.5)]
