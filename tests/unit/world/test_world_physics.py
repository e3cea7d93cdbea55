"""The physics: wheels, contacts, gaps, and the same bits for the same commands."""

import math

import pytest
from world_labs import LABS, ROOM, lab_of

from rmr.base.arena import BRAKE
from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.time import NS_PER_MS, NS_PER_S, seconds, tick_start
from rmr_world.lab_file import load_lab
from rmr_world.physics import World

FORWARD = Twist(0.2, 0.0)


def world_of(folder, *poses, extra="", seed=7):
    """Return a world with robots 1, 2, ... at `poses` in a room of 3 m x 1.5 m."""
    robots = "".join(f"  - {{id: {k}, pose: [{x}, {y}, {a}]}}\n" for k, (x, y, a) in enumerate(poses, start=1))
    return World(lab_of(folder, ROOM.split("  - ", 1)[0] + robots + extra), seed)


def drive(world, twists, duration_s, first_tick=0):
    """Command `twists` by robot at every tick for a while; return the tick after the last."""
    last = first_tick + round(duration_s * 60)
    for tick in range(first_tick, last):
        for robot, twist in twists.items():
            world.act(robot, twist, tick_start(tick), tick_start(tick))
        world.step(tick_start(tick + 1))
    return last


# Wheels


def test_a_robot_drives_where_it_faces_at_the_speed_commanded(tmp_path):
    world = world_of(tmp_path, (1.0, 0.5, "90deg"))
    drive(world, {1: Twist(0.1, 0.0)}, 4)
    x, y, theta = world.pose(1)
    assert (x, y) == (pytest.approx(1.0, abs=0.02), pytest.approx(0.9, abs=0.02))
    assert theta == pytest.approx(math.pi / 2, abs=0.05)
    assert world.distance_m(1) == pytest.approx(0.4, abs=0.02)


def test_a_turning_robot_drives_a_circle(tmp_path):
    world = world_of(tmp_path, (1.0, 0.5, 0))
    drive(world, {1: Twist(0.2, math.tau / 5)}, 5)
    x, y, _ = world.pose(1)
    assert math.hypot(x - 1.0, y - 0.5) < 0.05


def test_the_wheels_accelerate_no_faster_than_they_can(tmp_path):
    world = world_of(tmp_path, (1.0, 0.5, 0))
    drive(world, {1: FORWARD}, 0.125)
    assert world.distance_m(1) <= 0.5 * BRAKE * 0.15**2


