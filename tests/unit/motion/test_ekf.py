"""The EKF: pose from wheels, gyro, compass and beacon ranges."""

import math
import timeit
from random import Random

from rmr.base.arena import Arena
from rmr.base.geometry import Point, wrap
from rmr.node.motion.ekf import Ekf

ARENA = Arena(1.5, 1.5, 0.05)
BEACONS = (Point(0.0, 0.0), Point(1.5, 0.0))
DT = 1.0 / 60.0
HALF_TRACK = 0.05


def drive(ekf: Ekf, seconds: float, v: float, w: float, rng: Random, *, ranges: bool = True, wheel_gain: float = 1.0):
    """Drive a true pose from the filter's own start; return the true pose."""
    x, y, theta = ekf.pose
    for tick in range(round(seconds / DT)):
        x += v * DT * math.cos(theta + 0.5 * w * DT)
        y += v * DT * math.sin(theta + 0.5 * w * DT)
        theta += w * DT
        left, right = (v - w * HALF_TRACK) * DT * wheel_gain, (v + w * HALF_TRACK) * DT * wheel_gain
        ekf.predict(left + rng.gauss(0, 1e-4), right + rng.gauss(0, 1e-4), w + rng.gauss(0, 0.01), DT)
        ekf.compass(wrap(theta + rng.gauss(0, 0.035)))
        if ranges and tick % 3 == 0:
            beacon = BEACONS[tick // 3 % 2]
            ekf.range(beacon, math.dist((x, y), beacon) + rng.gauss(0, 0.005))
    return x, y, theta


def test_without_noise_the_wheels_alone_keep_the_pose():
    ekf = Ekf(0.5, 0.5, 0.0)
    for _ in range(60):
        ekf.predict(0.2 / 60, 0.2 / 60, 0.0, DT)
    assert math.isclose(ekf.x, 0.7, abs_tol=1e-9)
    assert ekf.y == 0.5
    assert ekf.pose.theta == 0.0


def test_ranges_keep_the_error_below_two_centimetres_where_wheels_drift():
    for seed in range(5):
        ekf = Ekf(0.4, 0.7, 0.3)
        x, y, theta = drive(ekf, 20.0, 0.1, 0.3, Random(f"{seed}/ekf"), wheel_gain=1.03)
        assert math.dist((x, y), ekf.pose[:2]) < 0.02
        assert abs(wrap(theta - ekf.theta)) < 0.06


def test_uncertainty_grows_without_ranges_and_shrinks_with_them():
    rng = Random("1/ekf")
    ekf = Ekf(0.4, 0.7, 0.0, sigma=0.01)
    drive(ekf, 5.0, 0.1, 0.3, rng, ranges=False)
    blind = ekf.position_sigma
    assert blind > 0.01
    drive(ekf, 1.0, 0.0, 0.0, rng)
    assert ekf.position_sigma < 0.6 * blind


def test_a_single_wild_range_is_dropped():
    ekf = Ekf(0.5, 0.5, 0.0, sigma=0.01)
    before = ekf.pose
    assert not ekf.range(BEACONS[0], 1.4)
    assert ekf.pose == before
    assert ekf.rejected == 1


def test_ranges_contradict_the_estimate_of_a_robot_that_was_pushed():
    rng = Random("2/ekf")
    ekf = Ekf(0.5, 0.5, 0.0, sigma=0.005)
    true = (0.62, 0.44)
    heard = 0
    while not ekf.contradicted:
        ekf.predict(0.0, 0.0, 0.0, DT)
        beacon = BEACONS[heard % 2]
        ekf.range(beacon, math.dist(true, beacon) + rng.gauss(0, 0.005))
        heard += 1
        assert heard < 10


def test_noise_as_stated_contradicts_no_estimate():
    rng = Random("3/ekf")
    ekf = Ekf(0.5, 0.5, 0.0, sigma=0.01)
    for heard in range(20_000):
        ekf.predict(0.0, 0.0, 0.0, 0.05)
        beacon = BEACONS[heard % 2]
        ekf.range(beacon, math.dist((0.5, 0.5), beacon) + rng.gauss(0, 0.007))
        assert not ekf.contradicted


def test_three_wild_ranges_in_a_row_contradict_no_estimate():
    ekf = Ekf(0.5, 0.5, 0.0, sigma=0.01)
    for _ in range(3):
        ekf.range(BEACONS[0], 1.4)
    assert not ekf.contradicted
    ekf.range(BEACONS[0], 1.4)
    assert ekf.contradicted


def test_a_heading_across_the_half_turn_stays_one_heading():
    ekf = Ekf(0.5, 0.5, math.pi - 0.01)
    assert ekf.compass(-math.pi + 0.01)
    assert abs(wrap(ekf.pose.theta - math.pi)) < 0.02


def test_no_estimate_is_nearer_to_a_wall_than_a_hull_can_be():
    for x, y, kept in (
        (0.7, 0.0, (0.7, 0.07)),
        (0.7, -0.2, (0.7, 0.07)),
        (1.49, 1.6, (1.43, 1.43)),
        (0.7, 0.2, (0.7, 0.2)),
    ):
        ekf = Ekf(x, y, 0.5)
        ekf.keep_within(ARENA)
        assert (ekf.x, ekf.y) == kept


def test_a_prediction_costs_microseconds():
    ekf = Ekf(0.5, 0.5, 0.0)
    best = min(timeit.repeat(lambda: ekf.predict(0.003, 0.003, 0.01, DT), number=2000, repeat=5)) / 2000
    assert best < 10e-6  # 0.6 us measured; the bound leaves room for a busy machine
