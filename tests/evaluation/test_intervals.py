"""Intervals against what is known of them, and their coverage over draws of a known distribution."""

from random import Random

import pytest
from intervals import mean, percent, quantile, ranks, share, text


def test_the_interval_of_a_median_is_that_of_the_tables():
    # Ranks of the order statistics for the median, 95 %: Conover, Practical Nonparametric Statistics, table A3.
    assert [ranks(n, 0.5) for n in (6, 10, 20, 30)] == [(0, 5), (1, 8), (5, 14), (9, 20)]


def test_of_five_values_a_median_has_no_limits_and_of_few_a_p99_no_upper_one():
    assert ranks(5, 0.5) == (None, None)
    assert quantile(range(100), 0.99)["high"] is None
    assert quantile(range(1000), 0.99)["high"] is not None


@pytest.mark.parametrize("q", [0.5, 0.9])
def test_the_interval_of_a_quantile_holds_it_in_95_of_100_cases(q):
    rng, held = Random(1), 0
    for _ in range(400):
        found = quantile([rng.random() for _ in range(60)], q)
        held += found["low"] <= q <= found["high"]
    assert 0.93 <= held / 400 <= 0.995


def test_wilsons_interval_is_that_of_the_literature():
    found = share(81, 263)  # Newcombe 1998, "Two-sided confidence intervals for the single proportion", table I
    assert (round(found["low"], 4), round(found["high"], 4)) == (0.2553, 0.3662)
    found = share(0, 20)
    assert (found["low"], round(found["high"], 4)) == (0.0, 0.1611)


def test_the_bootstrap_gives_the_same_interval_again_and_holds_the_mean():
    values = [float(value) for value in range(50)]
    assert mean(values) == mean(values)
    assert mean(values)["low"] < 24.5 < mean(values)["high"]


def test_a_limit_that_does_not_exist_is_a_dash():
    assert text(quantile([1.0, 2.0, 3.0], 0.5)) == "2.00 (- to -)"
    assert percent(share(3, 3)) == "100.0 % (43.9 to 100.0)"
