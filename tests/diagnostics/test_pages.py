"""Every code has a page whose examples are as wrong, and as right, as the page says."""

import re
from pathlib import Path

import pytest

from rmr.lang.compiler import compile_file
from rmr.lang.diagnostics.diagnostic import CODES, Diagnostics
from rmr.lang.format import format_source
from rmr.lang.pages import page
from rmr.lang.read.source_text import SourceText

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SECTIONS = ["Why", "What to do"]
BY_HAND = {"E004", "E008", "W105"}
"""Examples that are too large to be laid out as programs are."""
INDEX = ROOT / "docs" / "diagnostics.md"


def blocks(code):
    """Return (words behind the language, text) of each example."""
    found = FENCE.findall(page(code))
    assert {language for language, _, _ in found} == {"rmr"}
    return [(words.split(), text) for _, words, text in found]


def codes(path, text):
    path.write_text(text, encoding="utf-8")
    return [each.code for each in compile_file(path).diagnostics]


@pytest.mark.parametrize("code", CODES)
def test_the_examples_are_as_wrong_and_as_right_as_the_page_says(code, tmp_path):
    shown = set()
    for words, text in blocks(code):
        match words:
            case ["error" | "warning" as severity, named, *rest]:
                assert (severity[0].upper(), named) == (code[0], code)
                times = int(rest[1]) if rest[:1] == ["times"] else 1
                name = rest[0] if rest and times == 1 else "program.rmr"
                found = codes(tmp_path / name, text * times)
                assert found[-1:] == [code] if times > 1 else set(found) == {code}
                shown.add("wrong")
            case [name]:
                (tmp_path / name).write_text(text, encoding="utf-8")
            case []:
                assert codes(tmp_path / "program.rmr", text) == []
                shown.add("right")
            case _:
                pytest.fail(f"what is ```rmr {' '.join(words)}?")
    assert shown == {"wrong", "right"}


@pytest.mark.parametrize("code", [code for code in CODES if code not in BY_HAND])
def test_the_examples_are_formatted(code):
    for _, text in blocks(code):
        laid_out = format_source(SourceText("x", text), Diagnostics())
        assert laid_out in (None, text)


@pytest.mark.parametrize("code", CODES)
def test_a_page_has_its_title_its_sections_and_its_relatives(code):
    text = page(code)
    assert text.startswith(f"# {code}: {CODES[code]}\n")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == SECTIONS
    relatives = re.findall(r"\[(\w+)\]\((\w+)\.md\)", text.rpartition("See also: ")[2])
    assert relatives
    assert all(name == target and name in CODES and name != code for name, target in relatives)
    assert max(len(line) for line in FENCE.sub("", text).splitlines()) <= 100


def test_there_is_no_page_without_a_code():
    assert sorted(path.stem for path in (ROOT / "rmr" / "lang" / "pages").glob("*.md")) == sorted(CODES)


def test_the_index_lists_every_code_with_its_title_and_page():
    rows = re.findall(r"^\| \[(\w+)\]\(\.\./rmr/lang/pages/(\w+)\.md\) \| (.*?) \|", INDEX.read_text(), re.MULTILINE)
    assert [(code, title) for code, _, title in rows] == list(CODES.items())
    assert all(code == target for code, target, _ in rows)
