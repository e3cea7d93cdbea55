"""The shield alone keeps hulls apart, and each part of its invariant is needed (`shield_campaign`)."""

import math

import pytest
from shield_campaign import PARTS, overlapping

from rmr.base.arena import Arena
from rmr.base.geometry import Pose, Twist
from rmr.base.time import seconds
from rmr.node.motion.shield import SIGMAS, Shield

SHIELD = Shield(0.07, 0.2)
SIGMA_M = 0.003
KEEP_M = 0.14 + SIGMAS * SIGMA_M
FIRST_FOUND = {"braking": (1, 10), "uncertainty": (1, 10), "unheard": (1, 10), "walls": (1, 15), "age": (227, 227)}
"""For each part, runs among which one fails without it."""


def test_no_hulls_overlap() -> None:
    assert overlapping(1, 200) == []


@pytest.mark.parametrize("part", PARTS)
def test_each_part_is_needed(part: str) -> None:
    first, last = FIRST_FOUND[part]
    assert overlapping(first, last, part)
    assert not overlapping(first, last)


def test_the_robot_stands_at_the_margin() -> None:
    parked = SHIELD.parked(KEEP_M + 0.02, 0.0, SIGMA_M)
    share = SHIELD.past(Twist(0.2, 0.0), [parked])
    v = 0.2 * share
    assert 0.015 < v * 0.117 + v * v / 1.6 < 0.02


@pytest.mark.parametrize("gap_m", [0.0, 0.004, 0.02])
def test_a_robot_may_leave_what_it_almost_touches(gap_m: float) -> None:
    ahead = [SHIELD.parked(0.14 + gap_m, 0.0, 0.01)]
    assert SHIELD.past(Twist(0.2, 0.0), ahead) == 0.0
    assert SHIELD.past(Twist(-0.2, 0.0), ahead) == 1.0
    assert SHIELD.past(Twist(0.0, 2.0), ahead) == 1.0
    beside = [SHIELD.parked(0.0, 0.14 + gap_m, 0.01)]
    assert SHIELD.past(Twist(0.2, 0.0), beside) == 0.0  # the estimates may be off: first it turns a little
    abaft = [SHIELD.parked(-0.12 * (0.14 + gap_m), 0.14 + gap_m, 0.01)]
    assert SHIELD.past(Twist(0.2, 0.0), abaft) == 1.0
    assert SHIELD.past(Twist(0.2, 3.0), abaft) < 0.5


def test_a_silent_robot_may_be_anywhere_in_a_disc_that_grows() -> None:
    away = 0.14 + 0.2 * (0.117 + 0.25) + 0.06
    drive = Twist(0.2, 0.0)
    assert SHIELD.past(drive, [SHIELD.taken(away, 0.0, 0.0, 0)]) == 1.0
    assert 0.0 < SHIELD.past(drive, [SHIELD.taken(away, 0.0, 0.0, seconds(0.2))]) < 1.0
    for x in (away, -away):
        assert SHIELD.past(drive, [SHIELD.taken(x, 0.0, 0.0, seconds(0.5))]) == 0.0
    promised = SHIELD.taken(0.19, 0.0, 0.0, -seconds(1))
    assert SHIELD.past(drive, [promised]) > 0.0


def test_walls_are_kept_at_the_margin() -> None:
    arena = Arena(2.0, 2.0, 0.05)
    towards = Twist(0.2, 0.0)
    assert SHIELD.within(towards, Pose(1.0, 1.0, 0.0), arena, SIGMA_M) == 1.0
    assert SHIELD.within(towards, Pose(1.92, 1.0, 0.0), arena, SIGMA_M) == 0.0
    assert SHIELD.within(towards, Pose(1.92, 1.0, math.pi), arena, SIGMA_M) == 1.0
    assert SHIELD.within(Twist(-0.2, 0.0), Pose(1.92, 1.0, 0.0), arena, SIGMA_M) == 1.0
    assert 0.0 < SHIELD.within(towards, Pose(1.9, 1.0, 0.0), arena, SIGMA_M) < 1.0
