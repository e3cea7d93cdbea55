"""The functions of the language are one table: a row is all that a new one needs."""

import ast
import subprocess
import sys
from pathlib import Path

import rmr
from rmr.bytecode.functions import FUNCTIONS
from rmr.columns import numbers
from rmr.vm.generate import function_source

ROOT = Path(rmr.__file__).parent
NAMED_ELSEWHERE = {"min", "max", "id", "now", "len", "nth", "rest"} | {
    "robot",
    "remove",
    "update",
    "index",
    "slice",
    "hypot",
    "random",
}
"""Aggregates, a type, provided facts, names of generated code, and what the compiler writes to take a list apart."""

NEW_ROW = """
import math
from rmr.bytecode import functions as f

row = f.Function("cbrt", "X", (f.Takes.NUMBER,), f.Gives.FLOAT, math.cbrt, "the cube root", {forms})
f.FUNCTIONS += (row,)
f.BY_NAME["cbrt"] = row
f._NUMERIC |= {{"cbrt"}}

import rmr

program = "start(@1, 27). start(R, X), cbrt(X) > 2.5 -o done(R, cbrt(X + 37), cbrt(8.0))."
for engine in ("interpreter", "generated", "columnar"):
    print(rmr.evaluate(rmr.compile(program), engine=engine).facts(1))
"""


def test_the_forms_of_the_generating_engine_are_those_that_rows_name():
    assert {each.source for each in FUNCTIONS if each.source} == set(function_source.FORMS)


def test_the_forms_of_columns_are_those_that_rows_name():
    assert {each.columns for each in FUNCTIONS if each.columns} == set(numbers.FORMS)


def test_no_module_beside_the_table_names_a_function():
    names = {each.name for each in FUNCTIONS} - NAMED_ELSEWHERE
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.value}"
        for part in ("analysis", "bytecode", "columns", "lang", "vm")
        for path in sorted((ROOT / part).rglob("*.py"))
        if path != ROOT / "bytecode" / "functions.py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value in names
    ]
    assert found == []


def _evaluated(forms: str) -> list[str]:
    code = NEW_ROW.format(forms=forms)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_new_row_is_typed_compiled_and_run_by_all_engines():
    interpreted, generated, columnar = _evaluated("")
    assert "done" in interpreted
    assert "4.0" in interpreted
    assert interpreted == generated == columnar
    assert set(_evaluated("source='total'")) == {interpreted}
