"""Ways to stand that are kept apart, the memory of bodies, and the detector of deadlocks."""

import math

import pytest
from bench import limit_twist, safe_speed

from rmr.base.arena import BRAKE, RobotShape
from rmr.base.geometry import Pose, Twist
from rmr.base.motion_scale import LAG_S, scale_of, way_to_stand
from rmr.base.time import seconds
from rmr.node.motion.body_memory import MEMORY_S, BodyMemory
from rmr.node.motion.hearing import ReportedState
from rmr.node.motion.standoff.detector import EARLY_PATIENCE, DeadlockDetector
from rmr.node.motion.ways import GAP_M, WaysToStand
from rmr.node.ports import SeenBody

RADIUS = 0.07
SCALED = WaysToStand(scale_of(RobotShape()))
FULL = 0.2


def body(x: float, y: float = 0.0, vx: float = 0.0, vy: float = 0.0) -> SeenBody:
    return SeenBody(x, y, vx, vy)


def test_an_empty_view_leaves_the_command_alone():
    assert limit_twist(Twist(FULL, 0.3), ()) == Twist(FULL, 0.3)


def test_speed_falls_with_the_gap_to_a_standing_body_and_is_zero_at_the_end():
    speeds = [safe_speed(FULL, [body(0.14 + gap)]) for gap in (0.12, 0.06, 0.04, 0.02, 0.01)]
    assert speeds[0] == FULL
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == 0.0


def test_a_body_that_goes_ahead_at_the_same_speed_does_not_stop_the_robot():
    assert safe_speed(FULL, [body(0.205, vx=FULL)]) == FULL
    near = body(0.19, vx=FULL)
    assert 0.8 * FULL < safe_speed(FULL, [near]) < FULL, "it slows early for one that brakes harder than it would"
    assert safe_speed(FULL, [near], {near: True}) == FULL


def test_a_body_that_comes_from_behind_never_stops_the_robot():
    assert safe_speed(FULL, [body(-0.16, vx=0.4)]) == FULL


def test_a_body_that_is_passed_with_room_does_not_stop_the_robot():
    assert safe_speed(FULL, [body(0.15, 0.17)]) == FULL


def test_a_body_that_is_passed_too_close_slows_the_robot():
    assert safe_speed(FULL, [body(0.12, 0.12)]) < FULL


def test_a_standing_body_that_going_on_brings_no_nearer_is_passed():
    assert safe_speed(FULL, [body(0.01, 0.16)]) == FULL
    assert safe_speed(FULL, [body(0.08, 0.14)]) < 0.02


def test_one_that_stands_or_makes_room_is_not_driven_up_to():
    assert safe_speed(FULL, [body(0.16, 0.0)]) < 0.005, "there would be no room to turn"
    assert safe_speed(FULL, [body(0.16, 0.0, vx=0.08)]) < 0.1


def test_a_body_that_moves_out_of_the_way_may_stop_in_it():
    assert safe_speed(FULL, [body(0.104, -0.115, vx=0.03, vy=-0.1)]) < 0.15


def test_a_body_that_creeps_out_of_the_way_may_stop_in_it():
    assert safe_speed(FULL, [body(0.065, -0.142, vx=-0.011, vy=-0.028)]) < 0.03


def test_touching_bodies_stop_the_robot_whatever_else_it_sees():
    assert safe_speed(FULL, [body(0.4), body(0.142)]) == 0.0


def test_an_arc_keeps_its_curvature_when_it_is_slowed():
    slowed = limit_twist(Twist(FULL, 0.8), [body(0.18)])
    assert 0.0 < slowed.v < FULL
    assert math.isclose(slowed.w / slowed.v, 4.0)


def test_a_moving_body_abeam_on_the_inner_side_of_a_turn_slows_the_robot():
    abeam = body(-0.005, 0.168, 0.04, -0.045)
    assert limit_twist(Twist(FULL, 2.2), [abeam]).v < 0.06
    assert limit_twist(Twist(FULL, 0.0), [abeam]).v == FULL
    assert limit_twist(Twist(FULL, -2.2), [abeam]).v == FULL


