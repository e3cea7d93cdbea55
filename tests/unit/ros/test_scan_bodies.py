"""Bodies in view by a laser scan: where they are, how they move, and what is none."""

import math
from random import Random

import pytest

from rmr.base.arena import Arena, Disc, Polygon, RobotShape
from rmr.base.geometry import Point, Pose
from rmr.base.time import NS_PER_S, milliseconds
from rmr.node.ports import SeenBody
from rmr_ros.scan_bodies import ScanBodies

SHAPE = RobotShape(radius=0.1, view_angle=math.radians(120), view_depth=0.6)
CORNER = Polygon((Point(2.0, 0.0), Point(3.0, 0.0), Point(3.0, 0.6), Point(2.0, 0.6)))
ARENA = Arena(3.0, 2.0, 0.05, (CORNER,), shape=SHAPE)
RAYS = 180
STEP = math.tau / RAYS


def ranges(at, *others, noise=None):
    """Return a scan from `at` on the floor of ARENA on which `others` stand, too."""
    floor = (*ARENA.obstacles, *others)
    found = []
    for k in range(RAYS):
        way = at.theta - math.pi + k * STEP
        metres = 0.0
        while metres < 3.5:
            free = ARENA.clearance_of(floor, at.x + metres * math.cos(way), at.y + metres * math.sin(way))
            if free < 1e-4:
                break
            metres += free
        found.append(metres + (noise.gauss(0.0, 0.01) if noise else 0.0) if metres < 3.5 else math.inf)
    return found


def seen(at, *others, believed=None, known=(), scans=1):
    bodies = ScanBodies(ARENA)
    believed = believed or at
    for k in range(scans):
        bodies.scan(k * milliseconds(100), believed, -math.pi, STEP, ranges(at, *others))
    return bodies.in_view((scans - 1) * milliseconds(100), believed, known)


@pytest.mark.parametrize("theta", [0.0, 0.5, -0.9])
@pytest.mark.parametrize("away", [0.25, 0.45, 0.65])
def test_a_body_stands_where_a_hull_lies_behind_its_points(theta, away):
    (body,) = seen(Pose(1.0, 1.0, theta), Disc(Point(1.0 + away, 1.0), 0.1))
    assert (body.x, body.y) == pytest.approx((away * math.cos(theta), -away * math.sin(theta)), abs=0.01)
    assert (body.vx, body.vy) == (0.0, 0.0)


@pytest.mark.parametrize(
    "other",
    [
        Disc(Point(0.6, 1.0), 0.1),  # behind
        Disc(Point(1.9, 1.0), 0.1),  # too far
        Polygon((Point(1.3, 0.6), Point(1.4, 0.6), Point(1.4, 1.4), Point(1.3, 1.4))),  # wide
    ],
    ids=["behind", "far", "wide"],
)
def test_what_is_no_robot_before_it_is_no_body(other):
    assert seen(Pose(1.0, 1.0, 0.0), other) == ()


@pytest.mark.parametrize("at", [Pose(0.15, 0.15, 0.8), Pose(1.8, 0.7, 0.0), Pose(1.85, 0.3, 0.0), Pose(2.85, 1.8, 0.5)])
def test_walls_and_obstacles_are_none_though_the_pose_is_off_by_three_centimetres_and_two_degrees(at):
    off = math.radians(2.0)
    for believed in (Pose(at.x + 0.03, at.y, at.theta + off), Pose(at.x, at.y - 0.03, at.theta - off)):
        assert seen(at, believed=believed) == ()


def test_a_body_that_a_robot_of_the_lab_is_known_to_be_is_not_seen_twice():
    at = Pose(1.0, 1.0, 0.0)
    two = Disc(Point(1.4, 1.0), 0.1), Disc(Point(1.3, 1.4), 0.1)
    assert len(seen(at, *two)) == 2
    (left,) = seen(at, *two, known=[SeenBody(0.42, 0.03, 0.1, 0.0)])
    assert left.y > 0.3


@pytest.mark.parametrize("way", [0.0, math.pi / 2, 2.5])
def test_a_body_that_moves_has_its_velocity_over_the_ground_after_a_second(way):
    noise = Random("scan")
    bodies = ScanBodies(ARENA)
    at = Pose(1.0, 1.0, 0.4)
    for k in range(16):
        metres = 0.15 * (k - 15) / 10
        place = Point(1.4 + metres * math.cos(way), 1.05 + metres * math.sin(way))
        bodies.scan(k * milliseconds(100), at, -math.pi, STEP, ranges(at, Disc(place, 0.1), noise=noise))
    (body,) = bodies.in_view(15 * milliseconds(100), at, ())
    cos, sin = math.cos(0.4), math.sin(0.4)
    vx, vy = cos * body.vx - sin * body.vy, sin * body.vx + cos * body.vy
    assert (vx, vy) == pytest.approx((0.15 * math.cos(way), 0.15 * math.sin(way)), abs=0.06)


def test_a_body_is_in_view_for_half_a_second_after_the_last_scan_that_shows_it():
    bodies = ScanBodies(ARENA)
    at = Pose(1.0, 1.0, 0.0)
    bodies.scan(0, at, -math.pi, STEP, ranges(at, Disc(Point(1.4, 1.0), 0.1)))
    for tenths in range(1, 10):
        clock = tenths * milliseconds(100)
        bodies.scan(clock, at, -math.pi, STEP, ranges(at))
        assert len(bodies.in_view(clock, at, ())) == (tenths <= 5)


def test_rays_that_are_no_numbers_meet_nothing():
    bodies = ScanBodies(ARENA)
    bodies.scan(NS_PER_S, Pose(1.0, 1.0, 0.0), -math.pi, STEP, [math.nan, math.inf, -1.0, 0.0] * 45)
    assert bodies.in_view(NS_PER_S, Pose(1.0, 1.0, 0.0), ()) == ()


def test_a_body_at_the_seam_of_the_scan_is_one():
    at = Pose(1.0, 1.0, math.pi)
    (body,) = seen(at, Disc(Point(1.0 - 0.4, 1.0), 0.1))
    assert (body.x, body.y) == pytest.approx((0.4, 0.0), abs=0.01)
    behind = ScanBodies(ARENA)
    behind.scan(0, at, -math.pi, STEP, ranges(at, Disc(Point(1.4, 1.0), 0.1)))
    (body,) = behind.in_view(0, Pose(1.0, 1.0, 0.0), ())
    assert (body.x, body.y) == pytest.approx((0.4, 0.0), abs=0.01)
