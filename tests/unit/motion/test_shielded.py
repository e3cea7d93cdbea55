"""The shield as part of the speed law: which robots count, whose business walls are, and how a robot backs out."""

import math

import bench
import pytest

from rmr.base.geometry import Pose, Twist
from rmr.base.time import milliseconds
from rmr.node.motion.hearing import ReportedState
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.shield import Shield
from rmr.node.motion.speed_control import SpeedControl
from rmr.node.ports import SeenBody

ABREAST = Pose(0.2, 0.5, 0.0)
"""Where a robot sets out past one that stands beside it, 8 mm from hull to hull, out of its view."""


def control(*others):
    made = SpeedControl(bench.testbed(), 3, RuleSwitches())
    made.sigma_m = 0.005
    made.perceive(0, ABREAST, ())
    made.hearing.update(ABREAST, list(others))
    return made


def reported(vx, *, parked):
    return ReportedState(2, 0.2, 0.648, vx, 0.0, 0, parked, False)


@pytest.mark.parametrize("parked", [True, False])
def test_a_robot_is_not_passed_within_the_margin_where_it_stands(parked):
    assert control(reported(0.0, parked=parked)).slowed(Twist(0.1, 0.0)).v == 0.0
    assert control().slowed(Twist(0.1, 0.0)).v == 0.1


def test_an_action_that_drives_by_itself_may_touch_a_wall():
    made = SpeedControl(bench.testbed(), 3, RuleSwitches())
    made.sigma_m = 0.005
    pose = Pose(0.08, 0.5, 3.14159)
    made.perceive(0, pose, ())
    made.hearing.update(pose, ())
    assert made.by_hand(Twist(0.1, 0.0)).v == 0.1
    assert made.slowed(Twist(0.1, 0.0)).v < 0.1


AHEAD = Twist(0.2, 0.0)
SIGMA_M = 0.003


def share(*others, twist=AHEAD, age=0):
    """Return the share of `twist` that is permitted among `others`, each (x, y, vx, vy) in the own frame."""
    shield = Shield(0.07, 0.2)
    return shield.among(twist, [shield.driving(*other, SIGMA_M, milliseconds(age)) for other in others])


def test_robot_that_drives_ahead_at_the_same_speed_is_followed_at_four_centimetres():
    assert share((0.18, 0.0, 0.2, 0.0)) == 1.0
    assert share((0.16, 0.0, 0.2, 0.0)) < 1.0


def test_robot_that_comes_to_meet_is_not_driven_at():
    assert share((0.16, 0.0, -0.2, 0.0)) == 0.0
    assert share((0.4, 0.0, -0.2, 0.0)) == 1.0


def test_robot_that_crosses_ahead_is_given_the_way_it_may_need():
    crossing = (0.19, 0.08, 0.0, -0.2)
    assert share(crossing) < 1.0
    assert share(crossing, twist=Twist(0.05, 0.0)) > share(crossing)


def test_robot_from_behind_does_not_keep_one_from_driving_on():
    assert share((-0.145, 0.0, 0.2, 0.0)) == 1.0


def test_old_report_is_kept_farther_from():
    beside = (0.0, 0.16, 0.2, 0.0)
    assert share(beside) == 1.0
    assert share((0.02, 0.16, 0.1, -0.02), age=600) < share((0.02, 0.16, 0.1, -0.02))


def test_robots_that_drive_count_as_they_are_seen_or_else_as_they_were_heard():
    comes = ReportedState(2, 0.42, 0.5, -0.2, 0.0, 0, False, False)
    made = control(comes)
    assert [(round(one.x, 3), round(one.vx, 3)) for one in made._driving(ABREAST)] == [(0.22, -0.2)]
    made.perceive(0, ABREAST, (SeenBody(0.25, 0.0, -0.1, 0.0),))
    assert [(round(one.x, 3), round(one.vx, 3)) for one in made._driving(ABREAST)] == [(0.25, -0.1)]


def test_robot_askew_in_a_passage_turns_until_it_can_back_out():
    made = SpeedControl(bench.testbed(), 1, RuleSwitches())
    made.sigma_m = 0.003
    pose = Pose(0.75, 0.68, 2.75)  # in the passage, its back to the wall below
    turned = 0.0
    for _ in range(200):
        made.perceive(0, pose, ())
        made.hearing.update(pose, ())
        twist = made.reverse()
        if twist.v < 0.0:
            break
        assert twist.w > 0.0, "its back comes away from the wall"
        turned += twist.w / 60.0
        pose = Pose(pose.x, pose.y, pose.theta + twist.w / 60.0)
    assert 0.03 < turned < math.pi / 4
    assert twist.v < 0.0


def test_robot_with_its_back_straight_before_a_wall_stands():
    made = SpeedControl(bench.testbed(), 1, RuleSwitches())
    pose = Pose(0.08, 0.75, 0.0)
    made.perceive(0, pose, ())
    made.hearing.update(pose, ())
    assert made.reverse() == Twist(0.0, 0.0)
