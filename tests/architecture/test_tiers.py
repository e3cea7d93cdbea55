"""The tiers of tests lose nothing: each test belongs to one, and `make test` and `make test-slow` are all of them."""

import re
import subprocess
import sys

import pytest
from source_tree import ROOT
from tiers import TIERS_OF

MAKEFILE = (ROOT / "Makefile").read_text()
EXPRESSIONS = {
    "test": "not slow",
    "test-fast": "fast",
    "test-slow": "slow",
}
REAL = ["tests/integration/test_up.py", "tests/fuzz", "tests/sim/test_sweep_kept.py"]
"""What `make test` must have a part of: a run of processes, the fuzzers, the seeds that once failed."""


def collected(*arguments: str) -> list[str]:
    """Return the node ids that pytest collects."""
    words = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", *arguments]
    answer = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert answer.returncode in (0, 5), answer.stdout + answer.stderr
    return [line for line in answer.stdout.splitlines() if "::" in line]


def test_each_collected_test_belongs_to_exactly_one_tier(request: pytest.FixtureRequest) -> None:
    tiers_of = request.config.stash[TIERS_OF]
    assert request.node.nodeid in tiers_of
    assert {name: tiers for name, tiers in tiers_of.items() if len(tiers) != 1} == {}


@pytest.mark.parametrize(("target", "expression"), EXPRESSIONS.items())
def test_a_target_of_make_selects_its_tier(target: str, expression: str) -> None:
    recipe = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", MAKEFILE, flags=re.MULTILINE)
    assert recipe is not None
    assert re.findall(r"\t\$\(PARTS\) (.+)\n", recipe[1]) in ([expression], [f'"{expression}"'])


def test_make_test_all_is_make_test_and_make_test_slow() -> None:
    recipe = re.search(r"^test-all:.*\n((?:\t.*\n)+)", MAKEFILE, flags=re.MULTILINE)
    assert recipe is not None
    assert recipe[1].split() == ["$(MAKE)", "test", "$(MAKE)", "test-slow"]
    commands = [line for line in (ROOT / ".ci" / "run").read_text().splitlines() if line.startswith("make ")]
    assert commands == ["make test", "make test-slow", "make lint", "make site", "make sbom", "make score-ci"]


@pytest.mark.slow
def test_make_test_has_real_processes_fuzzers_and_kept_seeds_and_the_tiers_sum_to_all() -> None:
    runs = {expression: collected("-m", expression, *REAL) for expression in ("fast", "medium", "slow", "not slow")}
    assert all(any(name.startswith(place) for name in runs["not slow"]) for place in REAL)
    assert sorted([*runs["not slow"], *runs["slow"]]) == sorted(collected(*REAL))
    assert sorted([*runs["fast"], *runs["medium"]]) == sorted(runs["not slow"])
