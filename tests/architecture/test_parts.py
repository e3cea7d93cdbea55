"""Deterministic tests need nothing but the sources, and a real test that fails runs once more, which is told."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from parts import REAL_FOLDERS, REAL_MODULES, TESTS
from source_tree import ROOT

pytestmark = pytest.mark.medium

CONFTEST = """import parts
def pytest_configure(config):
    config.pluginmanager.register(parts)
"""
FLAKY = """import pytest
from pathlib import Path
@pytest.mark.real
def test_flaky():
    once = Path(__file__).with_name("once")
    if not once.exists():
        once.touch()
        raise AssertionError("the first time")
def test_sound():
    pass
"""


def run(folder: Path, test: str, words: str) -> subprocess.CompletedProcess[str]:
    """Run a file of tests as `words` say, with results in `folder`."""
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers =\n    real\n    slow\n")
    (folder / "test_here.py").write_text(test)
    here = f"run_parts.ROOT = run_parts.RESULTS = Path({str(folder)!r})"
    code = f"import sys, run_parts; from pathlib import Path; {here}; {words}"
    environment = {**os.environ, "PYTHONPATH": str(TESTS)}
    command = [sys.executable, "-c", code, "not slow", "-n0", "-p", "no:cacheprovider"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


CLOCKS = re.compile(r"\btime[.](sleep|time|monotonic|perf_counter|process_time)|import threading")
PARTS = "sys.exit(run_parts.main(sys.argv[1:]))"


@pytest.mark.parametrize(
    ("what", "does"),
    [
        ("import subprocess; subprocess.run(['true'])", "starts a process"),
        ("import multiprocessing; p = multiprocessing.Process(target=print); p.start(); p.join()", "starts a process"),
        ("import socket; socket.socket().bind(('127.0.0.1', 0))", "opens a socket"),
    ],
)
def test_a_deterministic_test_that_needs_the_machine_fails_and_a_real_one_does_not(tmp_path, what, does):
    body = f"import pytest\ndef test_a():\n    {what}\n@pytest.mark.real\ndef test_b():\n    {what}\n"
    answer = run(tmp_path, body, PARTS)
    assert f"it {does}: mark it real" in answer.stdout
    assert "deterministic tests: FAILED" in answer.stdout
    assert "real tests: passed" in answer.stdout
    assert answer.returncode == 1


def test_a_real_test_that_fails_once_is_counted_and_passes(tmp_path):
    answer = run(tmp_path, FLAKY, PARTS)
    assert answer.returncode == 0, answer.stdout
    assert "1 run once more, 1 of them passed the second time" in answer.stdout
    assert "test_here.py::test_flaky\n" in answer.stdout
    assert '"outcome": "failed"' in (tmp_path / "real-not-slow.jsonl").read_text()


def test_a_real_test_that_fails_twice_is_red(tmp_path):
    answer = run(tmp_path, FLAKY.replace("once.touch()", "pass"), PARTS)
    assert answer.returncode == 1
    assert "1 run once more, 0 of them passed the second time" in answer.stdout
    assert "real tests: FAILED" in answer.stdout


def test_a_deterministic_test_that_fails_is_not_run_again(tmp_path):
    answer = run(tmp_path, FLAKY.replace("@pytest.mark.real\n", ""), PARTS)
    assert answer.returncode == 1
    assert "once more" not in answer.stdout


def test_where_more_fail_than_a_busy_machine_explains_none_is_run_again(tmp_path):
    answer = run(tmp_path, FLAKY, "run_parts.RERUNS_MAX = 0; " + PARTS)
    assert answer.returncode == 1
    assert "once more" not in answer.stdout


def test_a_test_that_its_dead_worker_has_not_ended_is_not_taken_for_passed(tmp_path):
    dies = "import os, pytest\n@pytest.mark.real\ndef test_dies():\n    os._exit(1)\n"
    words = "sys.argv[2] = '-n1'; sys.argv.append('--max-worker-restart=0'); " + PARTS
    answer = run(tmp_path, dies, words)
    assert answer.returncode != 0
    assert "real tests: FAILED" in answer.stdout


def test_each_listed_module_is_there():
    assert [module for module in sorted(REAL_MODULES) if not (ROOT / "tests" / module).is_file()] == []


def test_no_deterministic_module_names_a_clock_or_a_thread():
    places = [path.relative_to(TESTS) for path in TESTS.rglob("test_*.py")]
    known = [each for each in places if each.parts[0] not in REAL_FOLDERS and each.as_posix() not in REAL_MODULES]
    assert len(known) > 100
    assert [each.as_posix() for each in known if CLOCKS.search((TESTS / each).read_text())] == []
