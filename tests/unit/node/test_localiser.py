"""The localiser: from samples of its sensors to where a robot is, or to no position at all."""

import math
from pathlib import Path
from random import Random

import pytest

from rmr.base.arena import Arena
from rmr.base.geometry import Point
from rmr.base.time import seconds, tick_start
from rmr.node.motion.localiser import REFUSED_MAX, Localiser
from rmr.node.ports import PoseFix, Sensed
from rmr_world.lab_file import load_lab
from rmr_world.physics import World

LABS = Path(__file__).parents[3] / "deploy" / "labs"
TICKS = 120


@pytest.mark.parametrize("seed", range(24, 32))
def test_a_robot_far_from_both_beacons_and_near_their_wall_finds_itself_on_its_side_of_it(seed):
    lab = load_lab(LABS / "twoway")  # of seed 28 the first ranges of robot 3 meet on the wall itself
    world = World(lab, seed)
    localisers = {robot.id: Localiser(lab.arena) for robot in lab.robots}
    for tick in range(1, TICKS + 1):
        world.step(tick_start(tick))
        for robot, localiser in localisers.items():
            localiser.feed(tick_start(tick), world.sense(robot, tick_start(tick)))
    for robot, localiser in localisers.items():
        assert localiser.pose is not None
        assert math.dist(localiser.pose[:2], world.pose(robot)[:2]) < 0.03


CORNERS = (Point(0.0, 0.0), Point(2.0, 2.0), Point(2.0, 0.0), Point(0.0, 2.0))
"""The first two do not lie on one wall."""
TRUE = (1.6, 0.7, 0.0)


class Still:
    """A robot that stands, and hears one beacon in each tick."""

    def __init__(self, beacons=CORNERS):
        self.beacons = beacons
        self.localiser = Localiser(Arena(2.0, 2.0, 0.05, beacons=beacons))
        self.rng = Random("still")
        self.tick = 0

    def sample(self, beacon=None, at=TRUE, **changed):
        """Return the sample of the present tick with a range to `beacon`; `changed`: what is forged."""
        ranges = ()
        if beacon is not None:
            metres = math.dist(at[:2], self.beacons[beacon]) + self.rng.gauss(0.0, 0.005)
            ranges = ((beacon, metres),)
        values = {"stamp": tick_start(self.tick), "left_m": 1.0, "right_m": 1.0, "gyro": 0.0, "compass": at[2]}
        values |= {"ranges": ranges, "bodies": (), "bumped": False, "truth": at}
        return Sensed(**values | changed)

    def feed(self, *beacons, at=TRUE, **changed):
        for beacon in beacons:
            self.tick += 1
            self.localiser.feed(tick_start(self.tick), self.sample(beacon, at, **changed))
        return self.localiser

    @property
    def off_m(self):
        return math.dist(self.localiser.pose[:2], TRUE[:2])


def test_two_beacons_that_leave_a_mirror_image_give_no_pose_and_a_third_decides():
    still = Still()
    assert still.feed(*[0, 1] * 30).pose is None
    assert still.feed(2).pose is not None
    assert still.off_m < 0.02


@pytest.mark.parametrize("seed", range(20))
def test_the_order_in_which_beacons_are_heard_does_not_matter(seed):
    still = Still()
    beacons = list(range(4))
    Random(f"{seed}/order").shuffle(beacons)
    still.feed(*beacons)
    assert still.off_m < 0.02


def test_an_estimate_that_ranges_contradict_is_dropped_and_the_robot_locates_itself_anew():
    still = Still()
    image = (0.7, 1.6, 0.0)
    assert math.dist(still.feed(*range(4), at=image).pose[:2], image[:2]) < 0.02
    poses = [still.feed(beacon).pose for beacon in [0, 1, 2, 3] * 3]
    assert None in poses
    assert still.localiser.dropped == 1
    assert still.off_m < 0.02


def test_a_robot_that_drives_while_it_searches_counts_its_way():
    still = Still()
    x = TRUE[0]
    for tick in range(120):
        x = TRUE[0] - 0.2 * tick / 60
        still.feed(tick % 2, at=(x, TRUE[1], math.pi), left_m=0.2 * tick / 60, right_m=0.2 * tick / 60)
    assert math.dist(still.localiser.pose[:2], (x, TRUE[1])) < 0.02, "moving tells the robot from its image"


FORGED = {
    "a way of -1e8 m": {"left_m": -1e8},
    "a metre within a tick": {"left_m": 2.0, "right_m": 2.0},
    "an earlier instant": {"stamp": 0},
    "an instant long before the start": {"stamp": -(1 << 60)},
    "an instant far ahead": {"stamp": seconds(1000)},
    "a turn rate of 1e9 rad/s": {"gyro": 1e9},
    "a heading of 1e8 rad": {"compass": 1e8},
    "a range beyond the floor": {"ranges": ((0, 9.0),)},
    "a range below zero": {"ranges": ((0, -1.0),)},
    "a beacon that is none": {"ranges": ((4, 1.0),)},
}


@pytest.mark.parametrize("changed", FORGED.values(), ids=FORGED)
def test_a_sample_that_no_body_can_produce_is_dropped_and_counted(changed):
    still = Still()
    before = still.feed(*range(4), *range(4)).pose
    assert still.feed(0, **changed).pose is before
    assert still.localiser.refused == 1
    still.feed(*range(4))
    assert still.localiser.refused == 1
    assert still.off_m < 0.02