def test_in_a_turn_too_the_later_in_the_order_slows_more():
    abeam = body(-0.005, 0.168, 0.04, -0.045)
    later, earlier = (limit_twist(Twist(FULL, 2.2), [abeam], {abeam: first}).v for first in (False, True))
    assert later < earlier


def test_turning_in_place_and_driving_back_are_not_limited():
    near = [body(0.145)]
    assert limit_twist(Twist(0.0, 2.0), near) == Twist(0.0, 2.0)
    assert limit_twist(Twist(-0.1, 0.0), near) == Twist(-0.1, 0.0)


def test_of_two_that_cross_the_one_with_the_other_on_its_right_slows_more():
    from_right = safe_speed(FULL, [body(0.15, -0.12, 0.0, 0.2)])
    from_left = safe_speed(FULL, [body(0.15, 0.12, 0.0, -0.2)])
    assert from_right < from_left


def test_of_two_that_cross_the_later_in_the_order_slows_more_whichever_side_it_comes_from():
    for other in (body(0.15, -0.15, 0.0, 0.2), body(0.15, 0.15, 0.0, -0.2)):
        goes_first = safe_speed(FULL, [other], {other: True})
        assert 0.0 < safe_speed(FULL, [other], {other: False}) < 0.5 * goes_first


def test_one_that_is_on_the_way_of_the_earlier_one_goes_on_out_of_it():
    comes = body(0.0, 0.22, 0.0, -0.2)
    assert safe_speed(FULL, [comes], {comes: False}) > 0.0


def test_one_heard_a_while_ago_may_have_braked_since():
    ways, ahead = SCALED, body(0.2, 0.0, 0.1, 0.0)
    fresh, old = (ways.clear(Twist(FULL, 0.0), ahead, GAP_M, age_s, first=True) for age_s in (0.0, 0.5))
    assert old < 0.8 * fresh
    assert ways.clear(Twist(FULL, 0.0), body(0.2), GAP_M, 0.5, first=True) == pytest.approx(
        ways.clear(Twist(FULL, 0.0), body(0.2), GAP_M, 0.0, first=True)
    )


def gap_after(shape: RobotShape, gap: float, y: float, other: float, turn: float) -> float:
    """Let two robots that drive along one line brake, both late, either, or none, as the law lets them.

    Returns the smallest gap of all of that. `other`: the speed of the second one, negative towards the first.
    """
    touch, dt = 2.0 * shape.radius, 0.001
    ahead = SeenBody(math.sqrt((touch + gap) ** 2 - y * y), y, other, 0.0)
    share = WaysToStand(scale_of(shape)).clear(Twist(shape.speed, turn), ahead, GAP_M, 0.0, first=True)
    least = gap
    for mine in (0.0, LAG_S):
        for theirs in (0.0, LAG_S):
            v, w, u, t, px, py, heading, x = share * shape.speed, share * turn, other, 0.0, 0.0, 0.0, 0.0, ahead.x
            while v > 0.0 or abs(u) > 0.0:
                px, py, heading = px + v * math.cos(heading) * dt, py + v * math.sin(heading) * dt, heading + w * dt
                x += u * dt
                if t >= mine:
                    slower = max(0.0, v - BRAKE * dt)
                    v, w = slower, w * slower / v if v else 0.0
                if t >= theirs:
                    u = math.copysign(max(0.0, abs(u) - BRAKE * dt), u)
                t += dt
                least = min(least, math.hypot(x - px, y - py) - touch)
    return least


