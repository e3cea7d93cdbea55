"""Verdicts are made of differences and tolerances, and a comparison that is no number is none."""

from math import inf, nan

import curves
import judged
import pytest
from reference import FILES, FOLDER, load, rows
from verdicts import MET, MISSED, SHOWN, Check, Estimate, compared, equal, estimate, proportion, tally

WHERE = ("file", "row", "quantity")


@pytest.mark.parametrize(
    ("ours", "verdict"), [(0.51, MET), (0.49, MET), (0.4899, MISSED), (0.5101, MISSED), (nan, MISSED), (inf, MISSED)]
)
def test_a_check_is_met_up_to_the_tolerance_and_no_further(ours: float, verdict: str) -> None:
    assert compared(WHERE, Estimate(ours), Estimate(0.5), 0.01).verdict == verdict


def test_intervals_help_a_short_comparison_only() -> None:
    ours, theirs = Estimate(0.60, 0.04), Estimate(0.50, 0.03)
    assert compared(WHERE, ours, theirs, 0.01).verdict == MISSED
    assert compared(WHERE, ours, theirs, 0.01, slack=True).verdict == MET
    assert compared(WHERE, Estimate(0.62, 0.04), theirs, 0.01, slack=True).verdict == MISSED


def test_what_is_no_number_has_to_be_equal() -> None:
    assert equal(WHERE, [320, 640], [320, 640]).verdict == MET
    assert equal(WHERE, [320], [320, 640]).verdict == MISSED
    assert equal(WHERE, "not looked at", "3").verdict == MISSED


def test_without_a_tolerance_a_check_is_only_shown() -> None:
    check = compared(WHERE, Estimate(1.0), Estimate(9.0), None, "over capacity")
    assert check.verdict == SHOWN
    assert check.as_data()["unjudged"] == "over capacity"


def test_an_interval_is_narrow_if_it_is_half_the_tolerance() -> None:
    assert compared(WHERE, Estimate(0.5, 0.005), Estimate(0.5), 0.01).narrow
    assert not compared(WHERE, Estimate(0.5, 0.006), Estimate(0.5), 0.01).narrow


def test_means_and_shares_of_the_reference_are_read_alike() -> None:
    assert estimate({"mean": 2.0, "ci95": [1.5, 2.5], "n_reps": 10}) == Estimate(2.0, 0.5)
    assert estimate({"p": 0.5, "ci95": [0.25, 0.75], "k": 5, "n": 10}) == Estimate(0.5, 0.25)
    assert proportion(0, 10).half > 0.1


def test_a_tally_counts_each_file() -> None:
    checks = [equal(("a", "", ""), 1, 1), equal(("a", "", ""), 1, 2), Check("b", "", "", 1, 2)]
    assert tally(checks) == [("a", 1, 1, 0), ("b", 0, 0, 1)]


def test_a_count_is_an_outlier_when_chance_makes_it_once_in_ten_thousand_times() -> None:
    assert curves.likely(0.5, 0.54, 2000)
    assert not curves.likely(0.5, 0.55, 2000)
    assert curves.likely(1e-5, 1 / 2000, 2000)
    assert not curves.likely(1e-6, 3 / 2000, 2000)
    assert curves.likely(1.0, 1.0, 2000)
    assert not curves.likely(1.0, 0.99, 2000)


def test_uncertain_rows_are_judged_together() -> None:
    def off(deviations: float) -> Check:
        return compared(WHERE, Estimate(0.5 + deviations * 0.1, 0.0), Estimate(0.5, 0.196), None, judged.BLURRED)

    assert judged.together([off(1.0)] * 20, "file").verdict == MET
    assert judged.together([off(0.1)] * 20, "file").verdict == MET
    assert judged.together([off(2.0)] * 20, "file").verdict == MISSED


def test_the_reference_is_whole() -> None:
    assert sorted(file.stem for file in FOLDER.glob("*.json")) == sorted(FILES)
    sizes = {"per_vs_snr": 481, "contention": 40, "hidden_terminal": 30, "reply_storm": 66, "latency_single_hop": 6}
    assert {file: len(rows(file)) for file in sizes} == sizes
    assert "ns-3.44" in load("contention")["source"]
