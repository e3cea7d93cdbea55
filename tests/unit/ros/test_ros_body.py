"""A body in ROS 2, from the numbers of its messages: ways, fixes, the estimate, commands, and what is refused."""

import math
import re
from random import Random

import pytest

from rmr.base.arena import Arena, RobotShape
from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.time import NS_PER_S, milliseconds, tick_start
from rmr.node.ports import SeenBody
from rmr_ros.ros_body import RosBody, deviations, heading, onward
from rmr_world.lab import Ros2Body

ARENA = Arena(3.0, 2.0, 0.05, shape=RobotShape(radius=0.1))
NOWHERE = Pose(0.0, 0.0, 0.0)
BEGAN = 1_700_000_000 * NS_PER_S
"""What the robot's clock shows when its odometry begins."""
TURN = math.pi / 2


def body(origin=NOWHERE):
    return RosBody(Ros2Body(4, "/odom", "/cmd_vel", "/pose", origin=origin), ARENA, Pose(1.0, 1.0, 0.0))


class Driven:
    """A robot that drives a circle of 0.5 m about the middle of the floor; its odometry is that of another frame."""

    def __init__(self, origin=NOWHERE, late=0):
        self.body = body(origin)
        self.origin = origin
        self.late = late
        self.ticks = 0
        self.rng = Random("driven")

    def true(self, ticks):
        angle = 0.4 * ticks / 60
        return Pose(1.5 + 0.5 * math.sin(angle), 1.0 - 0.5 * math.cos(angle), math.remainder(angle, math.tau))

    def measured(self, ticks):
        """Return what its localisation measured at `ticks`, in the frame of the map."""
        x, y, theta = onward(self.origin, NOWHERE, self.true(ticks))
        return Pose(x + self.rng.gauss(0, 0.02), y + self.rng.gauss(0, 0.02), theta + self.rng.gauss(0, 0.03))

    def stamp(self, ticks):
        return BEGAN + tick_start(ticks)

    def run(self, ticks, poses=True):
        """Drive; odometry comes at each tick, a pose at each twelfth, `late` ticks after it was measured."""
        for _ in range(ticks):
            self.ticks += 1
            k = self.ticks
            odometry = onward(Pose(-7.0, 3.0, 2.0), self.true(0), self.true(k))
            self.body.odometry(tick_start(k), self.stamp(k), odometry, Twist(0.2, 0.4))
            if poses and k % 12 == 0 and k > self.late:
                self.body.measured(self.stamp(k - self.late), self.measured(k - self.late), 0.02, 0.03)
            self.body.step(tick_start(k), tick_start(k))

    @property
    def off_m(self):
        return math.dist(self.body.pose[:2], self.true(self.ticks)[:2])


@pytest.mark.parametrize("origin", [NOWHERE, Pose(-4.0, 2.5, 0.0), Pose(1.0, -2.0, 2.0)])
@pytest.mark.parametrize("late", [0, 2, 30])
def test_the_estimate_is_true_whatever_the_frames_and_however_late_the_poses(origin, late):
    robot = Driven(origin, late)
    robot.run(60 * 6)
    assert robot.body.located
    off = []
    for _ in range(60):
        robot.run(6)
        off.append(robot.off_m)
    assert sum(off) / len(off) < 0.012
    assert robot.body.counts["refused"] == 0
    assert robot.body.travelled_m == pytest.approx(0.2 * (robot.ticks - 1) / 60, rel=0.01)


def test_a_pose_that_is_late_would_be_wrong_by_the_way_since_were_it_not_carried_on():
    robot = Driven(late=30)
    robot.run(60 * 6)
    robot.body.measured(robot.stamp(robot.ticks - 30), robot.true(robot.ticks - 30), 0.02, 0.03)
    sample = robot.body.sense(tick_start(robot.ticks), tick_start(robot.ticks), ())
    assert math.dist((sample.fix.x, sample.fix.y), robot.true(robot.ticks)[:2]) < 1e-6
    assert math.dist(robot.true(robot.ticks - 30)[:2], robot.true(robot.ticks)[:2]) > 0.09