@pytest.mark.parametrize("speed", [0.1, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("share", [-1.0, -0.5, 0.0, 0.5, 1.0])
@pytest.mark.parametrize("turn", [-1.0, 0.0, 1.0])
def test_hulls_never_meet_whichever_of_two_brakes_when(speed: float, share: float, turn: float) -> None:
    shape = RobotShape(0.07, speed)
    needs = way_to_stand(abs(share) * speed) if share < 0.0 else 0.0  # what one that comes needs itself
    for gap in (0.02, 0.05, 0.1, 0.3, 0.8):
        for y in (0.0, 0.07, 0.13):
            assert gap_after(shape, needs + gap, y, share * speed, turn) > 0.5 * GAP_M, (gap, y)


def test_who_goes_first_stops_all_the_same_for_one_that_does_not_give_way():
    other = body(0.11, -0.09, 0.0, 0.2)
    assert safe_speed(FULL, [other], {other: True}) == 0.0


def test_a_slow_approach_stops_as_well_as_a_fast_one():
    assert safe_speed(0.03, [body(0.142)]) == 0.0


def test_a_body_that_the_robot_turned_away_from_is_remembered_for_a_moment():
    memory = BodyMemory(RobotShape())
    memory.update(0, Pose(0.0, 0.0, 0.0), [body(0.2)])
    (seen,) = memory.update(seconds(0.2), Pose(0.0, 0.0, math.radians(80)), ())
    assert math.isclose(math.hypot(seen.x, seen.y), 0.2)
    assert seen.y < -0.15
    assert not memory.update(seconds(0.1 + MEMORY_S), Pose(0.0, 0.0, math.radians(80)), ())


def test_a_body_that_stood_and_did_not_speak_is_remembered_as_long_as_some_robot_is_not_heard():
    aside, late = Pose(0.0, 0.0, math.radians(80)), seconds(20)
    for keeps, moves, remembered in ((True, 0.0, 1), (False, 0.0, 0), (True, 0.1, 0)):
        memory = BodyMemory(RobotShape())
        memory.update(0, Pose(0.0, 0.0, 0.0), [body(0.2, 0.0, moves)])
        assert len(memory.update(late, aside, (), (), keeps)) == remembered
    memory = BodyMemory(RobotShape())
    memory.update(0, Pose(0.0, 0.0, 0.0), [body(0.2)])
    assert memory.update(late, aside, (), (), True)
    assert not memory.update(late, Pose(0.0, 0.0, 0.0), (), (), True), "it is seen to be gone"


def test_a_body_that_crept_is_remembered_where_it_would_be_and_where_it_was_for_it_may_have_stopped():
    memory = BodyMemory(RobotShape())
    memory.update(0, Pose(0.0, 0.0, 0.0), [body(0.2, 0.0, 0.08, 0.0)])
    aside = Pose(0.0, 0.0, math.radians(80))
    ways = sorted(math.hypot(seen.x, seen.y) for seen in memory.update(seconds(0.5), aside, ()))
    assert [round(way, 3) for way in ways] == [0.2, 0.24]


def test_a_remembered_body_that_should_be_in_view_and_is_not_is_forgotten():
    memory = BodyMemory(RobotShape())
    memory.update(0, Pose(0.0, 0.0, 0.0), [body(0.2)])
    assert not memory.update(seconds(0.1), Pose(0.0, 0.0, 0.0), ())


def test_a_remembered_body_is_forgotten_when_its_robot_says_where_it_is():
    aside, later = Pose(0.0, 0.0, math.radians(80)), seconds(0.2)
    for robot_says, remembered in (
        (ReportedState(2, 0.2, 0.03, 0.0, 0.0, later, False, False), 0),
        (ReportedState(2, 0.2, 0.03, 0.0, 0.0, 0, False, False), 1),  # no later than it was seen
        (ReportedState(3, 0.2, 0.18, 0.0, 0.0, later, False, False), 1),  # another one
    ):
        memory = BodyMemory(RobotShape())
        memory.update(0, Pose(0.0, 0.0, 0.0), [body(0.2, 0.0, 0.0, 0.2)])
        assert len(memory.update(later, aside, (), [robot_says])) == remembered


def test_a_moving_body_is_remembered_where_it_would_be_now():
    memory = BodyMemory(RobotShape())
    memory.update(0, Pose(0.0, 0.0, 0.0), [body(0.2, 0.0, 0.0, 0.4)])
    (seen,) = memory.update(seconds(0.5), Pose(0.0, 0.0, 0.0), ())
    assert math.isclose(seen.y, 0.2)


def test_a_deadlock_begins_when_patience_is_over_and_not_while_the_robot_moves():
    detector = DeadlockDetector(0, RobotShape())
    wish, stopped = Twist(FULL, 0.0), Twist(0.0, 0.0)
    assert not detector.blocked(0, wish, stopped)
    assert not detector.blocked(seconds(0.5), wish, wish)
    assert not detector.blocked(seconds(0.6), wish, stopped)
    assert not detector.blocked(seconds(1.2), wish, stopped)
    assert detector.blocked(seconds(1.4), wish, stopped)


def test_turning_to_the_way_out_of_a_deadlock_is_no_standing_before_another():
    detector = DeadlockDetector(0, RobotShape())
    wish, stopped, turning = Twist(FULL, 0.0), Twist(0.0, 0.0), Twist(0.0, 3.0)
    assert not detector.blocked(0, wish, stopped)
    assert detector.blocked(seconds(0.8), wish, stopped)
    assert not detector.blocked(seconds(1.7), turning, turning)
    assert not detector.blocked(seconds(1.8), wish, stopped)  # patience begins anew
    assert detector.blocked(seconds(2.6), wish, stopped)


def test_before_the_own_slot_patience_lasts_longer_for_standing_is_in_order():
    wish, stopped = Twist(FULL, 0.0), Twist(0.0, 0.0)
    for more, after_s in ((0, 0.8), (EARLY_PATIENCE, 3.8)):
        detector = DeadlockDetector(0, RobotShape())
        assert not detector.blocked(0, wish, stopped, more)
        assert not detector.blocked(seconds(after_s - 0.2), wish, stopped, more)
        assert detector.blocked(seconds(after_s), wish, stopped, more)


def test_robots_differ_in_patience():
    times = []
    for robot in range(4):
        detector = DeadlockDetector(robot, RobotShape())
        now = 0
        while not detector.blocked(now, Twist(FULL, 0.0), Twist(0.0, 0.0)):
            now += seconds(0.01)
        times.append(now)
    assert len({*times}) == 4


def test_a_detour_takes_the_other_to_be_further_left_so_that_both_pass_on_the_right():
    for theta in (0.0, math.pi / 2, math.pi):
        detector = DeadlockDetector(1, RobotShape())
        ahead = (0.2 * math.cos(theta), 0.2 * math.sin(theta))
        memory = BodyMemory(RobotShape())
        memory.update(0, Pose(0.0, 0.0, theta), [body(0.2)])
        detector.mark(0, Pose(0.0, 0.0, theta), memory.places(0), RADIUS)
        body_itself, ghost = detector.ghosts
        assert math.dist(body_itself, ahead) < 1e-9
        left = -math.sin(theta) * (ghost.x - ahead[0]) + math.cos(theta) * (ghost.y - ahead[1])
        assert left > 0.02


def test_the_older_a_hello_the_farther_off_its_line_its_robot_may_be_up_to_where_it_says_so_again():
    beside = body(0.02, 0.17, FULL)
    free = [SCALED.clear(Twist(FULL, 0.8), beside, 0.016, age, first=True) for age in (0.0, 0.1, 0.2, 0.5)]
    assert free[0] == 1.0 > free[1] > free[2] > 0.6
    assert free[3] == pytest.approx(free[2], abs=0.01)
    off = body(0.02, 0.19, FULL)
    assert SCALED.clear(Twist(FULL, 0.8), off, 0.016, 0.5, first=True) == 1.0