def test_where_the_last_sample_was_wrong_those_that_agree_with_each_other_count_in_the_end():
    still = Still()
    still.feed(*range(4))
    still.feed(*[0, 1, 2, 3] * 6, left_m=55.0, right_m=55.0)
    assert still.localiser.refused == REFUSED_MAX
    assert still.off_m < 0.02
    assert still.localiser.sigma_m < 0.05


@pytest.mark.parametrize("seed", range(50))
def test_forged_samples_of_any_size_end_no_robot_and_it_locates_itself_afterwards(seed):
    rng = Random(f"{seed}/forged")
    still = Still()
    sizes = (0.0, 1.5, -3.0, 1e8, -1e8, 5e-324, 1e9, -1e9, 1e6, 1e4)
    for _ in range(100):
        field = rng.choice(("left_m", "right_m", "gyro", "compass", "stamp", "ranges", ""))
        size = rng.choice(sizes)
        forged = {
            "": {},
            "stamp": {"stamp": tick_start(still.tick) + int(size) * rng.choice((1, 1000, 1_000_000))},
            "ranges": {"ranges": ((rng.randrange(6), size),)},
        }.get(field, {field: size})
        still.feed(rng.randrange(4), **forged)
        assert still.localiser.sigma_m >= 0.0
    still.feed(*[0, 1, 2, 3] * 10)
    assert still.off_m < 0.03


# -- localised from outside


class Fixed:
    """A robot without a compass that drives a circle of 0.5 m at 0.2 m/s, and gets a fix at every twelfth tick."""

    RADIUS_M = 0.5
    NOISE_M = 0.02

    def __init__(self):
        self.localiser = Localiser(Arena(2.0, 2.0, 0.05))
        self.rng = Random("fixed")
        self.tick = 0
        self.turned = 0.0
        self.ways = [0.0, 0.0]
        self.carried = (0.0, 0.0)

    @property
    def true(self):
        angle = self.turned - math.pi / 2
        x = 1.0 + self.carried[0] + self.RADIUS_M * math.cos(angle)
        return x, 1.0 + self.carried[1] + self.RADIUS_M * math.sin(angle), math.remainder(self.turned, math.tau)

    def drive(self, ticks, speed=0.2, every=12, off=(0.0, 0.0, 0.0)):
        """Drive; `off` is what is wrong with each fix. Return the poses."""
        poses = []
        for _ in range(ticks):
            self.tick += 1
            rate = speed / self.RADIUS_M
            self.turned += rate / 60
            self.ways = [self.ways[0] + (speed - 0.05 * rate) / 60, self.ways[1] + (speed + 0.05 * rate) / 60]
            fix = None
            if every and self.tick % every == 0:
                noise = [self.rng.gauss(0.0, sigma) for sigma in (self.NOISE_M, self.NOISE_M, 0.05)]
                values = [true + n + o for true, n, o in zip(self.true, noise, off, strict=True)]
                fix = PoseFix(*values, self.NOISE_M, 0.05)
            now = tick_start(self.tick)
            sample = Sensed(now, *self.ways, rate, None, (), (), False, (0.0, 0.0, 0.0), fix)
            assert self.localiser.feed(now, sample)
            poses.append(self.localiser.pose)
        return poses

    @property
    def off_m(self):
        return math.dist(self.localiser.pose[:2], self.true[:2])


def test_three_fixes_that_agree_locate_a_robot_and_filtered_they_are_better_than_each():
    robot = Fixed()
    poses = robot.drive(12 * 3)
    assert [pose is None for pose in poses] == [True] * 35 + [False]
    robot.drive(300)
    off = []
    for _ in range(50):
        robot.drive(12)
        off.append(robot.off_m)
    assert sum(off) / len(off) < 0.012  # the mean of two normal errors of 2 cm is 2.5 cm
    assert abs(math.remainder(robot.localiser.pose[2] - robot.true[2], math.tau)) < 0.05
    assert robot.localiser.sigma_m < 0.015
    assert (robot.localiser.located, robot.localiser.dropped) == (1, 0)


def test_a_robot_that_drives_without_fixes_loses_its_pose_after_a_second_and_gets_it_back():
    robot = Fixed()
    robot.drive(120)
    poses = robot.drive(90, every=0)
    lost = poses.index(None)
    assert 48 <= lost <= 61
    assert poses[lost:] == [None] * (90 - lost)
    assert robot.localiser.dropped == 1
    assert robot.drive(12 * 4)[-1] is not None
    assert robot.off_m < 0.06


def test_a_robot_that_stands_keeps_its_pose_without_fixes():
    robot = Fixed()
    robot.drive(120)
    assert None not in robot.drive(600, speed=0.0, every=0)


def test_one_wild_fix_moves_nothing_and_a_robot_that_was_carried_stands_until_it_is_located_there():
    robot = Fixed()
    robot.drive(120)
    robot.drive(12, off=(0.8, -0.5, 2.0))
    robot.drive(12)
    assert robot.off_m < 0.04
    assert robot.localiser.dropped == 0
    robot.carried = (0.3, -0.3)
    poses = robot.drive(12 * 6, speed=0.0)
    assert robot.localiser.dropped == 1
    assert poses.index(None) < 12 * 2 + 1
    assert poses[-1] is not None
    assert robot.off_m < 0.06


def test_fixes_that_jump_about_locate_nobody():
    robot = Fixed()
    for k in range(20):
        assert robot.drive(12, off=(0.3 * (-1) ** k, 0.0, 0.0))[-1] is None