def test_a_sample_has_the_ways_of_the_wheels_the_turn_rate_and_each_fix_once():
    robot = Driven()
    robot.run(12)
    sample = robot.body.sense(tick_start(12), tick_start(12), ())
    assert sample.compass is None
    assert sample.ranges == ()
    assert (sample.left_m + sample.right_m) / 2 == pytest.approx(0.2 * 11 / 60, rel=1e-3)
    assert (sample.right_m - sample.left_m) / 0.1 == pytest.approx(0.4 * 11 / 60, rel=1e-3)
    assert sample.gyro == 0.4
    assert (sample.fix.sigma_m, sample.fix.sigma_rad) == (0.02, 0.03)
    assert robot.body.sense(tick_start(12), tick_start(12), ()).fix is None


def test_what_a_scan_shows_stands_beside_the_robots_that_are_known():
    robot = Driven()
    spec = Ros2Body(4, "/odom", "/cmd_vel", "/pose", scan="/scan", scan_at=Pose(-0.03, 0.0, math.pi))
    robot.body = RosBody(spec, ARENA, Pose(1.0, 1.0, 0.0))
    known = SeenBody(0.1, -0.2, 0.0, 0.0)
    ahead = [0.25 if abs(k) <= 10 else math.inf for k in range(-90, 90)]  # 0.22 m before its middle, behind the lidar

    def view(ticks, *bodies):
        sample = robot.body.sense(tick_start(ticks), tick_start(ticks), bodies)
        return sample.bodies

    robot.body.scan(0, robot.stamp(0), 0.0, math.radians(2), ahead)
    assert robot.body.counts["scans"] == 1  # without a pose nobody knows what of it is a wall
    robot.run(60 * 6)
    k = robot.ticks
    assert view(k, known) == (known,)
    robot.body.scan(tick_start(k), robot.stamp(k - 3), math.pi - math.radians(180), math.radians(2), ahead)
    first, other = view(k, known)
    assert first == known
    assert (other.x, other.y) == pytest.approx((0.32, 0.0), abs=0.04)
    assert view(k, SeenBody(0.33, 0.02, 0.1, 0.0)) == (SeenBody(0.33, 0.02, 0.1, 0.0),)
    assert robot.body.sees(tick_start(k))
    assert not robot.body.sees(tick_start(k + 61))
    robot.body.scan(tick_start(k), robot.stamp(k), math.nan, math.radians(2), ahead)
    assert "a scan holds an angle that is none" in robot.body.trouble


def test_without_odometry_for_a_while_there_are_no_samples():
    robot = Driven()
    robot.run(12)
    assert robot.body.sense(tick_start(29), tick_start(29), ()) is not None
    assert robot.body.sense(tick_start(31), tick_start(31), ()) is None
    robot.body.step(tick_start(31), tick_start(31))
    assert robot.body.twist == STILL


def test_odometry_that_begins_anew_adds_no_way_and_keeps_the_pose():
    robot = Driven()
    robot.run(120)
    way = robot.body.sense(tick_start(120), tick_start(120), ()).left_m
    robot.body.odometry(tick_start(121), robot.stamp(121), Pose(0.0, 0.0, 0.0), STILL)
    assert robot.body.sense(tick_start(121), tick_start(121), ()).left_m == way
    assert robot.body.counts["jumps"] == 1
    assert robot.off_m < 0.05
    robot.body.odometry(tick_start(122), robot.stamp(122) - 5 * NS_PER_S, Pose(9.0, 0.0, 0.0), STILL)  # its clock, too
    robot.body.odometry(tick_start(123), robot.stamp(123) - 5 * NS_PER_S, Pose(9.003, 0.0, 0.0), STILL)
    assert robot.body.sense(tick_start(123), tick_start(123), ()).left_m == pytest.approx(way + 0.003)
    assert robot.body.counts["jumps"] == 2


def test_a_pose_that_waits_is_forgotten_when_odometry_begins_anew():
    """It was measured before; carried on by the new odometry it would be another place."""
    robot = Driven()
    robot.run(132)
    robot.body.measured(robot.stamp(132), robot.measured(132), 0.02, 0.03)
    robot.body.odometry(tick_start(140), robot.stamp(140) - 5 * NS_PER_S, Pose(9.0, 0.0, 0.0), STILL)
    assert robot.body.sense(tick_start(140), tick_start(140), ()).fix is None


