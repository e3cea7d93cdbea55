"""The queue for a goal: who goes first, and where the others wait."""

import math
from itertools import pairwise

import pytest

from rmr.base.arena import REFERENCE, Arena
from rmr.base.geometry import Point, Pose
from rmr.node.motion.goal_queue import hold_m, robots_ahead
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.priority import Heard, order_key
from rmr.node.motion.route import Route

GOAL, ELSEWHERE = Point(2.0, 1.0), Point(0.2, 0.2)
NEAR, WAITING, FAR = 0.3, 0.6, 2.0
MINE = order_key(2, 2)


def one(away_m: float, rank: int = 0, goal: Point = GOAL, robot: int = 1) -> Heard:
    return Heard(robot, Pose(GOAL.x, GOAL.y + away_m, 0.0), goal, rank, 0)


@pytest.mark.parametrize(
    ("away_m", "others", "ahead"),
    [
        (WAITING, [], 0),
        (WAITING, [one(NEAR, rank=3)], 1),  # it is on its way in, whatever its place in the order
        (NEAR, [one(NEAR + 0.05, rank=1)], 0),  # and so is this robot
        (WAITING, [one(WAITING, rank=1)], 1),
        (WAITING, [one(WAITING, rank=3)], 0),
        (WAITING, [one(WAITING)], 0),  # without a place in the order
        (WAITING, [one(FAR, rank=1)], 0),  # it does not wait yet
        (WAITING, [one(2.0 * WAITING, rank=1)], 0),  # it would have to get past this robot
        (2.0 * WAITING, [one(WAITING, rank=3)], 1),
        (WAITING, [one(NEAR, goal=ELSEWHERE)], 0),
        (WAITING, [one(0.1, goal=ELSEWHERE)], 1),  # it stands on the goal, and is about to leave
        (0.1, [one(0.1, goal=ELSEWHERE)], 0),
        (WAITING, [one(NEAR, robot=1), one(WAITING, rank=1, robot=3), one(WAITING, rank=3, robot=4)], 2),
    ],
)
def test_the_one_near_the_goal_goes_on_and_of_those_that_wait_the_first_in_the_order(away_m, others, ahead):
    here = Point(GOAL.x - away_m, GOAL.y)
    assert robots_ahead(GOAL, here, MINE, REFERENCE, others, ()) == ahead


def test_a_robot_that_stands_on_the_goal_is_waited_for_one_beside_it_is_not():
    here = Point(GOAL.x - WAITING, GOAL.y)
    assert robots_ahead(GOAL, here, MINE, REFERENCE, (), [Point(GOAL.x, GOAL.y + 0.1)]) == 1
    assert robots_ahead(GOAL, here, MINE, REFERENCE, (), [Point(GOAL.x, GOAL.y + 0.2)]) == 0


def test_robots_that_stand_on_each_others_goals_do_not_wait_for_each_other():
    here = Point(GOAL.x - WAITING, GOAL.y)
    third = Point(1.0, 2.0)
    swaps = [one(0.05, goal=here)]
    assert robots_ahead(GOAL, here, MINE, REFERENCE, swaps, ()) == 0
    ring = [one(0.05, goal=third, robot=1), Heard(3, Pose(*third, 0.0), Point(here.x, here.y + 0.05), 0, 0)]
    assert robots_ahead(GOAL, here, MINE, REFERENCE, ring, ()) == 0
    chain = [one(0.05, goal=third, robot=1), Heard(3, Pose(*third, 0.0), ELSEWHERE, 0, 0)]
    assert robots_ahead(GOAL, here, MINE, REFERENCE, chain, ()) == 1
    on_their_own = [one(0.05, goal=third, robot=1), Heard(3, Pose(*third, 0.0), GOAL, 0, 0)]
    assert robots_ahead(GOAL, here, MINE, REFERENCE, on_their_own, ()) == 1


def test_the_more_go_first_the_farther_away_a_robot_waits_but_never_in_a_passage():
    points = (Point(0.0, 1.0), GOAL)
    open_floor = Route(points, (0.0, 2.0))
    waits = [open_floor.length_m - hold_m(open_floor, REFERENCE, ahead) for ahead in range(1, 9)]
    assert waits[0] > 4.0 * REFERENCE.radius  # a hull and a gap beside the one that leaves
    assert all(b - a > 2.0 * REFERENCE.radius for a, b in pairwise(waits[:5]))
    assert len(set(waits[4:])) == 1
    behind_a_passage = Route(points, (0.0, 2.0), gate_m=0.5, clear_m=1.8)
    assert hold_m(behind_a_passage, REFERENCE, 3) == pytest.approx(1.8)


@pytest.mark.parametrize(("goal", "gives_way"), [(GOAL, False), (Point(GOAL.x, 0.2), True)])
def test_a_robot_that_is_nearly_there_does_not_stand_for_others_that_want_to_the_same_place(goal, gives_way):
    nav = Navigator(Arena(4.0, 2.0, 0.05), 2)
    assert nav.go(0, Pose(GOAL.x - NEAR, GOAL.y, 0.0), GOAL)
    nav.update_moving(0, 2, [Heard(1, Pose(GOAL.x, GOAL.y + WAITING, -math.pi / 2.0), goal, 1, 0)])
    assert (nav._right_of_way < 1.0) is gives_way
