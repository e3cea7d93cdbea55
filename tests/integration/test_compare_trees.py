"""`compare_trees.py` finds two equal trees equal, and names what differs where a change of one shows in a run."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from compare_trees import HERE, PACKAGES

BRAKES = "ACT_REFRESH: Final[Duration] = milliseconds(33)"


def compared(tree: Path, *words: str) -> tuple[int, str]:
    command = [sys.executable, str(HERE / "tests" / "compare_trees.py"), str(tree), *words]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    return answer.returncode, answer.stdout + answer.stderr


@pytest.fixture
def other(tmp_path: Path) -> Path:
    for package in ("rmr", *PACKAGES[1:]):
        shutil.copytree(HERE / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_a_copy_of_the_tree_is_equal_to_it_with_and_without_chaos(other: Path) -> None:
    code, told = compared(other, "--first", "2", "--runs", "2")
    assert code == 0, told
    assert [line.split(":")[1] for line in told.splitlines()[:2]] == [" equal", " equal"]


def test_a_seeded_difference_is_found_and_named(other: Path) -> None:
    driver = other / "rmr" / "node" / "driver.py"
    assert BRAKES in driver.read_text()
    driver.write_text(driver.read_text().replace(BRAKES, BRAKES.replace("33", "66")))
    code, told = compared(other, "--first", "2", "--runs", "1")
    assert code == 1
    assert "DIFFERS" in told
    assert "minds.txt: line " in told


def test_a_folder_that_is_no_tree_is_refused(tmp_path: Path) -> None:
    code, told = compared(tmp_path)
    assert code == 2
    assert "is no tree of RMR" in told
