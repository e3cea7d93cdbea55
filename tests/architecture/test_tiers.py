"""The tiers of tests lose nothing: each test belongs to one, and `make test` and `make test-slow` are all of them."""

import os
import re
import subprocess
import sys
from pathlib import Path

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
    assert re.findall(r'-m (?:"([^"]+)"|(?!pytest)(\w+))', recipe[1]) in ([(expression, "")], [("", expression)])


def test_make_test_all_is_make_test_and_make_test_slow() -> None:
    recipe = re.search(r"^test-all:.*\n((?:\t.*\n)+)", MAKEFILE, flags=re.MULTILINE)
    assert recipe is not None
    assert recipe[1].split() == ["$(MAKE)", "test", "$(MAKE)", "test-slow"]
    assert "make test-all" in (ROOT / ".ci" / "run").read_text()


@pytest.mark.slow
def test_make_test_has_real_processes_fuzzers_and_kept_seeds_and_the_tiers_sum_to_all() -> None:
    runs = {expression: collected("-m", expression, *REAL) for expression in ("fast", "medium", "slow", "not slow")}
    assert all(any(name.startswith(place) for name in runs["not slow"]) for place in REAL)
    assert sorted([*runs["not slow"], *runs["slow"]]) == sorted(collected(*REAL))
    assert sorted([*runs["fast"], *runs["medium"]]) == sorted(runs["not slow"])


@pytest.mark.medium
def test_a_fast_test_that_takes_long_fails_and_one_marked_medium_does_not(tmp_path: Path) -> None:
    conftest = ["import tiers", "tiers.FAST_CPU_S = 0.01", "def pytest_configure(config):"]
    (tmp_path / "conftest.py").write_text("\n".join([*conftest, "    config.pluginmanager.register(tiers)"]))
    work = "sum(range(3_000_000))"
    tests = ["import pytest", f"def test_a(): {work}", "@pytest.mark.medium", f"def test_b(): {work}"]
    (tmp_path / "test_here.py").write_text("\n".join(tests))
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests")}
    answer = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert "mark it medium" in answer.stdout
    assert "1 failed, 1 passed" in answer.stdout
