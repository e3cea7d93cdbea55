"""Straight drives in common time: the common share, what keeps robots apart, and that a robot does as it should."""

import math
from itertools import combinations
from random import Random

import pytest

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, Pose, Twist
from rmr.base.time import NS_PER_S, TICK_HZ, Instant, in_seconds, seconds
from rmr.node.motion.straight_drive import Straight

SHAPE = RobotShape()
TICK = NS_PER_S // TICK_HZ
BEGINS, ENDS = seconds(2.0), seconds(7.0)
WAYS = (0.1, 0.3, 0.8)


def drive_to(x: float, y: float = 0.0) -> Straight:
    return Straight(Point(0.0, 0.0), Point(x, y), BEGINS, ENDS, SHAPE)


def moved(pose: Pose, twist: Twist, dt: float) -> Pose:
    theta = pose.theta + twist.w * dt
    return Pose(pose.x + twist.v * math.cos(theta) * dt, pose.y + twist.v * math.sin(theta) * dt, theta)


def arrival(drive: Straight, pose: Pose, since: Instant, until: Instant) -> tuple[Instant | None, Pose]:
    """Let a robot without noise or inertia drive; return when its line has ended, and where it is."""
    now = since
    while now < until:
        if drive.ended(pose):
            return now, pose
        pose = moved(pose, drive.steer(now, pose), in_seconds(TICK))
        now += TICK
    return None, pose


def test_the_share_that_is_due_grows_from_nothing_to_all_and_is_the_integral_of_its_rate():
    drive, total, last = drive_to(0.5), 0.0, 0.0
    assert drive.share(BEGINS - seconds(1)) == (0.0, 0.0)
    assert drive.share(ENDS + seconds(1)) == (1.0, 0.0)
    for now in range(BEGINS, ENDS, TICK):
        due, rate = drive.share(now)
        assert due >= last
        assert due == pytest.approx(total, abs=0.003)
        total, last = total + rate * in_seconds(TICK), due
    assert total == pytest.approx(1.0, abs=0.003)


@pytest.mark.parametrize("took", [0, 1, seconds(0.3), seconds(60)])
def test_any_two_instants_make_a_drive(took):
    drive = Straight(Point(0.0, 0.0), Point(0.3, 0.0), BEGINS, BEGINS + took, SHAPE)
    shares = [drive.share(BEGINS + took * part // 4)[0] for part in range(5)]
    assert shares == sorted(shares)
    assert drive.share(BEGINS + took + 1)[0] == 1.0


def test_robots_of_which_no_two_gain_by_an_exchange_keep_apart_on_their_straight_ways():
    """Turpin et al. 2014: of spacing D at both ends, the distance never falls below D / sqrt 2."""
    rng, spacing, nearest = Random(1), 0.3, math.inf
    for _ in range(40):
        starts, goals = (scattered(rng, 7, spacing) for _ in range(2))
        settle(starts, goals)
        for (a, b), (p, q) in zip(combinations(starts, 2), combinations(goals, 2), strict=True):
            for step in range(21):
                s = step / 20
                x, y = ((1 - s) * (a[i] - b[i]) + s * (p[i] - q[i]) for i in range(2))
                nearest = min(nearest, math.hypot(x, y))
    assert nearest >= spacing / math.sqrt(2.0) - 1e-9
    assert nearest < 0.9 * spacing, "some came near: the bound means something"


def scattered(rng: Random, count: int, spacing: float) -> list[Point]:
    points: list[Point] = []
    while len(points) < count:
        point = Point(rng.uniform(0.0, 1.2), rng.uniform(0.0, 1.2))
        if all(math.dist(point, other) >= spacing for other in points):
            points.append(point)
    return points


def settle(starts: list[Point], goals: list[Point]) -> None:
    """Exchange goals as long as that lessens the sum of the squared ways."""
    gained = True
    while gained:
        gained = False
        for i, j in combinations(range(len(starts)), 2):
            dot = sum((starts[i][k] - starts[j][k]) * (goals[i][k] - goals[j][k]) for k in range(2))
            if dot < -1e-9:
                goals[i], goals[j], gained = goals[j], goals[i], True


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("heading", [0.0, 1.5, 3.1])
def test_a_robot_turns_before_it_leaves_and_arrives_as_the_time_is_over(way, heading):
    drive, pose = drive_to(way), Pose(0.0, 0.0, heading)
    for now in range(0, BEGINS, TICK):
        twist = drive.steer(now, pose)
        assert twist.v == 0.0
        pose = moved(pose, twist, in_seconds(TICK))
    assert abs(pose.theta) < 0.05
    ended, pose = arrival(drive, pose, BEGINS, ENDS + seconds(5))
    assert ended is not None
    assert abs(in_seconds(ended - ENDS)) < 0.75
    assert math.dist(pose[:2], (way, 0.0)) < 0.015


def test_a_robot_on_its_way_has_the_share_behind_it_that_is_due():
    drive, pose = drive_to(0.8), Pose(0.0, 0.0, 0.0)
    for now in range(BEGINS, ENDS, TICK):
        assert abs(drive.along(pose)[0] - 0.8 * drive.share(now)[0]) < 0.012
        pose = moved(pose, drive.steer(now, pose), in_seconds(TICK))


def test_who_leaves_late_catches_up_as_far_as_its_speed_allows():
    drive, pose = drive_to(0.7), Pose(0.0, 0.0, 0.0)
    ended, _ = arrival(drive, pose, BEGINS + seconds(0.6), ENDS + seconds(5))
    assert ended is not None
    assert in_seconds(ended - ENDS) < 0.3
    ended, _ = arrival(drive, pose, ENDS, ENDS + seconds(8))
    assert ended is not None
    assert in_seconds(ended - ENDS) > 0.7 / SHAPE.speed


def test_a_robot_beside_its_line_comes_back_to_it():
    drive = drive_to(0.8)
    ended, pose = arrival(drive, Pose(0.0, 0.03, 0.0), BEGINS, ENDS + seconds(5))
    assert ended is not None
    assert abs(pose.y) < 0.003
    assert drive.astray(Pose(0.8, 0.05, 0.0))
    assert not drive.astray(pose)


def test_a_robot_that_is_there_stands():
    drive = drive_to(0.0)
    pose = Pose(0.0, 0.0, 2.0)
    assert drive.ended(pose)
    assert drive.steer(BEGINS, pose) == Twist(0.0, 0.0)
