"""Runs tests in two parts: `python tests/run_parts.py EXPRESSION`, as `make test` and `make test-slow` do.

First the deterministic tests of the marker expression, then the real ones (`tests/parts.py`). A real test that fails is
run once more, by itself; how many were is printed, and one that fails twice is red. A deterministic test is not: it
would fail again. What came of each test and its seconds stand in build/tests afterwards, a file for each part.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from parts import LOST, TIMES

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "build" / "tests"
# A worker that dies ends the run with the tests so far: with another one in its place some runs never end.
WORKERS = ("-n", "auto", "--dist", "worksteal", "--max-worker-restart=0")
RERUNS_MAX = 10
"""With more failures it is not the machine."""
LONGEST = 10
FAILED, NO_TESTS = 1, 5
"""Exit codes of pytest."""


def run_pytest(times: Path, *words: str) -> tuple[int, list[dict[str, Any]]]:
    """Run pytest; return its exit code and what came of each test."""
    times.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", *words]
    code = subprocess.run(command, cwd=ROOT, env={**os.environ, TIMES: str(times)}, check=False).returncode
    return code, [json.loads(line) for line in times.read_text().splitlines()] if times.exists() else []


def run_again(name: str, failed: list[str]) -> int:
    """Run tests once more, one after the other; return the exit code of pytest."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write("\n".join(failed))
        file.flush()
        code, tests = run_pytest(RESULTS / f"{name}-again.jsonl", f"@{file.name}")
    passed = sum(test["outcome"] in ("passed", "skipped") for test in tests)
    print(f"{name}: {len(failed)} run once more, {passed} of them passed the second time", flush=True)
    for test in failed:
        print(f"  run once more: {test}", flush=True)
    return code if passed == len(failed) else code or FAILED


def run_part(name: str, expression: str, words: list[str]) -> int:
    """Run one part; return the exit code."""
    code, tests = run_pytest(RESULTS / f"{name}.jsonl", "-m", expression, *words)
    for test in sorted(tests, key=lambda test: -test["s"])[:LONGEST]:
        print(f"{name}: {test['s']:7.1f} s  {test['test']}", flush=True)
    failed = [test["test"] for test in tests if test["outcome"] in ("failed", LOST)]
    if name.startswith("real") and code == FAILED and 0 < len(failed) <= RERUNS_MAX:
        return run_again(name, failed)
    return 0 if code == NO_TESTS else code


def main(words: list[str]) -> int:
    """Run both parts, and tell of each."""
    expression, *rest = words
    rest = rest or list(WORKERS)
    tier = expression.replace(" ", "-")
    codes = {
        name: run_part(f"{name}-{tier}", f"({expression}) and {selection}", rest)
        for name, selection in (("deterministic", "not real"), ("real", "real"))
    }
    for name, code in codes.items():
        print(f"{name} tests: {'passed' if code == 0 else f'FAILED (exit code {code} of pytest)'}")
    return next((code for code in codes.values() if code), 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
