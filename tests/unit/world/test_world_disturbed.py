"""What the world keeps of disturbances: what begins and ends when, and what it refuses."""

import pytest

from rmr.base.time import NEVER, NS_PER_MS, NS_PER_S
from rmr.radio.links import DISTURBANCES_MAX, Disturbance, Links, partition
from rmr.radio.phy import RadioConfig
from rmr_world.disturbances import LEAD, LINGER, DisturbanceList

S, MS = NS_PER_S, NS_PER_MS
GIVEN = Disturbance(groups=((1,), (2,)), loss=0.1)
NOISE = Disturbance(0, 5 * S, loss=0.5)


@pytest.fixture
def disturbed():
    return DisturbanceList("x", (1, 2, 3), [GIVEN])


def test_added_disturbance_begins_soon_and_lasts_its_duration(disturbed):
    assert disturbed.add(NOISE, 10 * S) == ""
    assert disturbed.held == (GIVEN, NOISE._replace(since=10 * S + LEAD, until=15 * S + LEAD))


def test_added_disturbance_without_a_duration_never_ends(disturbed):
    disturbed.add(partition([[1], [2]]), 10 * S)
    assert disturbed.added == (partition([[1], [2]], 10 * S + LEAD, NEVER),)


def test_before_the_start_it_is_added_for_the_beginning(disturbed):
    disturbed.add(NOISE, -80 * MS)
    assert disturbed.added[0].since == LEAD


def test_robots_that_the_lab_does_not_have_are_refused_by_their_numbers(disturbed):
    wanted = partition([[1, 7], [2, 9]])
    assert disturbed.add(wanted, 0) == "lab x has no robot 7, 9; its robots are 1, 2, 3"
    assert disturbed.held == (GIVEN,)


def test_there_are_no_more_than_a_station_takes_and_room_again_when_some_are_over(disturbed):
    for _ in range(DISTURBANCES_MAX - 1):
        assert disturbed.add(NOISE, 0) == ""
    Links(RadioConfig(), 7, disturbed.held)
    before = disturbed.held
    assert disturbed.add(NOISE, S) == "the radio is disturbed in 256 ways already; end those added: rmr fault clear"
    assert disturbed.held == before
    over = 5 * S + LEAD + LINGER
    assert disturbed.add(NOISE, over) == ""
    assert disturbed.held == (GIVEN, NOISE._replace(since=over + LEAD, until=over + 5 * S + LEAD))


def test_clear_ends_what_was_added_and_leaves_what_the_lab_file_says(disturbed):
    disturbed.add(NOISE, 0)
    disturbed.add(partition([[1], [2]]), 4 * S)
    disturbed.clear(6 * S)
    first, second = disturbed.added
    assert (first.until, second.until) == (5 * S + LEAD, 6 * S + LEAD)
    assert disturbed.given == (GIVEN,)


def test_clear_removes_disturbances_that_have_not_begun(disturbed):
    disturbed.add(NOISE, S)
    disturbed.clear(S)
    assert disturbed.held == (GIVEN,)


def test_expired_disturbance_is_kept_until_all_frames_of_its_time_are_decided(disturbed):
    disturbed.add(NOISE, 0)
    end = disturbed.added[0].until
    disturbed.forget(end + LINGER - 1)
    assert len(disturbed.added) == 1
    disturbed.forget(end + LINGER)
    assert disturbed.added == ()
