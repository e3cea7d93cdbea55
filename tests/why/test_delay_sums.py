"""The intervals of an explained delay sum exactly to the job's time, whatever happened in the run."""

import pytest
from delay_runs import LABS, RUSH, check_run, recorded

LAB_RUNS = [(lab, seed) for lab in ("corridor", "twoway", "testbed", "formation") for seed in range(201, 206)]


KINDS = ((), ("--loss", "0.6"), ("--chaos",))
"""Of three seeds one runs as the lab file says, one loses most frames, one has drawn faults: so more are missed."""


def rush(folder, seed, *words):
    return check_run(folder / str(seed), recorded(RUSH, folder / str(seed), "--seed", str(seed), *words))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 7))
def test_intervals_of_deadlines_of_which_not_all_can_be_met_sum_exactly(tmp_path, seed):
    rush(tmp_path, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_intervals_sum_exactly_under_faults_and_restarts(tmp_path, seed):
    rush(tmp_path, seed, "--chaos")


@pytest.mark.slow
@pytest.mark.parametrize("lab", ["corridor", "twoway", "formation"])
def test_intervals_sum_exactly_in_the_provided_labs_under_faults(tmp_path, lab):
    check_run(tmp_path / "run", recorded(LABS / lab, tmp_path / "run", "--seed", "1", "--chaos"))


@pytest.mark.medium
def test_intervals_of_deadlines_missed_over_a_lossy_radio_sum_exactly(tmp_path):
    assert sum(rush(tmp_path, 1003, "--loss", "0.5").values()) > 0, "no deadline was missed"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1001, 1201))
def test_intervals_of_two_hundred_runs_of_the_rush_sum_exactly(tmp_path, seed):
    rush(tmp_path, seed, *KINDS[seed % 3])


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("lab", "seed"), [*LAB_RUNS, ("hall", 201)])
def test_intervals_sum_exactly_in_all_provided_labs_under_faults(tmp_path, lab, seed):
    check_run(tmp_path / "run", recorded(LABS / lab, tmp_path / "run", "--seed", str(seed), "--chaos"))
