"""Ensemble rules: no fact used twice and no firing half, whatever the air loses and whoever crashes."""

import pytest
from ensemble_campaign import PROGRAMS, History, LoadHistory
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.vm.engines import Engine


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(PROGRAMS), st.sampled_from(list(Engine)))
def test_no_fact_is_used_twice_and_no_firing_is_half(seed, text, engine):
    assert History(seed, text, engine).run() == []


@pytest.mark.parametrize("place", range(len(PROGRAMS)))
def test_both_engines_have_the_same_history(place):
    for seed in range(4 if place < 4 else 1):
        one, other = (History(seed, PROGRAMS[place], engine) for engine in Engine)
        assert one.run() == other.run() == []
        assert (one.seen, one.frames) == (other.seen, other.frames)


@pytest.mark.parametrize("seed", [0, 14, 20])
def test_an_offer_to_two_lives_of_a_robot_is_settled(seed):
    assert [History(seed, text).run() for text in PROGRAMS] == [[]] * len(PROGRAMS)


def test_the_checker_sees_a_fact_that_is_used_twice_and_one_that_is_gone():
    history = History(3, PROGRAMS[0], crashes=False)
    history.loss = 0.0
    assert history.run() == []
    robot, life, (x, y) = history.seen["got"][0]
    history.seen["got"].append((robot, life, (x, y + 1 if y + 1 in history.tokens else y - 1)))
    assert any("was used 2 times" in each for each in history.problems())
    history.seen["got"].clear()
    assert any("has no part" in each for each in history.problems())


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(list(Engine)))
def test_across_switches_of_programs_no_fact_is_used_twice_and_no_firing_is_half(seed, engine):
    assert LoadHistory(seed, engine=engine).run() == []


@pytest.mark.parametrize("seed", [24, 10, 108, 53, 23, 264, 483, 928, 1198, 1452, 2079, 2667, 5157, 5547])
def test_an_offer_in_doubt_at_a_switch_is_settled(seed):
    """Each of them failed without a part of it: settling, the answer for a next life, the question, the way back."""
    assert LoadHistory(seed).run() == []


def test_both_engines_have_the_same_history_with_switches():
    for seed in range(6):
        one, other = (LoadHistory(seed, engine=engine) for engine in Engine)
        assert one.run() == other.run() == []
        assert (one.seen, one.frames) == (other.seen, other.frames)
