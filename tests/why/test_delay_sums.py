"""The intervals of an explained delay sum exactly to the job's time, whatever happened in the run."""

import pytest
from delay_campaign import check_drawn, check_lab, checked

LAB_RUNS = [(lab, seed) for lab in ("corridor", "twoway", "testbed", "formation") for seed in range(201, 206)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 7))
def test_intervals_of_deadlines_of_which_not_all_can_be_met_sum_exactly(tmp_path, seed):
    checked(tmp_path, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_intervals_sum_exactly_under_faults_and_restarts(tmp_path, seed):
    checked(tmp_path, seed, "--chaos")


@pytest.mark.slow
@pytest.mark.parametrize("lab", ["corridor", "twoway", "formation"])
def test_intervals_sum_exactly_in_the_provided_labs_under_faults(tmp_path, lab):
    check_lab(tmp_path, lab, 1)


@pytest.mark.medium
def test_intervals_of_deadlines_missed_over_a_lossy_radio_sum_exactly(tmp_path):
    assert sum(checked(tmp_path, 1003, "--loss", "0.5").values()) > 0, "no deadline was missed"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1001, 1041))
def test_intervals_of_forty_runs_of_the_rush_sum_exactly(tmp_path, seed):
    check_drawn(tmp_path, seed)


@pytest.mark.slow
@pytest.mark.parametrize(("lab", "seed"), LAB_RUNS)
def test_intervals_sum_exactly_in_all_provided_labs_under_faults(tmp_path, lab, seed):
    check_lab(tmp_path, lab, seed)


@pytest.mark.slow
def test_intervals_of_twenty_robots_in_the_hall_sum_exactly(tmp_path):
    check_lab(tmp_path, "hall", 201, "--robots", "20")
