"""Links are symmetric while both ends hear each other; a robot without a majority of them stands."""

from collections.abc import Collection

import pytest

from rmr.base.time import Instant, milliseconds, seconds
from rmr.node.motion.hearing import DEAD
from rmr.node.payloads import HELLO_LIST_OCTETS_MAX
from rmr.node.peers.link_sensing import CUT_OFF_MAX, LISTED, LISTED_CROWD, NEVER_HEARD, ROBOTS_MAX, LinkSensing

SIX = range(1, 7)
LONG_AFTER = seconds(20)


def heard_by(robot: int, others: Collection[int], at: Instant, roster: Collection[int] = SIX) -> bytes:
    """Return the list of a hello of `robot`, which has just heard `others`."""
    return LinkSensing(robot, roster).list_of(dict.fromkeys(others, at), at)


def meets(links: LinkSensing, others: Collection[int], until: Instant, *, listed: Collection[int] = SIX) -> None:
    """Let `links` hear each of `others` say every 0.2 s, up to `until`, that it hears those `listed`."""
    links.cut_off(0)
    for at in range(0, until + 1, milliseconds(200)):
        for other in others:
            links.note(at, other, heard_by(other, [one for one in listed if one != other], at))


def test_a_robot_that_all_others_hear_may_drive_at_once() -> None:
    links = LinkSensing(2, SIX, begins_late=True)
    assert links.cut_off(0)
    meets(links, [1, 3, 4, 5, 6], 0)
    assert not links.cut_off(0)


def test_a_mute_robot_that_hears_everybody_stands_once_the_others_list_it_no_more() -> None:
    links = LinkSensing(2, SIX)
    meets(links, [1, 3, 4, 5, 6], LONG_AFTER)
    heard = LONG_AFTER
    for at in range(heard, heard + seconds(4), milliseconds(200)):
        for other in (1, 3, 4, 5, 6):
            links.note(at, other, heard_by(other, [one for one in (1, 3, 4, 5, 6) if one != other], at))
        assert links.cut_off(at) == (at - heard > LISTED)


@pytest.mark.parametrize("late", [False, True], ids=["first life", "restarted"])
def test_a_robot_that_never_hears_anybody_stands_for_a_minute_and_then_drives_by_sight(late: bool) -> None:
    links = LinkSensing(2, SIX, begins_late=late)
    begun = seconds(5)
    assert links.cut_off(begun) == late
    assert links.cut_off(begun + CUT_OFF_MAX - 1)
    assert not links.cut_off(begun + CUT_OFF_MAX)


@pytest.mark.parametrize(
    ("robot", "side", "stands"),
    [(2, [3, 4], False), (2, [3], True), (1, [2, 3], False), (4, [5, 6], True), (3, [1, 2], False)],
    ids=["four of six", "two of six", "half with the least id", "half without it", "half, the least id is another"],
)
def test_of_two_sides_that_do_not_hear_each_other_at_most_one_drives(robot: int, side: list[int], stands: bool) -> None:
    links = LinkSensing(robot, SIX)
    whole = [*side, 1] if (robot, side) == (2, [3, 4]) else side
    meets(links, whole, LONG_AFTER)
    assert links.cut_off(LONG_AFTER) == stands


def test_no_two_robots_of_different_sides_both_have_a_majority() -> None:
    """Quorum intersection, for every way to part a roster in two."""
    for size in range(2, 8):
        roster = range(1, size + 1)
        for split in range(1, 2**size - 1):
            sides = [[one for one in roster if split >> (one - 1) & 1 == side] for side in (0, 1)]
            drive = []
            for side in sides:
                links = LinkSensing(side[0], roster)
                links.cut_off(0)
                for at in range(LONG_AFTER - seconds(4), LONG_AFTER + 1, milliseconds(500)):
                    for other in side[1:]:
                        links.note(at, other, heard_by(other, side, at, roster))
                drive.append(not links.cut_off(LONG_AFTER))
            assert sum(drive) == 1, sides


def test_a_majority_that_comes_back_counts_only_when_the_others_have_had_time_to_tell() -> None:
    links = LinkSensing(2, SIX)
    meets(links, [1, 3, 4], seconds(5))
    back = seconds(30)
    stood = []
    for at in range(back, back + seconds(4), milliseconds(200)):
        for other in (1, 3, 4):
            links.note(at, other, heard_by(other, [2], at))
        stood.append(links.cut_off(at))
    assert stood == [at - back < LISTED for at in range(back, back + seconds(4), milliseconds(200))]


def test_a_robot_left_alone_stands_for_a_minute_and_then_goes_on_by_sight() -> None:
    links = LinkSensing(2, SIX)
    meets(links, [1, 3, 4, 5, 6], seconds(5))
    ends = seconds(5) + LISTED
    assert not links.cut_off(ends)
    assert links.cut_off(ends + seconds(1))
    assert links.cut_off(ends + CUT_OFF_MAX - 1)
    assert not links.cut_off(ends + CUT_OFF_MAX)


def test_when_a_robot_was_listed_last_is_known_from_the_lists_of_others() -> None:
    links = LinkSensing(2, SIX)
    assert links.listed(5) == NEVER_HEARD
    links.note(seconds(1), 1, heard_by(1, [5], seconds(1)))
    links.note(seconds(2), 3, heard_by(3, [5], seconds(2)))
    links.note(seconds(3), 3, heard_by(3, [], seconds(3)))
    assert links.listed(5) == seconds(2)
    links.note(seconds(4), 1, heard_by(1, [5], seconds(4)))
    assert links.listed(5) == seconds(4)
    assert links.listed(99) == NEVER_HEARD


def test_a_list_leaves_out_who_has_not_been_heard_for_long() -> None:
    told = LinkSensing(1, SIX).list_of({2: seconds(10) - LISTED, 3: seconds(10) - LISTED - 1}, seconds(10))
    links = LinkSensing(2, SIX)
    links.note(seconds(10), 1, told)
    assert links.listed(2) == seconds(10)
    assert links.listed(3) == NEVER_HEARD


@pytest.mark.parametrize("robots", [1, 2, 8, 9, 48, 49, ROBOTS_MAX])
def test_a_roster_of_any_size_is_told_in_lists_that_fit_a_hello(robots: int) -> None:
    roster = range(1, robots + 1)
    says = LinkSensing(1, roster)
    links = LinkSensing(robots, roster)
    heard = dict.fromkeys(roster, 0)
    for at in range(8):
        octets = says.list_of(heard, at)
        assert len(octets) <= HELLO_LIST_OCTETS_MAX
        links.note(at, 1, octets)
    assert all(links.listed(one) >= 0 for one in roster)


def test_a_robot_that_nobody_hears_stands_before_it_is_presumed_dead() -> None:
    assert 2 * LISTED <= 2 * LISTED_CROWD < DEAD


@pytest.mark.parametrize("octets", [b"", b"\xff\xff", bytes(7)])
def test_a_list_of_another_form_says_nothing(octets: bytes) -> None:
    links = LinkSensing(2, SIX)
    links.note(0, 1, octets)
    assert links.listed(2) == NEVER_HEARD
