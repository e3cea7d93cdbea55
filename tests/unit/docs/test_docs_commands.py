"""docs/commands.md: what `rmr doctor` looks for, environment variables, the documents of JSON that commands print."""

import ast
import json
import re

import pytest
from command_runner import invoke
from doc_pages import ROOT, codes, page, table

from rmr.commands.subcommands import command
from rmr.entry import JSON_VERSION

PAGE = page("commands")


@pytest.mark.real  # it tries a port
def sources():
    """Yield the syntax tree of each module of the distribution, and the hook that builds it."""
    for folder in ("rmr", "agents", "world", "deploy"):
        yield from (ast.parse(path.read_text()) for path in sorted((ROOT / folder).rglob("*.py")))
    yield ast.parse((ROOT / "hatch_build.py").read_text())


def variables(tree):
    """Yield what looks like an environment variable among the strings of a module that reads the environment."""
    nodes = list(ast.walk(tree))
    if any(isinstance(node, ast.Attribute) and node.attr == "environ" for node in nodes):
        texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
        yield from (text for text in texts if re.fullmatch("[A-Z][A-Z0-9_]+", text))
    yield from (node.value for node in nodes if isinstance(node, ast.Constant) and str(node.value).startswith("RMR_"))


def test_every_environment_variable_that_the_code_reads_is_documented_and_no_other():
    found = {name for tree in sources() for name in variables(tree)}
    shown = {"COMMAND", "DIR", "LACKS", "PIL"}  # words of help and output, and a module
    assert shown < found
    assert {name for row in table(PAGE, "variable", "means") for name in codes(row[0])} == found - shown


KEYS = {code: row[1] for row in table(PAGE, "command", "keys") for code in codes(row[0])}
OWN_FORM = {"rmr_deploy/fleet_listing.py": "a lab file", "rmr_deploy/router_config.py": "of zenohd"}
"""Modules that print JSON of another form."""


@pytest.mark.medium
@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("rmr check --json", "check --json p.rmr"),
        ("rmr check --json", "check --json --explain p.rmr"),
        ("rmr check --json", "check --json corridor"),
        ("rmr compile --json", "compile --json p.rmr"),
        ("rmr fmt --json", "fmt --check --json p.rmr"),
        ("rmr explain --json", "explain --json"),
        ("rmr explain CODE --json", "explain E012 --json"),
        ("rmr eval", "eval p.rmr"),
        ("rmr radio EXPERIMENT --json", "radio overlap --frames 5 --json"),
        ("rmr sim --json", "sim testbed --robots 2 --run run --json"),
        ("rmr sim --seeds --json", "sim testbed --robots 2 --seeds 1-2 --run runs --jobs 1 --json"),
        ("rmr lab list --json", "lab list --json"),
        ("rmr ls --json", "ls --json"),
    ],
)
def test_a_document_has_its_version_first_and_the_keys_of_the_page(row, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RMR_REGISTER", str(tmp_path / "register"))
    (tmp_path / "p.rmr").write_text("p(R).\np(R) -o q(R).\n")
    told = json.loads(invoke(command, words.split()).stdout)
    assert told.pop("version") == JSON_VERSION
    if "[the re" not in KEYS[row] and "sweep.json" not in KEYS[row]:
        assert set(told) <= set(codes(KEYS[row])), told.keys()


def printed(tree):
    """Yield the calls of print that are given text made by json.dumps."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
            yield from (each for each in ast.walk(node) if isinstance(each, ast.Attribute) and each.attr == "dumps")


def test_no_module_prints_a_document_of_json_past_the_function_that_puts_the_version_in():
    found = {}
    for folder in ("rmr/commands", "world", "agents", "deploy"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            calls = list(printed(ast.parse(path.read_text())))
            if calls:
                found[path.relative_to(ROOT / folder).as_posix()] = len(calls)
    with_version = {"eval_command.py": 1, "replay_command.py": 1}  # of eval, and a line of the trace
    assert found == {**dict.fromkeys(OWN_FORM, 1), **with_version}
