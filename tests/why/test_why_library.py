"""Provenance of every program of the library: the observed engine fires alike, and every tree ends in what is given."""

import json
import shlex
from pathlib import Path

import pytest
from command_runner import invoke
from observed_runs import evaluated
from provenance_trees import unexplained

from rmr.commands.subcommands import command as main

ROOT = Path(__file__).parents[2]
PROGRAMS = sorted([*(ROOT / "tests/programs").rglob("*.rmr"), *(ROOT / "docs/examples").glob("*.rmr")])
RUNS = [
    (path, line.removeprefix("// run:").strip())
    for path in PROGRAMS
    for line in path.read_text("utf-8").splitlines()
    if line.startswith("// run:")
]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "arguments"), RUNS, ids=lambda each: getattr(each, "stem", None))
def test_every_leaf_of_every_provenance_tree_is_given_outside_or_sensed(path, arguments, monkeypatch):
    if "columnar" in arguments:
        pytest.skip("robots in columns have no nodes")
    monkeypatch.chdir(path.parent)
    plain = invoke(main, ["eval", str(path), *shlex.split(arguments)]).stdout
    observed, report = evaluated(path, arguments, monkeypatch)
    assert json.loads(report) == json.loads(plain)
    past = observed.past
    items = [(mind, item) for robot in observed.robots for mind in past.minds(robot) for item in mind.items]
    assert [each for mind, item in items for each in unexplained(past, mind, item)] == []
    made = {hidden.predicate for hidden in past.program.ensemble}
    for number, predicate in enumerate(past.program.predicates):
        if number in made:  # of a rule over several robots; nobody can write its name
            continue
        anything = f"{predicate.name}({', '.join(['R', *'_' * len(predicate.types)])})"
        for text in (observed.text(anything), observed.why_not(anything)):
            assert text.strip()
            assert "None" not in text
