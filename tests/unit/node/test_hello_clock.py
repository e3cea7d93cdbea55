"""When hellos are due: often enough to be known by, seldom enough to leave the air to others."""

import math
from itertools import pairwise
from random import Random

import pytest

from rmr.base.geometry import Pose
from rmr.base.time import Duration, in_seconds, seconds
from rmr.node.motion.hearing import SILENT_MOVING, SILENT_PARKED
from rmr.node.motion.ways import TURNED_M
from rmr.node.payloads import Hello
from rmr.node.peers.hello import EAGER_FOR, STAYS, ExpectedStand, HelloClock
from rmr.node.profile import profile_of


def periods(
    robots: int, *, parked: bool, waits: bool = False, leaves: bool = False, driving: int | None = None
) -> list[Duration]:
    """The times between a hundred hellos."""
    clock = HelloClock(Random(1), profile_of(robots))
    clock.parked = parked
    found = []
    for _ in range(100):
        clock.rewind(seconds(5), waits=waits, leaves=leaves, driving=driving)
        found.append(clock.due - seconds(5))
    return found


@pytest.mark.parametrize(("robots", "period_s"), [(1, 0.5), (6, 0.5), (25, 0.5), (40, 0.8), (50, 1.0), (1000, 1.0)])
def test_the_more_robots_there_are_the_less_often_a_parked_one_speaks_up_to_a_second(
    robots: int, period_s: float
) -> None:
    told = [in_seconds(period) for period in periods(robots, parked=True)]
    assert 0.89 * period_s < min(told) < 0.95 * period_s
    assert 1.05 * period_s < max(told) < 1.11 * period_s


@pytest.mark.parametrize(("robots", "period_s"), [(2, 0.2), (25, 0.2), (40, 0.32), (50, 0.35), (1000, 0.35)])
def test_one_that_moves_speaks_less_often_among_many_too_up_to_a_bound(robots: int, period_s: float) -> None:
    told = [in_seconds(period) for period in periods(robots, parked=False)]
    assert 0.89 * period_s < min(told)
    assert max(told) < 1.11 * period_s


@pytest.mark.parametrize(("robots", "period_s"), [(2, 0.2), (6, 0.2), (20, 0.4), (25, 0.5), (50, 1.0)])
def test_who_waits_for_its_turn_speaks_as_one_that_moves_among_few_and_as_one_that_is_parked_among_many(
    robots: int, period_s: float
) -> None:
    told = [in_seconds(period) for period in periods(robots, parked=True, waits=True)]
    assert 0.89 * period_s < min(told)
    assert max(told) < 1.11 * period_s


def test_nobody_is_taken_for_silent_whose_hellos_were_lost_once_or_twice_while_it_moved_four_times_among_few() -> None:
    assert 2 * max(periods(1000, parked=True)) < SILENT_PARKED
    assert 3 * max(periods(1000, parked=False)) < SILENT_MOVING
    assert 5 * max(periods(25, parked=False)) < SILENT_MOVING


def test_a_robot_that_begins_is_heard_soon_and_often_for_others_wait_for_it() -> None:
    clock = HelloClock(Random(1), profile_of(6))
    clock.start(seconds(3))
    told = []
    while clock.due < seconds(3) + EAGER_FOR:
        told.append(in_seconds(clock.due - seconds(3)))
        clock.rewind(clock.due)
    assert told[0] < 0.19
    assert len(told) >= 3, "the third is as good as sure to be heard"
    assert max(b - a for a, b in pairwise(told)) < 0.09
    begun = clock.due
    clock.rewind(begun)
    assert clock.due > begun + seconds(0.44)


def test_a_robot_that_had_no_place_to_tell_when_its_first_hello_was_due_begins_when_it_has_one() -> None:
    clock = HelloClock(Random(1), profile_of(6))
    clock.start(seconds(3))
    clock.begin(seconds(5))
    told = []
    while clock.due < seconds(5) + EAGER_FOR:
        told.append(in_seconds(clock.due - seconds(5)))
        clock.rewind(clock.due)
    assert told[0] < 0.04
    assert len(told) >= 4


def test_a_robot_that_begins_to_drive_back_says_so_at_once() -> None:
    clock = HelloClock(Random(1), profile_of(6))
    clock.poll(seconds(3), parked=False)
    clock.rewind(seconds(3))
    clock.poll(seconds(3.01), parked=False, back=True)
    assert clock.due < seconds(3.05)


@pytest.mark.parametrize(("driving", "period_s"), [(0, 0.2), (8, 0.2), (29, 0.24), (99, 0.35)])
def test_in_a_crowd_those_that_drive_speak_as_often_as_so_few_of_them_may(driving: int, period_s: float) -> None:
    for how in ({"parked": False}, {"parked": True, "waits": True, "leaves": True}):
        told = [in_seconds(period) for period in periods(100, driving=driving, **how)]
        assert 0.89 * period_s < min(told)
        assert max(told) < 1.11 * period_s


def test_one_that_stays_says_so_twice_more_before_it_may_leave() -> None:
    assert 2 * max(periods(1000, parked=True)) < STAYS


def test_a_robot_that_sets_out_or_turns_is_astray_before_that_matters_and_one_that_drives_on_is_not() -> None:
    driving = ExpectedStand(Hello(1.0, 1.0, 0.0, 0.2, parked=False, rank=0, goal=None))
    for age_s in (0.0, 0.1, 0.35):
        assert driving.astray_m(age_s, Pose(1.0 + 0.2 * age_s, 1.0, 0.0), 0.2) < 1e-9
    turned = [k / 60 for k in range(30) if driving.astray_m(k / 60, turning(0.2, 1.0, k / 60), 0.2) > TURNED_M]
    assert 0.1 < turned[0] < 0.2  # the least time between two hellos of one that drives
    standing = ExpectedStand(Hello(1.0, 1.0, 0.0, 0.0, parked=False, rank=0, goal=None))
    assert standing.astray_m(1.0, Pose(1.0, 1.0, 2.0), 0.0) == 0.0  # a turn on the spot moves no hull
    assert standing.astray_m(1.0, Pose(1.0, 1.0, 2.0), 0.07) > TURNED_M
    backing = ExpectedStand(Hello(1.0, 1.0, 0.0, -0.08, parked=False, rank=0, goal=None))
    assert backing.astray_m(0.1, Pose(0.992, 1.0, 0.0), -0.08) < 1e-9


def turning(v: float, w: float, age_s: float) -> Pose:
    """Return where a robot is that has driven an arc from (1, 1) for `age_s`."""
    return Pose(1.0 + v / w * math.sin(w * age_s), 1.0 + v / w * (1.0 - math.cos(w * age_s)), w * age_s)
