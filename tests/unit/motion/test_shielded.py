"""The shield as part of the speed law: which robots count, whose business walls are, and how a robot backs out."""

import math

import bench
import pytest

from rmr.base.arena import Arena, RobotShape
from rmr.base.geometry import Point, Pose, Twist
from rmr.base.time import tick_start
from rmr.node.motion.hearing import ReportedState
from rmr.node.motion.navigator import Navigator
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


def test_robot_in_view_counts_as_it_is_seen_and_not_as_it_was_heard():
    made = control(ReportedState(2, 0.36, 0.5, 0.0, 0.0, 0, True, False))
    assert made._shielded(Twist(0.1, 0.0)).v < 0.1
    made.perceive(0, ABREAST, (SeenBody(0.18, 0.0, 0.0, 0.0),))
    assert made._shielded(Twist(0.1, 0.0)).v == 0.1


@pytest.mark.parametrize(("settled", "v"), [(False, 0.0), (True, 0.1)])
def test_a_robot_that_has_stood_for_a_second_may_be_passed_nearer(settled, v):
    gap_m = 0.019  # three standard deviations: 17.5 mm, or 21.2 mm if it has just arrived
    beside = ReportedState(2, 0.2, 0.5 + 2.0 * 0.07 + gap_m, 0.0, 0.0, 0, True, False, settled=settled)
    assert control(beside)._shielded(Twist(0.1, -0.03)).v == v


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


def driven_past_a_corner(pose):
    """Return how far a robot gets in a second from `pose` at the end of the corridor, its goal beyond the corner."""
    nav = Navigator(bench.testbed(), 1)
    nav.control.sigma_m = 0.006
    nav.go(0, pose, Point(1.38, 0.36))
    way = 0.0
    for tick in range(60):
        twist = nav.step(tick_start(tick), pose, (), False)
        theta = pose.theta + twist.w / 60.0
        pose = Pose(pose.x + twist.v * math.cos(theta) / 60.0, pose.y + twist.v * math.sin(theta) / 60.0, theta)
        way += twist.v / 60.0
    return way


@pytest.mark.parametrize("heading", [-0.29, -0.2, -0.1])
def test_robot_that_would_cut_a_corner_keeps_to_its_path_instead_of_creeping(heading):
    assert driven_past_a_corner(Pose(0.86, 0.69, heading)) > 0.08


def test_a_fast_robot_that_is_to_back_up_while_it_still_rolls_brakes_whoever_is_heard_no_more():
    shape = RobotShape(speed=1.0)
    made = SpeedControl(Arena(6.0, 6.0, 0.05, shape=shape), 3, RuleSwitches())
    made.sigma_m = 0.005
    pose = Pose(3.0, 3.0, 0.0)
    others = [ReportedState(robot, 4.5, 3.0 + 0.4 * robot, 0.0, 0.0, 0, False, False) for robot in (2, 3)]
    for tick in range(61):
        made.perceive(tick_start(tick), pose, ())
        made.hearing.update(pose, others)
        made.wheels.command(tick_start(tick), made.slowed(Twist(0.8, 0.0)))
    made.perceive(tick_start(61), pose, ())
    made.hearing.update(pose, others[:1])
    assert made.wheels.speed(tick_start(61)) > 0.2
    assert made.reverse().v <= 0.0


def test_robot_with_its_back_straight_before_a_wall_stands():
    made = SpeedControl(bench.testbed(), 1, RuleSwitches())
    pose = Pose(0.08, 0.75, 0.0)
    made.perceive(0, pose, ())
    made.hearing.update(pose, ())
    assert made.reverse() == Twist(0.0, 0.0)


def test_the_memory_of_a_clearance_changes_no_command_and_saves_most_of_the_measuring(monkeypatch):
    arena = bench.testbed()
    measured = []
    clearance = Arena.clearance
    monkeypatch.setattr(Arena, "clearance", lambda self, x, y: (measured.append(x), clearance(self, x, y))[1])
    remembers = SpeedControl(arena, 1, RuleSwitches())
    asked = measured_by_it = 0
    for i in range(2000):  # to and fro in curves, through open floor and along walls, at 1 to 4 mm a tick
        pose = Pose(0.75 + 0.6 * math.sin(0.005 * i), 0.5 + 0.3 * math.sin(0.003 * i), 0.02 * i)
        twist = Twist(0.05 + 0.03 * (i % 6), 0.5 * math.sin(0.01 * i))
        measured.clear()
        remembers.perceive(0, pose, ())
        given = remembers._shielded(twist)
        asked += 1
        measured_by_it += bool(measured)
        fresh = SpeedControl(arena, 1, RuleSwitches())
        fresh.perceive(0, pose, ())
        share = Shield(arena.shape.radius, arena.shape.speed).within(twist, pose, arena, 0.0)
        assert given == fresh._shielded(twist)
        assert given == (twist if share >= 1.0 else Twist(share * twist.v, share * twist.w))
    assert 0 < measured_by_it < 0.7 * asked