def test_commands_are_cut_to_what_the_wheels_can_do(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    drive(world, {1: Twist(5.0, 0.0)}, 2)
    assert world.distance_m(1) < 0.2 * 2 * 1.01


def test_the_body_does_not_slide_sideways(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    tick = drive(world, {1: FORWARD}, 1)
    drive(world, {1: Twist(0.0, math.pi)}, 2, tick)
    x, y, _ = world.pose(1)
    assert x < 0.72
    assert abs(y - 0.5) < 0.03


def test_wheels_brake_a_tenth_of_a_second_after_the_last_command(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    for tick in range(60):
        now = tick_start(tick)
        world.step(now)
        world.act(1, FORWARD, now, now)
    so_far = world.distance_m(1)
    assert so_far > 0.1
    world.step(seconds(1.5))
    stopped = world.distance_m(1)
    world.step(seconds(5.0))
    assert world.distance_m(1) == stopped
    assert 0.02 < stopped - so_far < 0.05


def test_a_command_that_comes_late_is_followed_no_longer_than_one_in_time(tmp_path):
    ways = []
    for late in (0, 60 * NS_PER_MS):
        world = world_of(tmp_path, (0.5, 0.5, 0))
        drive(world, {1: FORWARD}, 1)
        so_far = world.distance_m(1)
        world.act(1, FORWARD, NS_PER_S, NS_PER_S + late)
        world.step(seconds(2.0))
        ways.append(world.distance_m(1) - so_far)
    assert ways[0] == ways[1] > 0.02


def test_commands_older_than_100_ms_are_dropped_and_counted(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    now = NS_PER_S
    world.act(1, FORWARD, now - 101 * NS_PER_MS, now)
    world.step(now + NS_PER_S)
    assert world.distance_m(1) == 0
    assert world.dropped == 1


def test_a_command_that_overtakes_a_later_one_is_dropped(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    world.act(1, STILL, 50 * NS_PER_MS, 60 * NS_PER_MS)
    world.act(1, FORWARD, 40 * NS_PER_MS, 61 * NS_PER_MS)
    world.step(seconds(0.4))
    assert world.distance_m(1) == 0


@pytest.mark.parametrize("twist", [Twist(math.nan, 0.0), Twist(0.0, math.inf)])
def test_wheel_commands_with_nan_or_infinity_are_dropped(tmp_path, twist):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    world.act(1, twist, 0, 0)
    world.step(seconds(0.4))
    assert (world.dropped, world.pose(1)) == (1, Pose(0.5, 0.5, 0.0))


def test_a_stamp_from_the_future_does_not_shut_out_later_commands(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    world.act(1, STILL, 10**15, 0)
    world.act(1, FORWARD, 0, 0)
    world.step(seconds(0.4))
    assert world.distance_m(1) > 0


def test_a_robot_that_is_not_there_is_the_caller_s_mistake(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0))
    with pytest.raises(KeyError):
        world.act(9, STILL, 0, 0)


# Contacts


def test_pressing_against_a_wall_is_one_contact_and_is_felt(tmp_path):
    world = world_of(tmp_path, (2.8, 0.5, 0))
    drive(world, {1: FORWARD}, 3)
    assert world.collisions == 1
    assert world.contacts[0].other is None
    assert world.contacts[0].x == pytest.approx(3.0, abs=0.01)
    assert world.sense(1, seconds(3)).bumped
    assert world.pose(1).x == pytest.approx(2.93, abs=0.005)


def test_backing_off_ends_the_contact_and_coming_again_is_another(tmp_path):
    world = world_of(tmp_path, (2.8, 0.5, 0))
    tick = drive(world, {1: FORWARD}, 2)
    tick = drive(world, {1: Twist(-0.2, 0)}, 1, tick)
    assert not world.sense(1, tick_start(tick)).bumped
    drive(world, {1: FORWARD}, 2, tick)
    assert world.collisions == 2


def test_two_robots_that_meet_touch_once_and_do_not_pass_through_each_other(tmp_path):
    world = world_of(tmp_path, (1.0, 0.5, 0), (1.5, 0.5, "180deg"))
    drive(world, {1: FORWARD, 2: FORWARD}, 3)
    assert world.collisions == 1
    assert (world.contacts[0].robot, world.contacts[0].other) == (1, 2)
    assert world.min_gap_m == 0.0
    assert world.pose(2).x - world.pose(1).x > 0.135


@pytest.mark.parametrize("obstacle", ["{box: [1.0, 0.2, 1.2, 0.8]}", "{circle: [1.1, 0.5, 0.1]}"])
def test_obstacles_stop_robots(tmp_path, obstacle):
    world = world_of(tmp_path, (0.7, 0.5, 0), extra=f"obstacles: [{obstacle}]\n")
    drive(world, {1: FORWARD}, 3)
    assert world.collisions == 1
    assert world.pose(1).x == pytest.approx(0.93, abs=0.02)


def test_the_smallest_gap_is_that_between_the_hulls(tmp_path):
    world = world_of(tmp_path, (0.5, 0.5, 0), (2.0, 0.68, 0), (2.5, 1.3, 0))
    assert world.min_gap_m == pytest.approx(math.hypot(0.5, 0.62) - 0.14)
    drive(world, {1: FORWARD}, 10)
    assert world.min_gap_m == pytest.approx(0.04, abs=0.03)
    assert world.collisions == 0


def test_a_lone_robot_has_no_gap(tmp_path):
    assert world_of(tmp_path, (0.5, 0.5, 0)).min_gap_m == math.inf


# Sameness and speed


def wander(world, robots, duration_s):
    """Drive `robots` about for a while; return everything that they sensed."""
    samples = []
    for tick in range(round(duration_s * 60)):
        now = tick_start(tick + 1)
        world.step(now)
        for robot in robots:
            samples.append(world.sense(robot, now))
            world.act(robot, Twist(0.15, math.sin(tick / 40 + robot)), now, now)
    return samples


def test_equal_seeds_give_equal_bits_and_others_do_not():
    lab = load_lab(LABS / "corridor")
    first, again, other = (wander(World(lab, seed), lab.roster, 5) for seed in (7, 7, 8))
    assert first == again
    assert first != other


def test_what_a_robot_senses_does_not_depend_on_the_other_robots():
    lab = load_lab(LABS / "corridor")
    alone = wander(World(lab.with_robots(1), 7), (1,), 1)
    among = wander(World(lab, 7), (1,), 1)
    own = [
        [(s.stamp, s.left_m, s.right_m, s.gyro, s.compass, s.ranges, s.bumped, s.truth) for s in samples]
        for samples in (alone, among)
    ]
    assert own[0] == own[1]
    assert any(sample.bodies for sample in among)


def test_one_step_over_many_ticks_is_as_many_single_steps(tmp_path):
    once, often = (world_of(tmp_path, (0.5, 0.5, 0)) for _ in range(2))
    for world in (once, often):
        world.act(1, FORWARD, 0, 0)
    once.step(seconds(1))
    for tick in range(61):
        often.step(tick_start(tick))
    assert once.pose(1) == often.pose(1)
