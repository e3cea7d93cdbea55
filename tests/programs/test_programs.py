"""Every program of the library and every example does what its own comments say."""

import json
import shlex
from pathlib import Path

import pytest
from command_runner import Result, invoke
from expectations import diagnostics_of, holds, is_like, runs_of, split

from rmr.commands.subcommands import command as main

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "docs" / "examples"
PROGRAMS = sorted([*HERE.rglob("*.rmr"), *EXAMPLES.glob("*.rmr")])
RUNS = [(path, run) for path in PROGRAMS for run in runs_of(path)]
LONG_RUNS = frozenset({"--robots 9 --loss 0.4 --seed 5"})
"""Arguments of runs that take seconds."""


def call(*arguments: str) -> Result:
    result = invoke(main, arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.name)
def test_check_reports_what_the_program_says(path: Path) -> None:
    found = json.loads(call("check", "--json", str(path)).stdout)["diagnostics"]
    assert sorted((each["code"], each["line"]) for each in found) == diagnostics_of(path)


@pytest.mark.parametrize(
    ("path", "run"),
    [
        pytest.param(
            path, run, id=f"{path.name} {run.arguments}", marks=[pytest.mark.slow] * (run.arguments in LONG_RUNS)
        )
        for path, run in RUNS
    ],
)
def test_a_run_is_what_the_program_says(path: Path, run, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run.claims, "a run of which nothing is said"
    monkeypatch.chdir(path.parent)
    result = call("eval", path.name, *shlex.split(run.arguments))
    assert result.exit_code == 0, result.stderr
    report = json.loads(result.stdout)
    assert [f"{claim}: {why}" for claim in run.claims if (why := holds(claim, report, result.stderr))] == []


def test_every_example_is_run() -> None:
    assert {path for path, _ in RUNS} >= {path for path in EXAMPLES.glob("*.rmr") if "values" not in path.name}


def test_the_index_lists_every_example() -> None:
    index = (EXAMPLES / "README.md").read_text("utf-8")
    assert [path.name for path in sorted(EXAMPLES.glob("*.rmr")) if f"({path.name})" not in index] == []


def test_claims_are_no_formality() -> None:
    report = {"quiescent": True, "firings": 1, "robots": {"1": {"facts": ['a(@1, "x, y")'], "actions": []}}}
    assert holds(("has", None, 'a(@1, "x, y")'), report, "") is None
    assert holds(("lacks", None, "a(_, _)"), report, "") is not None
    assert holds(("has", None, "a(@1)"), report, "") is not None
    assert holds(("facts", "1", ""), report, "") is not None
    assert holds(("not quiescent", None, ""), report, "") is not None
    assert split("a(@1, [1, 2]), b") == ["a(@1, [1, 2])", "b"]
    assert not is_like("a(@1, 2)", "a(@1, 3)")
