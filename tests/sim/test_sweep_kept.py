"""Seeds that once failed (kept.toml) do not fail again."""

import tomllib
from pathlib import Path

import pytest

from rmr_sim.run_setup import Options, load
from rmr_sim.seed_run import reasons, run_seed

pytestmark = pytest.mark.medium

HERE = Path(__file__).parent
LABS = HERE.parents[1] / "deploy" / "labs"
KEPT = tomllib.loads((HERE / "kept.toml").read_text())["kept"]


@pytest.mark.parametrize("kept", KEPT, ids=lambda kept: f"{kept['lab']}-{kept['seed']}")
def test_a_seed_that_once_failed_does_not_fail_again(kept):
    assert kept["was"], "it is told what was wrong"
    result = run_seed(load(LABS / kept["lab"], Options(**kept["options"])), kept["seed"])
    assert reasons(result.row) == [], result.breakdown
