"""A robot can always stop before what it knows of, even if that stops as well."""

import math

import pytest

from rmr.node.motion.stopping import stopping_speed
from rmr.node.ports import SeenBody

RADIUS, FULL = 0.07, 0.2
WHEELS = 0.8


def gap_after(gap: float, y: float, leader: float) -> float:
    """Let two robots brake that drive straight on at `gap`, the second one 0.1 s late; return the smallest gap."""
    x, dt = math.sqrt((2 * RADIUS + gap) ** 2 - y * y), 0.001
    body = SeenBody(x, y, leader, 0.0)
    v, u, t, least = stopping_speed(FULL, body, RADIUS), leader, 0.0, gap
    while v > 0.0 or u > 0.0:
        x += (u - v) * dt
        u = max(0.0, u - WHEELS * dt)
        v = v if t < 0.1 else max(0.0, v - WHEELS * dt)
        t += dt
        least = min(least, math.hypot(x, y) - 2 * RADIUS)
    return least


@pytest.mark.parametrize("gap", [0.006, 0.01, 0.02, 0.04, 0.08])
@pytest.mark.parametrize("y", [0.0, 0.07, 0.12, 0.138])
@pytest.mark.parametrize("leader", [0.0, 0.1, FULL])
def test_hulls_never_meet_when_the_one_ahead_brakes(gap: float, y: float, leader: float) -> None:
    assert gap_after(gap, y, leader) > 0.002


def test_who_follows_at_an_ordinary_gap_is_not_slowed() -> None:
    assert stopping_speed(FULL, SeenBody(0.17, 0.0, FULL, 0.0), RADIUS) == FULL


def test_who_follows_more_closely_falls_back() -> None:
    assert stopping_speed(FULL, SeenBody(0.155, 0.0, FULL, 0.0), RADIUS) < 0.85 * FULL


def test_bodies_behind_beside_and_far_away_do_not_matter() -> None:
    for x, y in ((-0.1, 0.11), (0.05, 0.15), (0.24, 0.0)):
        assert stopping_speed(FULL, SeenBody(x, y, 0.0, 0.0), RADIUS) == FULL
