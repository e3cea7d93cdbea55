"""The shield as part of the speed law: which robots count, and whose business walls are."""

import bench
import pytest

from rmr.base.geometry import Pose, Twist
from rmr.node.motion.hearing import ReportedState
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.speed_control import SpeedControl

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
