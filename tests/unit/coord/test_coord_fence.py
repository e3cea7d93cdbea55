"""The fence alone: what it remembers and when it is open."""

from coord_harness import EVENT, ms

from rmr.base.direction import EXCLUSIVE
from rmr.coord.fence import Claim, Fence
from rmr.coord.messages import Beacon, Phase
from rmr.coord.term import Term
from rmr.coord.timing import Timing


def beacon(
    who: int, phase: Phase, time: float, *, direction: int = 0, start: float = 1000, end: float = 4000
) -> Beacon:
    return Beacon(EVENT, ms(time), Term(1, 1), who, 0, phase, direction, ms(start), ms(end))


def claim(start: float = 2000, direction: int = 0) -> Claim:
    return Claim(1, ms(start), ms(start + 3000), ms(950), direction)


def fence(*beacons: Beacon) -> Fence:
    made = Fence(1, Timing())
    for item in beacons:
        made.note(item)
    return made


def test_an_empty_fence_is_open() -> None:
    assert fence().judge(ms(2000), claim()) == (True, False, False)


def test_the_headway_behind_a_robot_of_the_same_way_is_kept() -> None:
    made = fence(beacon(2, Phase.IN, 1100, start=1100))
    assert not made.judge(ms(2049), claim()).open
    assert made.judge(ms(2050), claim()).open


def test_opposed_robot_inside_closes_the_fence_until_out() -> None:
    made = fence(beacon(2, Phase.IN, 1100, direction=1))
    assert not made.judge(ms(9000), claim(direction=0)).open
    made.note(beacon(2, Phase.OUT, 9000, direction=1))
    assert made.judge(ms(9000), claim(direction=0)).open


def test_an_exclusive_passage_excludes_those_of_its_own_way_too() -> None:
    made = fence(beacon(2, Phase.IN, 1100, direction=EXCLUSIVE))
    assert not made.judge(ms(9000), claim(direction=EXCLUSIVE)).open
    assert not made.judge(ms(9000), claim(direction=0)).open
    made.note(beacon(2, Phase.OUT, 9000, direction=EXCLUSIVE))
    assert made.judge(ms(9000), claim(direction=EXCLUSIVE)).open
    assert (
        fence(beacon(2, Phase.CLAIM, 1900, direction=EXCLUSIVE, start=1000))
        .judge(ms(1200), claim(3000, EXCLUSIVE))
        .lost
    ), "the windows meet"


def test_a_silent_opposed_robot_is_passed_with_caution_after_the_longest_stall() -> None:
    made = fence(beacon(2, Phase.IN, 1100, direction=1))
    assert not made.judge(ms(11_099), claim(11_000)).open
    assert made.judge(ms(11_100), claim(11_000)) == (True, False, True)


def test_caution_towards_a_silent_opposed_robot_lasts_until_it_is_heard_out() -> None:
    made = fence(beacon(2, Phase.IN, 1100, direction=1))
    assert made.judge(ms(71_100), claim(71_000)) == (True, False, True)
    made.note(beacon(2, Phase.OUT, 71_200, direction=1))
    assert made.judge(ms(71_300), claim(71_300)) == (True, False, False)


def test_a_claim_past_its_window_counts_as_inside_until_it_yields() -> None:
    made = fence(beacon(2, Phase.CLAIM, 900, direction=1, start=1000, end=1500))
    assert not made.judge(ms(2500), claim(2500)).open
    made.note(beacon(2, Phase.YIELD, 1300, direction=1, start=1000, end=1500))
    assert made.judge(ms(2600), claim(2500)).open


def test_of_two_conflicting_claims_the_smaller_start_then_robot_wins() -> None:
    assert fence(beacon(2, Phase.CLAIM, 1900, direction=1, start=1990)).judge(ms(1950), claim(2000)).lost
    assert not fence(beacon(2, Phase.CLAIM, 1900, direction=1, start=2000)).judge(ms(1950), claim(2000)).lost
    assert fence(beacon(0, Phase.CLAIM, 1900, direction=1, start=2000)).judge(ms(1950), claim(2000)).lost


def test_claim_winner_waits_for_the_yield_of_a_silent_loser() -> None:
    made = fence(beacon(2, Phase.CLAIM, 1500, direction=1, start=2010))
    for now in (1990, 2100, 2250):
        assert made.judge(ms(now), claim(2000)) == (False, False, False)


def test_the_winner_need_not_wait_for_a_loser_that_yields() -> None:
    made = fence(beacon(2, Phase.CLAIM, 1900, direction=1, start=2010))
    made.note(beacon(2, Phase.YIELD, 1950, direction=1, start=2010))
    assert made.judge(ms(2000), claim(2000)).open


def test_repeats_and_old_beacons_change_nothing() -> None:
    made = fence(beacon(2, Phase.IN, 1100))
    assert not made.note(beacon(2, Phase.IN, 1100))
    assert not made.note(beacon(2, Phase.CLAIM, 900))
    made.note(beacon(2, Phase.OUT, 2000))
    assert not made.note(beacon(2, Phase.IN, 2050))
    assert made.inside(ms(2100)) == []


def test_a_yield_in_the_very_millisecond_of_the_claim_is_news() -> None:
    made = fence(beacon(2, Phase.CLAIM, 900))
    assert made.note(beacon(2, Phase.YIELD, 900))
    assert not made.note(beacon(2, Phase.CLAIM, 900))


def test_a_witness_is_asked_for_a_silent_opposed_robot_only() -> None:
    made = Fence(9, Timing())
    made.note(beacon(2, Phase.IN, 1000, direction=1))
    assert made.unheard(ms(1150), beacon(3, Phase.CLAIM, 1150)) is None
    assert made.unheard(ms(1250), beacon(3, Phase.CLAIM, 1250)) == 2
    assert made.unheard(ms(1250), beacon(3, Phase.CLAIM, 1250, direction=1)) is None


def test_memory_is_bounded() -> None:
    made = Fence(1, Timing())
    for robot in range(1000):
        made.note(beacon(robot + 2, Phase.IN, robot))
        made.note(beacon(robot + 2000, Phase.OUT, robot))
    assert len(made.records) <= 128
    assert len(made.finished) <= 128


def test_silence_does_not_end_the_passage_of_a_robot_that_stands_inside() -> None:
    made = fence(beacon(2, Phase.IN, 1000))
    made.stands_inside = lambda _group, robot: robot == 2
    for direction in (0, 1):
        assert not made.judge(ms(60_000), claim(60_000, direction)).open
    assert made.inside(ms(60_000))
    made.stands_inside = lambda _group, _robot: False
    for direction in (0, 1):
        assert made.judge(ms(60_000), claim(60_000, direction)).open
    assert not made.inside(ms(60_000))
