"""Claims of section IV.E of the paper: collision detection and avoidance."""

import functools
import math
import statistics
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "motion"))
import bench

from rmr.base.arena import Arena, RobotShape
from rmr.base.geometry import Point, Pose
from rmr.node.motion.navigator import Navigator
from rmr.node.ports import SeenBody

ROOM = Arena(1.5, 1.5, 0.05)
streamed = functools.cache(bench.stream_testbed)


def test_iv_e_the_field_of_view_has_an_orientation_an_angle_and_a_depth():
    shape = RobotShape()
    seen = []
    for bearing in range(-180, 180, 5):
        for away in (0.25, 0.45):
            x, y = 0.75 + away * math.cos(math.radians(bearing)), 0.75 + away * math.sin(math.radians(bearing))
            world = bench.Bench(ROOM, [Pose(0.75, 0.75, 0.0), Pose(x, y, 0.0)], 0, 0.0)
            if world.bodies[0].sees(world.bodies):
                seen.append((bearing, away))
    assert {away for _, away in seen} == {0.25}
    widest = max(abs(bearing) for bearing, _ in seen)
    assert math.degrees(shape.view_angle) / 2 <= widest <= math.degrees(shape.view_angle) / 2 + 20


def test_iv_e_a_robot_stops_if_dangerous():
    nav = Navigator(ROOM, 1)
    nav.go(0, Pose(0.3, 0.75, 0.0), Point(1.2, 0.75))
    free = nav.step(0, Pose(0.3, 0.75, 0.0), (), False)
    stopped = nav.step(0, Pose(0.3, 0.75, 0.0), (SeenBody(0.145, 0.0, 0.0, 0.0),), False)
    assert free.v == pytest.approx(ROOM.shape.speed)
    assert stopped.v == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_iv_e_after_it_has_stopped_a_robot_turns_to_another_direction_and_goes_on(seed):
    world = bench.Bench(ROOM, [Pose(0.3, 0.75, 0.0), Pose(0.7, 0.75, 0.0)], seed)
    moving = world.bodies[0].nav
    moving.go(0, world.bodies[0].estimate, Point(1.2, 0.75))
    assert world.run(lambda: moving.status == "arrived", 20)
    assert not world.contacts


@pytest.mark.parametrize("seed", range(5))
def test_iv_e_two_robots_face_to_face_do_not_touch_and_both_get_through(seed):
    world = bench.Bench(ROOM, [Pose(0.3, 0.75, 0.0), Pose(1.2, 0.75, math.pi)], seed)
    a, b = (body.nav for body in world.bodies)
    a.go(0, world.bodies[0].estimate, Point(1.2, 0.75))
    b.go(0, world.bodies[1].estimate, Point(0.3, 0.75))
    assert world.run(lambda: a.status == b.status == "arrived", 30)
    assert not world.contacts


@pytest.mark.medium
@pytest.mark.parametrize("seed", range(12))
def test_iv_e_six_robots_stream_through_the_test_bed_without_contact(seed):
    stream = streamed(seed)
    assert len(stream.arrived) == 6
    assert not stream.bench.contacts
    assert stream.bench.time < 15.0


@pytest.mark.medium
def test_iv_e_six_robots_whose_order_is_drawn_stream_through_the_test_bed_in_fourteen_seconds_as_a_rule():
    assert statistics.median(streamed(seed).bench.time for seed in range(12)) < 14.0


@pytest.mark.parametrize("seed", range(4))
def test_iv_e_six_robots_line_up_before_the_corridor_and_pass_without_contact(seed):
    stream = bench.pass_corridor(seed)
    assert len(stream.arrived) == 6
    assert not stream.bench.contacts
    assert stream.bench.time < 32.0
