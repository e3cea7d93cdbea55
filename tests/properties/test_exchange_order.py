"""Deliveries from one robot to another: in order, once and completely, whatever the network and restarts do."""

import pytest
from exchange_campaign import History
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_deliveries_take_effect_in_order_once_and_completely(seed, restarts):
    assert History(seed, restarts).run() == []


def test_what_was_sent_in_the_instant_in_which_its_receiver_died_is_taken_once():
    assert History(10_356).run() == []


@pytest.mark.parametrize("seed", [136, 58])
def test_a_receiver_that_hears_no_answer_releases_only_what_waited_long_enough(seed):
    assert History(seed).run() == []