def test_a_fast_robot_drives_through_a_narrow_aisle_as_slowly_as_its_walls_permit():
    """A robot of 1.97 m/s in an aisle that leaves it 4.5 cm on each side: half of its speed is not hardly driving."""
    shape = RobotShape(speed=1.97, view_depth=1.0)
    aisle = Arena(8.0, 4.0, 0.05, (bench.box(1.0, 0.0, 7.0, 1.885), bench.box(1.0, 2.115, 7.0, 4.0)), shape=shape)
    nav = Navigator(aisle, 1)
    nav.control.sigma_m = 0.008
    pose = Pose(1.5, 2.0, 0.0)
    assert nav.go(0, pose, Point(7.5, 2.0))
    for k in range(1, 30):
        twist = nav.step(tick_start(k), pose, (), bumped=False)
    assert 0.2 < twist.v < 0.5 * shape.speed
    assert twist.w == 0.0


@pytest.mark.parametrize(("sigma_m", "settles"), [(0.02, True), (0.0, False)])
def test_a_robot_before_a_wall_waits_for_its_estimate_to_settle_and_not_for_the_wall(sigma_m, settles):
    made = SpeedControl(bench.testbed(), 1, RuleSwitches())
    made.sigma_m = sigma_m
    pose = Pose(0.11 if settles else 0.071, 0.5, math.pi)
    made.perceive(0, pose, ())
    made.hearing.update(pose, ())
    assert made.slowed(Twist(0.1, 0.0)).v < 0.1
    assert made.leads_to_wall(Twist(0.1, 0.0))
    assert made.settles(Twist(0.1, 0.0)) is settles


def reverses_after_s(sigma_m):
    """Return when a robot that stands where the error of its estimate keeps it off its goal by a wall backs up."""
    nav = Navigator(bench.testbed(), 1)
    nav.control.sigma_m = sigma_m
    pose = Pose(0.13, 0.5, math.pi)
    nav.go(0, pose, Point(0.105, 0.5))
    for tick in range(60 * 30):
        if nav.step(tick_start(tick), pose, (), False).v < 0.0:
            return tick / 60.0
    return math.inf


def test_a_robot_that_its_estimate_keeps_off_a_goal_by_a_wall_stands_for_a_while_before_it_backs_up():
    assert 10.0 < reverses_after_s(0.02) < 25.0


def drives_off(goal):
    """Return how far a robot beside one that stands within its margin gets in 0.7 s on its way to `goal`, and how near.

    Both in metres; near is from hull to hull. Later the other one would be overdue, for it says nothing.
    """
    nav = Navigator(Arena(2.0, 2.0, 0.05), 2)
    nav.control.sigma_m = 0.005
    pose, beside = ABREAST, ReportedState(2, 0.2, 0.648, 0.0, 0.0, 0, True, False, settled=True)
    nav.go(0, pose, goal, parked=[Point(beside.x, beside.y)])
    near = math.inf
    for tick in range(42):
        nav.hearing.update(pose, [beside])
        twist = nav.step(tick_start(tick), pose, (), bumped=False)
        theta = pose.theta + twist.w / 60.0
        pose = Pose(pose.x + twist.v * math.cos(theta) / 60.0, pose.y + twist.v * math.sin(theta) / 60.0, theta)
        near = min(near, math.dist(pose[:2], (beside.x, beside.y)) - 0.14)
    return math.dist(pose[:2], ABREAST[:2]), near


@pytest.mark.parametrize("goal", [Point(0.9, 0.5), Point(0.2, 1.3), Point(0.9, 0.9)])
def test_a_robot_within_the_margin_of_one_that_stands_turns_off_it_and_drives(goal):
    away, near = drives_off(goal)
    assert away > 0.1
    assert near > 0.007
