"""Means, shares and percentiles, and the intervals around them."""

import pytest

from rmr.radio.trials.statistics import (
    mean,
    over_few,
    over_many,
    percentile,
    ratio,
    share,
    student_quantile,
    wilson,
)


@pytest.mark.parametrize(
    ("freedom", "quantile"),
    [(1, 12.7062), (2, 4.3027), (3, 3.1824), (4, 2.7764), (9, 2.2622), (10, 2.2281), (30, 2.0423), (99, 1.9842)],
)
def test_students_quantiles_are_those_of_the_tables(freedom: int, quantile: float) -> None:
    assert student_quantile(freedom) == pytest.approx(quantile, abs=5e-5)


@pytest.mark.parametrize(
    ("successes", "trials", "interval"),
    [(172, 400, [0.382375, 0.478957]), (0, 400, [0.0, 0.009513]), (2000, 2000, [0.998083, 1.0])],
)
def test_wilsons_intervals_are_those_of_the_reference(successes: int, trials: int, interval: list[float]) -> None:
    assert wilson(successes, trials) == pytest.approx(interval, abs=1e-6)


def test_interval_of_no_trials_spans_everything() -> None:
    assert share(0, 0) == {"p": 0.0, "ci95": [0.0, 1.0], "k": 0, "n": 0}


def test_few_replications_have_a_wider_interval_than_many() -> None:
    # The mean of 1, 2, 3 is 2 and its standard error 1 / sqrt(3).
    few, many = over_few([1.0, 2.0, 3.0]), over_many([1.0, 2.0, 3.0])
    assert few["mean"] == many["mean"] == 2.0
    assert few["n_reps"] == 3
    assert few["ci95"][1] - 2.0 == pytest.approx(4.3027 / 3**0.5, abs=1e-4)
    assert many["ci95"][1] - 2.0 == pytest.approx(1.96 / 3**0.5, abs=1e-4)


def test_a_single_replication_has_no_interval() -> None:
    assert over_few([0.25]) == over_many([0.25]) == {"mean": 0.25, "ci95": None, "n_reps": 1}


def test_percentile_is_the_value_that_its_share_of_samples_does_not_exceed() -> None:
    values = [float(value) for value in range(1, 101)]
    assert percentile(values, 0.95) == 95.0
    assert percentile(values[::-1], 0.5) == 50.0
    assert percentile([7.0], 0.99) == 7.0


def test_statistics_of_no_samples_are_zero() -> None:
    assert mean([]) == ratio(0, 0) == percentile([], 0.5) == 0.0
