"""Property: the replay of any drawn simulated run with faults equals its log, with either engine."""

import pytest
from replay_campaign import check


@pytest.mark.parametrize("number", range(1))
def test_replay_of_a_drawn_run_with_faults_is_equal(number):
    check(number)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(1, 21))
def test_replay_of_many_drawn_runs_with_faults_is_equal(number):
    check(number)
