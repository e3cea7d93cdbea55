"""Robots faster than the reference robot: the arc on which they brake, how early they slow down, when they wait.

What a fast robot is commanded to do and what its wheels do are not the same: they brake with 0.8 m/s^2.
"""

import math

import pytest

from rmr.base.arena import BRAKE, REFERENCE, TURN_ACCELERATION, Arena, RobotShape
from rmr.base.geometry import STILL, Point, Pose, Twist
from rmr.base.motion_scale import HEADING_ERROR, LAG_S, PLANNED_BRAKE, scale_of
from rmr.base.time import seconds
from rmr.node.motion.braking import LeadIn, Wheels
from rmr.node.motion.follow import LOOK_AHEAD_M, Follower
from rmr.node.motion.queueing import queue_reach
from rmr.node.motion.route import make_route
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.shield import Shield, on_the_way
from rmr.node.motion.speed_control import SpeedControl
from rmr.node.motion.standoff.detector import DeadlockDetector
from rmr.node.motion.ways import GAP_M, WaysToStand
from rmr.node.ports import SeenBody

FAST = RobotShape(speed=1.0)


def wheels_at(v: float, bend: float, shape: RobotShape = FAST) -> Wheels:
    """Return wheels that have been commanded long enough to drive at `v`, on an arc of the curvature `bend`."""
    wheels = Wheels(shape)
    for at_s in (0, 2, 4):
        wheels.command(seconds(at_s), Twist(v, bend * v))
    return wheels


def test_a_fast_robot_that_slows_down_turns_as_its_arc_takes_at_the_speed_that_it_has():
    wheels = wheels_at(1.0, 0.5)
    assert wheels.command(seconds(4), Twist(0.4, 0.2)) == Twist(0.4, 0.5)
    half = wheels.command(seconds(4.5), Twist(0.4, 0.2))
    assert half == Twist(0.4, pytest.approx(0.5 * (1.0 - 0.8 * 0.5)))
    assert wheels.command(seconds(6), Twist(0.4, 0.2)) == Twist(0.4, 0.2), "it drives no faster than that now"


def test_of_several_commands_slowed_in_a_tick_the_one_taken_keeps_the_way_that_was_judged():
    wheels, alone = wheels_at(0.9, 2.0), wheels_at(0.9, 2.0)
    taken, judged = Twist(0.98, -1.2), LeadIn(2.0, 1.0)
    alone.slow(taken, judged)
    wheels.slow(taken, judged)
    wheels.slow(Twist(0.97, 0.0), LeadIn(2.0, 0.5))
    for tick in range(30):
        now = seconds(4 + tick / 60)
        assert wheels.command(now, taken if not tick else STILL) == alone.command(now, taken if not tick else STILL)
    assert wheels.lead(seconds(4.1), Twist(1.0, 0.0)) == alone.lead(seconds(4.1), Twist(1.0, 0.0))


@pytest.mark.parametrize("halt", [STILL, Twist(0.0, 2.0), Twist(-0.08, 0.0)])
def test_a_fast_robot_that_is_to_stand_or_to_turn_on_the_spot_brakes_on_its_arc(halt):
    wheels = wheels_at(1.0, 0.5)
    assert wheels.command(seconds(4), halt) == Twist(0.0, 0.5)
    assert wheels.command(seconds(5.2), halt) == halt


def test_no_arc_is_taken_faster_than_the_robot_turns():
    wheels = wheels_at(1.0, 0.0)
    rates = [wheels.command(seconds(4 + tick / 60), Twist(0.1, 0.9)).w for tick in range(60)]
    assert 1.0 < max(rates) <= math.pi


def test_the_commands_of_the_reference_robot_are_left_as_they_are():
    wheels = wheels_at(0.2, 0.5, RobotShape())
    for command in (Twist(0.1, 0.3), STILL, Twist(0.0, -2.0), Twist(-0.08, 0.0), Twist(0.2, 0.1)):
        assert wheels.command(seconds(4), command) is command


