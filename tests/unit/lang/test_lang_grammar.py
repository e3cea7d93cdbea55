"""The parser's tables are kept between runs, and a machine that cannot keep them does without."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rmr.lang.compiler import compile_source
from rmr.lang.grammar import cache_path, grammar_text, tables

GOOD = "location(R, s).\nlocation(R, L), L = s -o location(R, t).\n"
BAD = "location(R, s)\nlocation(R, L) L = s -o location(R, t).\n"


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A cache folder of the test's own, and no parser in memory before or after."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tables.cache_clear()
    yield tmp_path
    tables.cache_clear()


def outcome() -> list[object]:
    good, bad = compile_source(GOOD), compile_source(BAD)
    return [good.program, good.diagnostics, bad.diagnostics]


def kept(home: Path) -> list[Path]:
    return sorted((home / "rmr").glob("*"))


def test_kept_tables_give_the_same_programs_and_the_same_diagnostics(home):
    fresh = outcome()
    assert len(kept(home)) == 1
    tables.cache_clear()
    assert outcome() == fresh
    assert len(kept(home)) == 1


def test_tables_at_hand_need_no_lark(home):
    outcome()
    code = "import sys; from rmr.lang.compiler import compile_source; compile_source(''); print('lark' in sys.modules)"
    [word] = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert word == "False"


def test_tables_of_another_grammar_are_not_taken_for_its_own(home):
    fresh = outcome()
    path = cache_path(grammar_text())
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"grammar": "another", "actions": []}))
    tables.cache_clear()
    assert outcome() == fresh
    assert json.loads(path.read_text()) == content


@pytest.mark.parametrize("octets", [b"", b"garbage", b"\x80\x04."])
def test_a_damaged_file_is_made_anew(home, octets):
    fresh = outcome()
    (file,) = kept(home)
    file.write_bytes(octets)
    tables.cache_clear()
    assert outcome() == fresh
    assert len(file.read_bytes()) > 1000


def test_where_nothing_can_be_kept_programs_compile_all_the_same(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    tables.cache_clear()
    assert outcome()[0] is not None
    tables.cache_clear()