def test_odometry_that_comes_back_after_a_silence_adds_no_way():
    robot = Driven()
    robot.run(120)
    way = robot.body.sense(tick_start(120), tick_start(120), ()).left_m
    robot.body.odometry(tick_start(1020), robot.stamp(1020), Pose(-5.0, 3.0, 2.0), STILL)  # 15 s later
    assert robot.body.sense(tick_start(1020), tick_start(1020), ()).left_m == way
    assert robot.body.counts["jumps"] == 1


NAN = float("nan")
REFUSED = {
    "odometry of NaN": (lambda b, t: b.odometry(0, t + 1, Pose(NAN, 0.0, 0.0), STILL), "a number that is none"),
    "a speed of infinity": (lambda b, t: b.odometry(0, t + 1, NOWHERE, Twist(math.inf, 0.0)), "a number that is none"),
    "older odometry": (lambda b, t: b.odometry(0, t - milliseconds(20), NOWHERE, STILL), "goes back in time"),
    "a pose of NaN": (lambda b, t: b.measured(t, Pose(1.0, NAN, 0.0), 0.02, 0.03), "a number that is none"),
    "a pose off the floor": (
        lambda b, t: b.measured(t, Pose(-1.0, 1.0, 0.0), 0.02, 0.03),
        r"-1.00, 1.00. is not on",
    ),
    "a pose of long ago": (lambda b, t: b.measured(t - 9 * NS_PER_S, NOWHERE, 0.02, 0.03), r"stamped -9.0 s beside"),
    "a pose of tomorrow": (lambda b, t: b.measured(t + 2 * NS_PER_S, NOWHERE, 0.02, 0.03), r"synchronise the clocks"),
}


@pytest.mark.parametrize(("give", "why"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused_and_said(give, why):
    robot = Driven()
    robot.run(120)
    before = robot.body.sense(tick_start(120), tick_start(120), ())
    give(robot.body, robot.stamp(120))
    assert robot.body.counts["refused"] == 1

    assert re.search(why, robot.body.trouble)
    after = robot.body.sense(tick_start(120), tick_start(120), ())
    assert (after.left_m, after.right_m, after.fix) == (before.left_m, before.right_m, None)
    robot.run(12)
    assert robot.body.trouble == ""


def test_commands_are_limited_to_the_robot_and_stale_ones_dropped():
    robot = body()
    now = NS_PER_S
    assert robot.command(Twist(5.0, -9.0), now, now) == Twist(0.2, -math.pi)
    assert robot.command(Twist(0.1, 0.0), now - milliseconds(101), now) is None
    assert robot.command(Twist(0.1, 0.0), now - 1, now) is None  # decided before the one that it has
    assert robot.command(Twist(NAN, 0.0), now, now) is None
    assert robot.command(Twist(0.1, math.inf), now, now) is None
    assert robot.command(Twist(0.1, 0.0), now + milliseconds(101), now) is None
    assert (robot.counts["commands"], robot.counts["dropped"]) == (1, 5)


def test_headings_of_quaternions():
    for theta in (-3.0, -TURN, 0.0, 1.0, 3.1):
        assert heading(0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2)) == pytest.approx(theta)
    assert heading(0.0, 0.0, 0.0, 0.0) is None  # a message that nobody has filled in
    assert heading(math.sin(0.5), 0.0, 0.0, math.cos(0.5)) is None  # a robot that lies on its side


def test_deviations_of_a_covariance_and_of_none():
    covariance = [0.0] * 36
    assert deviations(covariance, 0.03, 0.05) == (0.03, 0.05)
    covariance[0], covariance[7], covariance[35] = 0.0001, 0.0004, 0.01
    assert deviations(covariance, 0.03, 0.05) == pytest.approx((0.02, 0.1))
    covariance[0] = covariance[7] = 0.0002
    covariance[1] = covariance[6] = 0.0002  # all of it along one diagonal
    assert deviations(covariance, 0.03, 0.05) == pytest.approx((0.02, 0.1))