def driven(wheels, twist, *, until_s):
    """Drive from 4 s on with commands of `twist`, by wheels with the bounds of the world; return the way as places."""
    v, rate, x, y, theta = 1.0, -2.0, 0.0, 0.0, 0.0
    way = []
    for tick in range(round(until_s * 60)):
        command = wheels.command(seconds(4 + tick / 60), twist)
        rate += min(0.2, max(-0.2, command.w - rate))
        theta += rate / 60
        v = min(v + BRAKE / 60, max(v - BRAKE / 60, command.v))
        x, y = x + v * math.cos(theta) / 60, y + v * math.sin(theta) / 60
        way.append((x, y))
        if (tick + 1) / 60 >= 0.1 and twist.v > 0.0:
            twist = STILL  # from now on it brakes
    return way


@pytest.mark.parametrize("w", [2.0, 0.0, -3.0])
def test_a_fast_robot_that_changes_to_another_arc_drives_and_brakes_on_the_way_that_is_judged(w):
    wheels = wheels_at(1.0, -2.0)
    twist = Twist(1.0, w)
    lead = wheels.lead(seconds(4), twist)
    assert lead == (-2.0, pytest.approx(abs(w + 2.0) / TURN_ACCELERATION))
    length, last = 0.0, (0.0, 0.0)
    for place in driven(wheels, twist, until_s=1.4):
        length += math.dist(place, last)
        last = place
        assert math.dist(place, on_the_way(lead, w, length)) < 0.005 + HEADING_ERROR * length, length
    assert length > 0.6


