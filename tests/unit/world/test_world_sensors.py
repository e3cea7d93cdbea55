"""What robots sense: right on average, wrong by as much as cheap sensors are."""

import math
import statistics

import pytest
from test_world_physics import FORWARD, drive, world_of

from rmr.base.geometry import STILL, Point, Twist
from rmr.base.streams import stream
from rmr.base.time import NS_PER_S, seconds, tick_start
from rmr_world.sensors import TRACK_M, Sensors, pulse_phases

BEACONS = (Point(0, 0), Point(1.5, 0))


def sensors_of(sigma=0.0, dropout=0.0, beacons=BEACONS):
    return Sensors(stream("7/robot1/sensors"), beacons, 10.0, sigma, dropout)


# Ultrasonic localisation (paper V.B.1)


def test_each_beacon_is_heard_ten_times_a_second_and_never_two_at_once():
    sensors = sensors_of()
    heard = [sensors.ranges(tick_start(k), 0.3, 0.4) for k in range(60)]
    assert all(len(pulses) <= 1 for pulses in heard)
    beacons = [index for pulses in heard for index, _ in pulses]
    assert beacons == [0, 1] * 10


def test_order_and_phase_of_the_pulses_are_drawn_and_equal_for_equal_seeds():
    drawn = [pulse_phases(stream(f"{seed}/beacons"), 4, 10.0) for seed in range(50)]
    period = NS_PER_S // 10
    for phases in drawn:
        first = min(phases)
        assert sorted(phase - first for phase in phases) == [period * k // 4 for k in range(4)]
        assert 0 <= first < period // 4
    orders = {tuple(sorted(range(4), key=phases.__getitem__)) for phases in drawn}
    assert len(orders) > 10
    assert drawn[0] == pulse_phases(stream("0/beacons"), 4, 10.0)


def test_robots_of_one_world_hear_the_same_pulses_in_an_order_of_the_seed(tmp_path):
    extra = "localisation: {beacons: [[0, 0], [3, 0], [3, 1.5], [0, 1.5]]}\n"
    heard = {}
    for seed in range(8):
        world = world_of(tmp_path, (1.0, 0.5, 0), (2.0, 0.5, 0), extra=extra, seed=seed)
        samples = [[world.sense(robot, tick_start(k)).ranges for k in range(1, 30)] for robot in (1, 2)]
        pulses = [[beacon for ranges in each for beacon, _ in ranges] for each in samples]
        assert pulses[0] == pulses[1]
        heard[tuple(pulses[0])] = seed
    assert len(heard) > 4


def test_a_range_is_the_distance_to_its_beacon():
    sensors = sensors_of()
    assert sensors.ranges(0, 0.3, 0.4) == ((0, 0.5),)
    assert sensors.ranges(NS_PER_S // 20, 1.5, 0.4) == ((1, 0.4),)


def test_a_robot_that_was_not_asked_for_long_hears_each_beacon_s_last_pulse_only():
    sensors = sensors_of()
    sensors.ranges(0, 0, 0)
    assert [index for index, _ in sensors.ranges(10 * NS_PER_S, 1, 1)] == [1, 0], "in the order of the pulses"
    assert sensors.ranges(10 * NS_PER_S + 1, 1, 1) == ()


def test_range_noise_and_dropout_are_those_of_the_lab():
    sensors = sensors_of(sigma=0.01, dropout=0.25)
    heard = [r for k in range(60 * 100) for _, r in sensors.ranges(tick_start(k), 0.6, 0.8) if r > 0.9]
    assert len(heard) == pytest.approx(1000 * 0.75 * 2, rel=0.08)
    near_first = [r for r in heard if abs(r - 1.0) < 0.08]
    assert statistics.mean(near_first) == pytest.approx(1.0, abs=0.002)
    assert statistics.stdev(near_first) == pytest.approx(0.01, rel=0.1)


def test_a_lab_without_beacons_is_silent():
    assert sensors_of(beacons=()).ranges(10**10, 1, 1) == ()


# Odometry, gyro, compass (paper V.B.2)


def test_the_wheels_count_the_way_that_was_gone():
    sensors = sensors_of()
    for _ in range(1000):
        sensors.moved(0.001, 0.0)
    assert sensors.left_m == pytest.approx(1.0, abs=0.02)
    assert sensors.right_m == pytest.approx(1.0, abs=0.02)
    assert sensors.left_m != sensors.right_m


def test_a_turn_on_the_spot_turns_the_wheels_against_each_other():
    sensors = sensors_of()
    sensors.moved(0.0, math.pi)
    assert sensors.right_m == pytest.approx(math.pi * TRACK_M / 2, rel=0.05)
    assert sensors.left_m == pytest.approx(-math.pi * TRACK_M / 2, rel=0.05)


def test_odometry_and_gyro_follow_a_drive(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    tick = drive(world, {1: Twist(0.15, 0.5)}, 2)
    sample = world.sense(1, tick_start(tick))
    pose = world.pose(1)
    assert (sample.left_m + sample.right_m) / 2 == pytest.approx(world.distance_m(1), rel=0.03)
    assert (sample.right_m - sample.left_m) / TRACK_M == pytest.approx(pose.theta, abs=0.08)
    assert sample.gyro == pytest.approx(0.5, abs=0.08)
    assert sample.compass == pytest.approx(pose.theta, abs=math.radians(10))
    assert sample.truth == tuple(pose)


def test_the_compass_stays_within_half_a_turn(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, "180deg"))
    readings = [world.sense(1, 0).compass for _ in range(200)]
    assert all(-math.pi <= reading <= math.pi for reading in readings)
    assert min(readings) < -3 < 3 < max(readings)
    off = [math.remainder(reading - math.pi, math.tau) for reading in readings]
    assert statistics.stdev(off) == pytest.approx(math.radians(2), rel=0.2)


# Field of view (paper IV.E)


@pytest.mark.parametrize(
    ("x", "y", "seen"),
    [
        (1.3, 0.5, True),
        (1.33, 0.5, False),  # farther than the depth of view to its nearest point
        (0.7, 0.5, False),  # behind
        (1.15, 0.5 + 0.15, True),  # its hull reaches into the cone
        (1.02, 0.5 + 0.25, False),  # beside
    ],
)
def test_a_robot_sees_the_bodies_that_reach_into_its_view_cone(tmp_path, x, y, seen):
    world = world_of(tmp_path, (1.0, 0.5, 0), (x, y, 0))
    bodies = world.sense(1, 0).bodies
    assert len(bodies) == seen
    for body in bodies:
        assert (body.x, body.y) == (pytest.approx(x - 1.0, abs=0.01), pytest.approx(y - 0.5, abs=0.01))


def test_seen_bodies_move_over_the_ground_in_the_seer_s_frame(tmp_path):
    world = world_of(tmp_path, (1.0, 0.5, "90deg"), (1.05, 0.75, "90deg"))
    tick = drive(world, {1: STILL, 2: Twist(0.1, 0)}, 0.5)
    (body,) = world.sense(1, tick_start(tick)).bodies
    assert body.vx == pytest.approx(0.1, abs=0.03)
    assert body.vy == pytest.approx(0.0, abs=0.03)
    assert body.y == pytest.approx(-0.05, abs=0.02)


def test_the_nearest_body_comes_first(tmp_path):
    world = world_of(tmp_path, (1.0, 0.5, 0), (1.28, 0.58, 0), (1.2, 0.42, 0))
    bodies = world.sense(1, 0).bodies
    assert [round(body.x, 1) for body in bodies] == [0.2, 0.3]


def test_an_obstacle_hides_what_is_behind_it(tmp_path):
    wall = "obstacles: [{box: [1.09, 0.1, 1.11, 0.9]}]\n"
    world = world_of(tmp_path, (1.0, 0.5, 0), (1.2, 0.5, 0), extra=wall)
    assert world.sense(1, 0).bodies == ()


def test_nothing_touches_a_robot_that_stands_free(tmp_path):
    world = world_of(tmp_path, (1.0, 0.5, 0))
    drive(world, {1: FORWARD}, 1)
    assert not world.sense(1, seconds(1)).bumped
