"""Seeds that once failed (kept.toml) do not fail again: every third one in `make test`, the rest in the slow tier."""

import tomllib
from math import inf
from pathlib import Path

import pytest

from rmr_sim.run_setup import Options, load
from rmr_sim.seed_run import reasons, run_seed

HERE = Path(__file__).parent
LABS = HERE.parents[1] / "deploy" / "labs"
KEPT = tomllib.loads((HERE / "kept.toml").read_text())["kept"]
TIERS = (pytest.mark.medium, pytest.mark.slow, pytest.mark.slow)


@pytest.mark.parametrize(
    "kept",
    [
        pytest.param(kept, id=f"{kept['lab']}-{kept['seed']}", marks=TIERS[number % len(TIERS)])
        for number, kept in enumerate(KEPT)
    ],
)
def test_a_seed_that_once_failed_does_not_fail_again(kept):
    assert kept["was"], "it is told what was wrong"
    result = run_seed(load(LABS / kept["lab"], Options(**kept["options"])), kept["seed"])
    assert reasons(result.row) == [], result.breakdown
    assert result.row["time_s"] <= kept.get("within_s", inf)
