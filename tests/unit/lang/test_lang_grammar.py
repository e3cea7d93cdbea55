"""The parser's tables are part of the package, are those of its grammar, and need neither lark nor a home."""

import json
import os
import subprocess
import sys

import pytest

from rmr.lang.compiler import compile_source
from rmr.lang.read import tables as loader
from rmr.lang.read.grammar import TABLES_FILE, grammar_text
from rmr.lang.read.table_maker import as_text, made
from rmr.lang.read.tables import tables

GOOD = "location(R, s).\nlocation(R, L), L = s -o location(R, t).\n"
BAD = "location(R, s)\nlocation(R, L) L = s -o location(R, t).\n"


@pytest.fixture
def fresh_tables():
    """No tables in memory before or after."""
    tables.cache_clear()
    yield
    tables.cache_clear()


def outcome() -> list[object]:
    good, bad = compile_source(GOOD), compile_source(BAD)
    return [good.program, good.diagnostics, bad.diagnostics]


def test_packaged_tables_are_those_of_the_grammar():
    text = grammar_text()
    assert TABLES_FILE.read_text(encoding="utf-8") == as_text(made(text), text), (
        "the grammar has changed: run python -m rmr.lang.read.table_maker"
    )


def test_loaded_tables_equal_those_made_in_memory():
    assert tables() == made(grammar_text())


@pytest.mark.parametrize("seed", ["1", "2"])
def test_tables_do_not_depend_on_the_hash_seed(seed):
    code = "from rmr.lang.read import table_maker as m; t = m.grammar_text(); print(m.as_text(m.made(t), t), end='')"
    environment = {**os.environ, "PYTHONHASHSEED": seed}
    made_there = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True).stdout
    assert made_there == TABLES_FILE.read_bytes()


def test_packaged_tables_need_no_lark():
    code = "import sys; from rmr.lang.compiler import compile_source; compile_source(''); print('lark' in sys.modules)"
    [word] = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert word == "False"


def test_compiling_writes_nothing_to_the_home_directory(tmp_path):
    environment = {**os.environ, "HOME": str(tmp_path)} | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    code = "from rmr.lang.compiler import compile_source; assert compile_source('p(@1, 2).').program"
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    assert list(tmp_path.rglob("*")) == []


def test_an_edited_grammar_takes_effect_before_its_tables_are_written(fresh_tables, monkeypatch):
    packaged = tables()
    edited = grammar_text().replace('"order" NAME', '"sequence" NAME')
    monkeypatch.setattr(loader, "grammar_text", lambda: edited)
    tables.cache_clear()
    assert {each.spelling for each in tables().terminals} - {each.spelling for each in packaged.terminals} == {
        "sequence"
    }


def test_tables_of_another_grammar_are_not_used(fresh_tables, tmp_path, monkeypatch):
    expected = outcome()
    stale = {**json.loads(TABLES_FILE.read_text(encoding="utf-8")), "grammar": "00000000", "actions": []}
    file = tmp_path / "tables.json"
    file.write_text(json.dumps(stale), encoding="utf-8")
    monkeypatch.setattr(loader, "TABLES_FILE", file)
    tables.cache_clear()
    assert outcome() == expected
