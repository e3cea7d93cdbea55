"""Provenance of every program of the library: the observed engine fires alike, and every tree ends in what is given."""

import json
import shlex
from pathlib import Path

import pytest
from command_runner import invoke
from observed_runs import evaluated

from rmr.base.time import in_seconds
from rmr.commands.subcommands import command as main
from rmr.why.explain import Explainer, Premise

ROOT = Path(__file__).parents[2]
PROGRAMS = sorted([*(ROOT / "tests/programs").rglob("*.rmr"), *(ROOT / "docs/examples").glob("*.rmr")])
RUNS = [
    (path, line.removeprefix("// run:").strip())
    for path in PROGRAMS
    for line in path.read_text("utf-8").splitlines()
    if line.startswith("// run:")
]
LEAVES = {"given", "outside", "sensed"}


def leaves(node):
    if not node.children:
        yield node
    for child in node.children:
        yield from leaves(child)


@pytest.mark.medium
@pytest.mark.parametrize(("path", "arguments"), RUNS, ids=lambda each: getattr(each, "stem", None))
def test_every_leaf_of_every_provenance_tree_is_given_outside_or_sensed(path, arguments, monkeypatch):
    if "columnar" in arguments:
        pytest.skip("robots in columns have no nodes")
    monkeypatch.chdir(path.parent)
    plain = invoke(main, ["eval", str(path), *shlex.split(arguments)]).stdout
    observed, report = evaluated(path, arguments, monkeypatch)
    assert json.loads(report) == json.loads(plain)
    past = observed.past
    count = 0
    for robot in observed.robots:
        for mind in past.minds(robot):
            for item in mind.items[:400]:
                explainer = Explainer(past, robot)
                tree = explainer.tree(Premise(mind, item), depth=60)
                for leaf in leaves(tree):
                    if not leaf.above and not leaf.cut:
                        count += 1
                        assert leaf.cause in LEAVES, (leaf, tree.text, in_seconds(tree.at))
    assert count or not any(mind.items for robot in observed.robots for mind in past.minds(robot))
