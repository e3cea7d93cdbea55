"""Multilateration: which positions on the floor explain ranges."""

import math
from random import Random

import pytest

from rmr.base.arena import Arena, Disc
from rmr.base.geometry import Point
from rmr.node.motion.multilateration import Echo, hypotheses

SIGMA_M = 0.007
WALL = (Point(0.0, 0.0), Point(2.0, 0.0))
DIAGONAL = (Point(0.0, 0.0), Point(2.0, 2.0))
CORNERS = (*DIAGONAL, Point(2.0, 0.0), Point(0.0, 2.0))


def arena_of(beacons, *obstacles):
    return Arena(2.0, 2.0, 0.05, obstacles, beacons=beacons)


def heard(true, beacons, times=1, noise_m=0.0):
    rng = Random("multilateration")
    return [
        Echo(k, beacon.x, beacon.y, math.dist(true, beacon) + rng.gauss(0.0, noise_m))
        for _ in range(times)
        for k, beacon in enumerate(beacons)
    ]


def test_beacons_on_a_wall_leave_one_position():
    (found,) = hypotheses(heard((0.3, 1.1), WALL), arena_of(WALL), SIGMA_M)
    assert math.dist(found[:2], (0.3, 1.1)) < 1e-4
    assert found.misfit < 1e-6


def test_two_beacons_across_the_floor_leave_two_positions_that_fit_alike():
    found = hypotheses(heard((1.6, 0.7), DIAGONAL), arena_of(DIAGONAL), SIGMA_M)
    assert sorted((round(each.x, 3), round(each.y, 3)) for each in found) == [(0.7, 1.6), (1.6, 0.7)]
    assert all(each.misfit < 1e-6 for each in found)


def test_a_third_beacon_tells_the_position_from_its_image():
    best, *others = hypotheses(heard((1.6, 0.7), CORNERS[:3]), arena_of(CORNERS), SIGMA_M)
    assert math.dist(best[:2], (1.6, 0.7)) < 1e-3
    assert all(each.misfit > 1000.0 for each in others)


def test_an_image_inside_an_obstacle_is_no_position():
    arena = arena_of(DIAGONAL, Disc(Point(0.7, 1.6), 0.2))
    (found,) = hypotheses(heard((1.6, 0.7), DIAGONAL), arena, SIGMA_M)
    assert math.dist(found[:2], (1.6, 0.7)) < 1e-3


def test_positions_that_are_nearly_the_same_are_one_that_is_doubted_by_as_much():
    (found,) = hypotheses(heard((1.02, 0.98), DIAGONAL), arena_of(DIAGONAL), SIGMA_M)
    assert found.sigma_m > math.dist((1.02, 0.98), (0.98, 1.02))


def test_the_uncertainty_is_that_of_the_error():
    errors = []
    for trial in range(300):
        rng = Random(f"{trial}/multilateration")
        echoes = [echo._replace(metres=echo.metres + rng.gauss(0, SIGMA_M)) for echo in heard((0.8, 0.5), WALL)]
        (found,) = hypotheses(echoes, arena_of(WALL), SIGMA_M)
        off_x = found.x - 0.8
        off_y = found.y - 0.5
        determinant = found.pxx * found.pyy - found.pxy * found.pxy
        errors.append(
            (off_x * off_x * found.pyy - 2.0 * off_x * off_y * found.pxy + off_y * off_y * found.pxx) / determinant
        )
    assert sum(errors) / len(errors) == pytest.approx(2.0, rel=0.15)  # chi-squared of two degrees of freedom


def test_ranges_too_short_to_meet_give_a_position_on_the_floor():
    arena = arena_of(WALL)
    echoes = [Echo(0, 0.0, 0.0, 0.9), Echo(1, 2.0, 0.0, 1.0)]
    found = hypotheses(echoes, arena, SIGMA_M)
    assert found[0].y == arena.shape.radius


def test_one_beacon_or_two_in_one_place_leave_nothing_to_say():
    assert hypotheses(heard((0.5, 0.5), WALL[:1], times=3), arena_of(WALL), SIGMA_M) == []
    assert hypotheses(heard((0.5, 0.5), (WALL[0], WALL[0])), arena_of(WALL), SIGMA_M) == []
