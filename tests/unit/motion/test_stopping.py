"""A robot can always stop before what it knows of, even if that stops as well."""

import math

import pytest

from rmr.base.arena import RobotShape
from rmr.base.motion_scale import REACTION_BRAKE, scale_of
from rmr.node.motion.stopping import stopping_speed
from rmr.node.ports import SeenBody

FULL = 0.2
WHEELS = 0.8


SCALE = scale_of(RobotShape())


def gap_after(gap: float, y: float, leader: float, shape: RobotShape) -> float:
    """Let two robots brake that drive straight on at `gap`, the second one 0.1 s late; return the smallest gap."""
    touch = 2 * shape.radius
    x, dt = math.sqrt((touch + gap) ** 2 - y * y), 0.001
    body = SeenBody(x, y, leader, 0.0)
    v, u, t, least = stopping_speed(shape.speed, body, scale_of(shape)), leader, 0.0, gap
    while v > 0.0 or u != 0.0:
        x += (u - v) * dt
        u = max(0.0, u - WHEELS * dt) if u > 0.0 else min(0.0, u + WHEELS * dt)
        v = v if t < 0.1 else max(0.0, v - WHEELS * dt)
        t += dt
        least = min(least, math.hypot(x, y) - touch)
    return least


@pytest.mark.parametrize("gap", [0.006, 0.01, 0.02, 0.04, 0.08])
@pytest.mark.parametrize("y", [0.0, 0.07, 0.12, 0.138])
@pytest.mark.parametrize("leader", [0.0, 0.1, FULL])
def test_hulls_never_meet_when_the_one_ahead_brakes(gap: float, y: float, leader: float) -> None:
    assert gap_after(gap, y, leader, RobotShape()) > 0.002


@pytest.mark.parametrize("radius", [0.05, 0.15, 0.5])
@pytest.mark.parametrize("speed", [0.1, 0.4, 1.0, 2.0])
@pytest.mark.parametrize("share", [-1.0, 0.0, 0.5, 1.0])
def test_hulls_of_any_size_and_speed_never_meet_when_the_one_ahead_brakes(
    radius: float, speed: float, share: float
) -> None:
    shape = RobotShape(radius, speed)
    on_m = max(0.0, -share) * speed * speed / (2.0 * REACTION_BRAKE)  # what one that comes nearer needs itself
    for gap in (0.01, 0.05, 0.2, 0.5, 1.0, 2.0):
        for y in (0.0, radius, 1.9 * radius):
            assert gap_after(on_m + gap, y, share * speed, shape) > 0.002, (gap, y)


def test_who_follows_at_an_ordinary_gap_is_not_slowed() -> None:
    assert stopping_speed(FULL, SeenBody(0.17, 0.0, FULL, 0.0), SCALE) == FULL


def test_who_follows_more_closely_falls_back() -> None:
    assert stopping_speed(FULL, SeenBody(0.155, 0.0, FULL, 0.0), SCALE) < 0.85 * FULL


def test_bodies_behind_beside_and_far_away_do_not_matter() -> None:
    for x, y in ((-0.1, 0.11), (0.05, 0.15), (0.24, 0.0)):
        assert stopping_speed(FULL, SeenBody(x, y, 0.0, 0.0), SCALE) == FULL
