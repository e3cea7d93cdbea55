"""Drawn labs that once failed (kept_drawn.toml): the same lab is still drawn, and it does not fail again."""

import tomllib
from pathlib import Path

import pytest
from drawn_lab import draw_lab
from score_campaign import symptoms
from score_run import drawn_entry, taken

FILE = Path(__file__).parents[2] / "score" / "kept_drawn.toml"
KEPT = tomllib.loads(FILE.read_text())["kept"]


def cases():
    for kept in KEPT:
        broken = [pytest.mark.xfail(reason=kept["cause"], strict=True)] if "fails" in kept else []
        tier = pytest.mark.medium if kept.get("short") else pytest.mark.slow
        name = f"{kept['seed']}{'-chaos' if kept.get('chaos') else ''}"
        yield pytest.param(kept, id=name, marks=[*broken, tier])


@pytest.mark.parametrize("kept", list(cases()))
def test_a_drawn_lab_that_once_failed_does_not_fail_again(kept):
    assert symptoms(taken(drawn_entry(kept["seed"], chaos=kept.get("chaos", False)))) == []


@pytest.mark.parametrize("kept", KEPT, ids=lambda kept: str(kept["seed"]))
def test_a_kept_seed_has_a_cause_and_still_draws_the_lab_that_failed(kept):
    assert len(kept["cause"]) > 30
    assert draw_lab(kept["seed"]).digest == kept["digest"], "keep a seed that draws such a lab now, for the same cause"
