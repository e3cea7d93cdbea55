"""Robots that come towards each other keep to the right before they stand face to face."""

from math import inf, pi

import pytest
from bench import Bench

from rmr.base.arena import Arena, RobotShape
from rmr.base.geometry import Point, Pose
from rmr.base.motion_scale import scale_of
from rmr.base.time import milliseconds, seconds
from rmr.node.motion.meeting import FAR_HORIZONS, oncoming
from rmr.node.motion.priority import AGE_MAX, Heard
from rmr.node.motion.standoff.detector import GHOST_S, DeadlockDetector

SHAPE = RobotShape()
HERE = Pose(1.0, 1.0, 0.0)
NOW = seconds(10)
FAR = FAR_HORIZONS * scale_of(SHAPE).horizon_s * SHAPE.speed


def one(x: float, y: float = 1.0, theta: float = pi, at: int = NOW) -> Heard:
    return Heard(2, Pose(x, y, theta), Point(0.0, 1.0), 0, at)


def meets(other: Heard, within_m: float = inf) -> dict[int, Point]:
    return oncoming(NOW, HERE, [other], SHAPE, within_m)


def test_one_that_comes_straight_towards_the_robot_is_passed_by_a_place_half_way_on_the_left():
    ((robot, place),) = meets(one(1.8)).items()
    assert robot == 2
    assert place.x == pytest.approx(1.4)
    assert SHAPE.radius < place.y - HERE.y < 2 * SHAPE.radius, "the detour on the right is the shorter one"


def test_both_keep_to_their_own_right():
    mine = meets(one(1.8))[2]
    theirs = oncoming(NOW, Pose(1.8, 1.0, pi), [Heard(1, HERE, Point(3.0, 1.0), 0, NOW)], SHAPE, inf)[1]
    assert theirs.x == pytest.approx(mine.x)
    assert theirs.y - 1.0 == pytest.approx(1.0 - mine.y)


@pytest.mark.parametrize(
    "other",
    [
        one(1.0 + FAR + 0.01),
        one(1.0 + 5.9 * SHAPE.radius),
        one(0.4),
        one(1.8, theta=0.0),
        one(1.8, theta=0.75 * pi - 0.1),
        one(1.8, 1.0 + 2 * SHAPE.radius + 0.06),
        one(1.8, at=NOW - AGE_MAX - milliseconds(1)),
    ],
    ids=["far away", "near", "behind", "the same way", "across", "on another line", "not heard lately"],
)
def test_the_robot_meets_no_other_one(other: Heard):
    assert not meets(other)


def test_one_that_it_would_meet_behind_its_goal_is_none():
    assert meets(one(1.8), within_m=0.41)
    assert not meets(one(1.8), within_m=0.39)


def test_the_reach_follows_the_robots_speed_and_braking():
    swift = RobotShape(speed=2.0, radius=SHAPE.radius)
    far = FAR_HORIZONS * scale_of(swift).horizon_s * swift.speed
    assert far > 2 * FAR
    other = one(1.0 + far - 0.01)
    assert oncoming(NOW, HERE, [other], swift, inf)
    assert not meets(other)


def test_whom_a_detour_passes_is_forgotten_with_it():
    detector = DeadlockDetector(1, SHAPE)
    detector.meet(NOW, {2: Point(1.4, 1.1)})
    ends = NOW + seconds(GHOST_S)
    assert detector.met(ends - 1) == {2}
    assert not detector.met(ends)
    detector.mark(NOW, HERE, [Point(1.2, 1.0)], SHAPE.radius)
    assert not detector.met(NOW), "a deadlock after all: the order decides again"


@pytest.mark.parametrize(("radius", "speed"), [(0.07, 0.2), (0.1, 0.2), (0.1, 1.0), (0.1, 2.0)])
def test_two_in_an_open_floor_pass_without_a_deadlock(radius: float, speed: float):
    shape = RobotShape(radius=radius, speed=speed)
    long = max(3.0, 5.0 * FAR_HORIZONS * scale_of(shape).horizon_s * speed / 2.0)
    arena = Arena(long, 2.0, radius, (), shape=shape)
    ends = [Point(0.3, 1.0), Point(long - 0.3, 1.0)]
    for seed in range(5):
        bench = Bench(arena, [Pose(*ends[0], 0.0), Pose(*ends[1], pi)], seed)
        for body, goal in zip(bench.bodies, reversed(ends), strict=True):
            assert body.nav.go(bench.now, body.estimate, goal)
        while not all(body.nav.status == "arrived" for body in bench.bodies):
            if bench.tick % 12 == 0:
                bench.say()
            bench.step()
            assert bench.time < 60, f"seed {seed}"
        assert not bench.contacts, f"seed {seed}"
        free = (long - 0.6) / speed + 2.0
        assert bench.time < 1.25 * free, f"seed {seed}: {bench.time:.1f} s, alone about {free:.1f} s"
