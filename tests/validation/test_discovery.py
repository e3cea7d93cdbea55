"""One announcement, many answers: over the radio model nearly all of them arrive, because they are spread."""

import pytest
from coordination import DISCOVERY, Row, discovery, rounds

from rmr.coord.timing import ElectionTiming, Timing

ENOUGH = 0.95
SEEDS = {5: range(10), 10: range(10), 50: range(3)}


def found(members: int, interference: str = "capture_3db", timing: Timing | None = None) -> Row:
    return discovery(members, SEEDS[members], interference, timing=timing)


@pytest.mark.parametrize("interference", ["capture_3db", "awgn"])
@pytest.mark.parametrize("members", DISCOVERY)
def test_one_round_of_discovery_brings_in_19_of_20_answers(members: int, interference: str) -> None:
    row = found(members, interference)
    assert row["heard"]["mean"] == 1.0
    assert row["first"]["mean"] >= ENOUGH, "before anybody has repeated its answer"
    assert row["answered"]["mean"] >= ENOUGH
    assert row["worst"] >= ENOUGH


@pytest.mark.parametrize("members", [10, 50])
def test_without_the_spread_the_first_answers_of_many_are_lost(members: int) -> None:
    row = found(members, timing=Timing(election=ElectionTiming(reply_spread=0)))
    assert row["heard"]["mean"] == 1.0
    assert row["first"]["mean"] < ENOUGH


def test_without_the_spread_a_round_of_50_fails() -> None:
    row = found(50, timing=Timing(election=ElectionTiming(reply_spread=0)))
    assert row["answered"]["mean"] < ENOUGH


def test_who_lost_its_answer_repeats_it_after_a_back_off_within_the_round() -> None:
    row = found(50, timing=Timing(election=ElectionTiming(reply_spread=Timing().election.reply_spread // 4)))
    assert row["first"]["mean"] < 0.8
    assert row["answered"]["mean"] > row["first"]["mean"] + 0.1


@pytest.mark.medium
def test_a_scheduling_round_of_ten_takes_half_a_second_and_a_few_dozen_frames() -> None:
    row = rounds(10, range(4), "capture_3db")
    assert row["slotted"] == row["seeds"] == 4
    assert row["round_ms"]["median"] < 600
    assert 20 <= row["round"]["frames"]["mean"] <= 40
    kinds = row["round"]["by_kind"].values()
    assert sum(kind["octets"]["mean"] for kind in kinds) == pytest.approx(row["round"]["octets"]["mean"])
    assert row["waiting"]["by_kind"]["SCHED"]["frames"]["mean"] == pytest.approx(4, abs=0.5), "every 250 ms"
    assert row["waiting"]["by_kind"]["BEACON"]["frames"]["mean"] == 0
    assert row["passing"]["by_kind"]["BEACON"]["frames"]["mean"] > 10