@pytest.mark.parametrize("first", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("last", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("way", [0.1, 0.3])
def test_the_way_to_another_arc_is_judged_to_a_hundredth_of_it(first, last, way):
    x = y = 0.0
    fine = 2000
    for k in range(fine):
        at = (k + 0.5) * way / fine
        heading = at * (first + 0.5 * (last - first) / way * at)
        x += math.cos(heading) * way / fine
        y += math.sin(heading) * way / fine
    assert math.dist((x, y), on_the_way(LeadIn(first, way), last, way)) < 0.01 * way


@pytest.mark.parametrize("v", [1.0, 0.9])
def test_a_fast_robot_that_is_to_leave_its_arc_for_one_that_leads_to_a_wall_brakes_on_the_arc_on_which_it_is(v):
    arena = Arena(10.0, 4.0, 0.05, shape=FAST)
    control = SpeedControl(arena, 1, RuleSwitches())
    control.wheels = wheels_at(0.9, -2.0)
    control.perceive(seconds(4), Pose(5.0, 3.6, math.pi / 4), ())
    turning = Twist(0.9, -1.8)
    assert control.slowed(turning) == turning
    assert control.slowed(Twist(v, 0.0)) == STILL, "0.6 m/s, from which it stands before the wall, come too late"
    assert control.wheels.command(seconds(4), STILL).w == pytest.approx(-1.8)


def test_a_command_that_the_shield_slows_leads_on_the_way_that_was_judged():
    shape = RobotShape(speed=2.0)
    arena = Arena(10.0, 4.0, 0.05, shape=shape)
    slowed = 0
    for step in range(200):
        control = SpeedControl(arena, 1, RuleSwitches())
        control.wheels = wheels_at(1.0, -2.0, shape)
        y = 2.9 + 0.005 * step
        control.perceive(seconds(4), Pose(5.0, y, math.pi / 2), ())
        twist = control.slowed(Twist(1.7, 0.0))
        slowed += 1.0 < twist.v < 1.7
        if twist.v > 1.0:
            assert y + max(x for x, _ in driven(control.wheels, twist, until_s=3.0)) + shape.radius < 4.0, y
    assert slowed


@pytest.mark.parametrize("speed", [0.4, 1.0, 2.0])
@pytest.mark.parametrize(("late", "brake"), [(False, PLANNED_BRAKE), (True, BRAKE)])
def test_a_standing_body_asks_of_a_fast_robot_no_more_than_its_wheels_can(speed, late, brake):
    ways = WaysToStand(scale_of(RobotShape(speed=speed)))

    def allowed(gap):
        ahead = SeenBody(0.14 + gap, 0.0, 0.0, 0.0)
        return speed * ways.clear(Twist(speed, 0.0), ahead, GAP_M, 0.0, first=late)

    gap, step = 6.0, 0.01
    while allowed(gap - step) > 0.3:
        # Over a step of the way v changes by a / v times the step; the search along the way takes steps of 2 mm.
        assert (allowed(gap) - allowed(gap - step)) / step * allowed(gap - step) <= 1.3 * brake
        gap -= step
    assert allowed(GAP_M) == 0.0


def test_a_fast_robot_looks_farther_ahead_when_it_drives_fast():
    arena = Arena(10.0, 10.0, 0.05, shape=RobotShape(speed=2.0))
    follower = Follower(make_route(arena, [Point(1.0, 1.0), Point(5.0, 1.0)], through_gate=False), arena.shape)
    beside = Pose(1.0, 1.1, 0.0)
    follower.locate(beside)
    assert follower.heading_error(beside) == pytest.approx(math.atan2(-0.1, LOOK_AHEAD_M))
    follower.pivoting = False
    follower.steer(Pose(1.0, 1.0, 0.0), 2.0)
    assert follower.heading_error(beside) == pytest.approx(math.atan2(-0.1, 0.5), rel=1e-3)


def test_a_fast_robot_that_follows_at_half_a_metre_a_second_is_not_in_a_deadlock():
    detector = DeadlockDetector(0, RobotShape(speed=2.0))
    assert not any(detector.blocked(seconds(t), Twist(2.0, 0.0), Twist(0.4, 0.0)) for t in range(60))
    assert any(detector.blocked(seconds(t), Twist(2.0, 0.0), Twist(0.04, 0.0)) for t in range(60, 70))


def test_large_slow_robots_wait_as_long_as_one_of_them_takes_to_pass():
    slow = DeadlockDetector(0, RobotShape(radius=0.5, speed=0.1))
    standing = [t for t in range(30) if slow.blocked(seconds(t), Twist(0.1, 0.0), STILL)]
    assert standing[0] == 10, "14 times the patience of the reference robot"


def test_the_next_in_a_queue_of_large_robots_is_in_reach():
    assert queue_reach(RobotShape()) == 0.3
    assert queue_reach(RobotShape(radius=0.3)) > 2.0 * 2.0 * 0.3


AHEAD = Twist(1.0, 0.0)
HALFWAY = Shield(0.1, 1.0)


def share_before(x: float, y: float, vx: float, vy: float, twist: Twist = AHEAD) -> float:
    return HALFWAY.apart(twist, [SeenBody(x, y, vx, vy)], 0.0)


def test_two_fast_robots_that_meet_each_keep_to_their_half_of_the_way():
    assert share_before(3.0, 0.0, -1.0, 0.0) == 1.0
    v = share_before(1.0, 0.0, -1.0, 0.0)
    way = v * LAG_S + v * v / (2.0 * BRAKE)
    assert 0.3 < way < 0.4, "half of 1 m, less a radius and what both drive within the age of a sample"


@pytest.mark.parametrize(
    ("body", "share"),
    [
        ((-0.5, 0.0, 1.0, 0.0), 1.0),  # behind
        ((0.0, 0.5, 1.0, 0.0), 1.0),  # abeam, on a parallel way
        ((0.3, 0.0, 0.0, 0.0), 1.0),  # one that stands is another part's
        ((0.21, 0.0, -1.0, 0.0), REFERENCE.speed),  # near: the other rules decide
    ],
)
def test_what_comes_no_nearer_does_not_slow_a_fast_robot_and_nothing_below_the_speed_of_the_reference_robot(
    body, share
):
    assert share_before(*body) == share


def test_a_fast_robot_turns_no_arc_across_the_half_of_another_one():
    beside = 0.0, 0.8, -1.0, 0.0
    assert share_before(*beside) == 1.0
    assert share_before(*beside, Twist(1.0, 2.0)) < 0.9


def test_the_slow_are_left_to_the_speed_law():
    assert Shield(0.07, 0.4).apart(Twist(0.4, 0.0), [SeenBody(0.16, 0.0, -0.4, 0.0)], 0.0) == 1.0
