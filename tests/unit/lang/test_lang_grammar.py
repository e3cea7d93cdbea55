"""The parser's tables are kept between runs, and a machine that cannot keep them does without."""

import json
import subprocess
import sys
from pathlib import Path
from zlib import crc32

import pytest

from rmr.lang.compiler import compile_source
from rmr.lang.read.grammar import cache_path, grammar_text, tables

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
    octets = path.read_bytes()
    forged = json.dumps(json.loads(octets.split(b"\n")[1]) | {"grammar": "another", "actions": []}).encode()
    path.write_bytes(b"%08x\n%b" % (crc32(forged), forged))
    tables.cache_clear()
    assert outcome() == fresh
    assert path.read_bytes() == octets


def _without_actions(octets: bytes) -> bytes:
    checksum, content = octets.split(b"\n")
    return checksum + b"\n" + json.dumps(json.loads(content) | {"actions": []}).encode()


DAMAGES = {
    "empty": lambda octets: b"",
    "garbage": lambda octets: b"garbage\n\x80\x04.",
    "cut off": lambda octets: octets[: len(octets) // 2],
    "one digit another": lambda octets: octets.replace(b'"start":', b'"start":9', 1),
    "well-formed, yet no tables": _without_actions,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_made_anew(home, damage):
    fresh = outcome()
    (file,) = kept(home)
    octets = file.read_bytes()
    assert damage(octets) != octets
    file.write_bytes(damage(octets))
    tables.cache_clear()
    assert outcome() == fresh
    assert file.read_bytes() == octets


def test_where_nothing_can_be_kept_programs_compile_all_the_same(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    tables.cache_clear()
    assert outcome()[0] is not None
    tables.cache_clear()


def test_a_user_without_a_home_compiles_all_the_same(monkeypatch):
    def homeless(_: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "expanduser", homeless)
    tables.cache_clear()
    assert outcome()[0] is not None
    tables.cache_clear()


def test_what_cannot_be_written_to_the_end_leaves_nothing_behind(home, monkeypatch):
    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("rmr.lang.read.grammar.os.replace", full)
    assert outcome()[0] is not None
    assert kept(home) == []
