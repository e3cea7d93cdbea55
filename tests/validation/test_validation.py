"""The radio against ns-3's results, in a short version: a few rows at fixed seeds, and what is exact as a whole.

The full version is `make validate-radio`; its verdicts stand in docs/radio-validation.md.
"""

from pathlib import Path

import mutations
import pytest
import reduced
from experiments import SHORT
from verdicts import MISSED, SHOWN

pytestmark = pytest.mark.medium

RADIO = Path(__file__).parents[2] / "rmr" / "radio"

BROKEN = {
    "bit error rate: twice as high": ("per_vs_snr", "capture_overlap"),
    "synchronisation header left out of the bits that can be wrong": ("per_vs_snr", "psr_vs_distance"),
    "path loss: exponent 10 % less": ("psr_vs_distance",),
    "noise the same for every sensitivity": ("psr_vs_distance",),
    "no lock: every frame is received by itself": ("capture_overlap", "capture_3db"),
    "interference ignored": ("capture_overlap",),
    "half duplex: a station hears while it transmits": ("capture_3db",),
    "length of the assessment: 2 * SYMBOL instead of 8 * SYMBOL": ("constants",),
    "macMinBE: 2 instead of 3": ("constants", "latency_single_hop"),
    "macMaxCSMABackoffs: 3 instead of 4": ("constants",),
    "wait for the acknowledgement: 300 * NS_PER_US instead of 864 * NS_PER_US": ("constants",),
    "no acknowledgement is heeded": ("latency_single_hop",),
    "storm: replies do not wait at random": ("reply_storm",),
    "capture_3db: only the strongest interferer counts": ("capture_3db",),
}
"""Broken rule -> the families that have to notice."""


@pytest.mark.parametrize("family", reduced.FAMILIES)
def test_every_check_of_a_family_is_met(family: str) -> None:
    checks = list(reduced.FAMILIES[family]())
    assert sum(check.verdict != SHOWN for check in checks) > 0
    assert [check.name for check in checks if check.verdict == MISSED] == []


@pytest.mark.parametrize("rule", BROKEN)
def test_a_family_notices_when_a_rule_is_broken(rule: str) -> None:
    families = BROKEN[rule]
    assert [family for family in families if not mutations.noticed(rule, [family])] == []


def test_every_mutation_still_finds_what_it_breaks() -> None:
    for mutation in mutations.MUTATIONS:
        for edit in mutation.edits:
            place = RADIO / edit.module.replace(".", "/")
            file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
            assert file.read_text("utf-8").count(edit.old) == edit.times, (mutation.rule, edit.old)
        assert set(mutation.families) <= set(reduced.FAMILIES), mutation.rule


def test_a_broken_radio_is_whole_again_afterwards() -> None:
    import rmr.radio.phy as before

    with mutations.broken(mutations.MUTATIONS[0]):
        import rmr.radio.phy as within

        assert within.BER_TERMS != before.BER_TERMS
    import rmr.radio.phy as after

    assert after is before


def test_the_short_version_has_ten_replications_of_each_row() -> None:
    assert SHORT.seeds >= 10
    assert min(SHORT.storms, SHORT.frames) >= 10
