"""docs/engine.md says what the engines and their fuzzer do: names, ways, bounds, commands."""

import ast
import re
from importlib import import_module
from pathlib import Path

from doc_pages import page, table

from rmr.vm.engines import Engine
from rmr.vm.generate import loop, plan
from rmr.vm.generated import Generated
from rmr.vm.interpreted import Interpreted

PAGE = page("engine")
FUZZ = Path(__file__).parents[2] / "fuzz"


def test_the_engines_are_those_of_the_code():
    rows = table(PAGE, "engine", "class", "is")
    made = {Engine.INTERPRETER: Interpreted, Engine.GENERATED: Generated}
    assert [row[:2] for row in rows] == [(f"`{each.value}`", f"`{made[each].__name__}`") for each in Engine]


def test_the_ways_of_finding_matches_are_those_of_the_code():
    assert [row[0] for row in table(PAGE, "way", "of rules", "does")] == [f"`{way.name}`" for way in plan.Way]


def test_the_steps_name_modules_that_are_there():
    rows = table(PAGE, "step", "module of `rmr.vm.generate`", "does")
    names = [name for row in rows for name in re.findall(r"`(\w+)`", row[1])]
    assert len(names) >= len(rows)
    assert all(import_module(f"rmr.vm.generate.{name}").__doc__ for name in names)


def test_the_sizes_are_those_of_the_code():
    text = " ".join(PAGE.split())
    assert f"a body of more than {plan.ATOMS_MAX} atoms" in text
    assert f"Up to {loop.IN_LOOP_MAX} rules fire in the loop itself" in text


def test_the_fuzzers_options_and_the_suites_cases_are_those_of_the_code():
    tree = ast.parse((FUZZ / "test_fuzz_engines.py").read_text("utf-8"))
    values = {node.targets[0].id: node.value for node in tree.body if isinstance(node, ast.Assign)}  # type: ignore[attr-defined]
    assert f"The suite also tries {ast.literal_eval(values['CASES'])} cases of its own" in " ".join(PAGE.split())
    shown = set(re.findall(r"--\w+", " ".join(re.findall(r"engines\.py (.*?)(?:#|$)", PAGE, re.MULTILINE))))
    options = set(re.findall(r'"(--\w+)"', (FUZZ / "engines.py").read_text("utf-8")))
    assert {"--cases", "--case", "--seed"} <= shown <= options
    assert "--broken" in options
    assert "`build/fuzz`" in PAGE
    assert 'default=Path("build/fuzz")' in (FUZZ / "engines.py").read_text("utf-8")
