"""The documents say what the code does: examples compile, tables equal the code's tables."""

import re
from itertools import groupby
from pathlib import Path

import pytest

from rmr.bytecode import provided
from rmr.lang.analyse.types import CALLABLE, declaration_text
from rmr.lang.compiler import compile_source
from rmr.lang.pages import without_links
from rmr.lang.read.tree_builder import RESERVED

ROOT = Path(__file__).parents[3]
LANGUAGE = ROOT / "docs" / "language.md"
BYTECODE = ROOT / "docs" / "bytecode.md"
CORRIDOR = ROOT / "deploy" / "labs" / "corridor" / "corridor.rmr"

FENCE = re.compile(r"^```(\w+) ?(.*?)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def blocks(path, language):
    """Return (line, words behind the language, text) of each fenced block of `language`."""
    text = path.read_text(encoding="utf-8")
    found = FENCE.finditer(text)
    return [(text[: m.start()].count("\n") + 1, m[2].split(), m[3]) for m in found if m[1] == language]


def examples():
    for path in (LANGUAGE, BYTECODE, ROOT / "README.md"):
        for line, words, text in blocks(path, "rmr"):
            yield pytest.param(words, text, id=f"{path.name}:{line}")


def rows(path, heading, columns):
    """Return the first `columns` cells of each row of the tables of a section."""
    section = re.split(rf"^#+ {re.escape(heading)}\n", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1]
    section = re.split(r"^#+ ", section, maxsplit=1, flags=re.MULTILINE)[0]
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in section.splitlines() if line.startswith("| ")]
    return [tuple(cell.strip() for cell in row[:columns]) for row in cells]


def codes(text):
    return [each.code for each in compile_source(text).diagnostics]


def spelt(text):
    """Return a program without comments and spaces."""
    return re.sub(r"\s+", "", re.sub(r"//.*", "", text))


@pytest.mark.parametrize(("words", "text"), list(examples()))
def test_an_example_compiles_or_is_as_wrong_as_it_says(words, text):
    found = set(codes(text))
    if words[:1] == ["error"]:
        assert {code for code in found if code.startswith("E")} == set(words[1:])
    elif words[:1] == ["warning"]:
        assert found == set(words[1:])
    else:
        assert (words, found) == ([], set())


def test_the_tour_shows_the_corridor_program_as_it_runs():
    shown = [spelt(text) for _, _, text in blocks(LANGUAGE, "rmr")]
    assert spelt(CORRIDOR.read_text(encoding="utf-8")) in shown


def test_the_diagnostics_have_one_index():
    told = " ".join(LANGUAGE.read_text(encoding="utf-8").split())
    assert "[Errors and warnings](diagnostics.md) lists all codes" in told


def test_the_reserved_words_are_those_of_the_code():
    words = re.search(r"Reserved, they name nothing: ([^.]*)\.", LANGUAGE.read_text(encoding="utf-8"))
    assert words is not None
    assert set(re.findall(r"`(\w+)`", words[1])) == RESERVED


def test_the_provided_facts_are_those_of_the_code():
    listed = [row[0].strip("`") for row in rows(LANGUAGE, "Sensed facts", 1) if row[0] != "provided"]
    known = [declaration_text(each.name, each.types, "") for each in provided.PREDICATES.values()]
    assert [f"type {signature}." for signature in listed] == known
    told = [without_links(row[1]) for row in rows(LANGUAGE, "Sensed facts", 2) if row[0] != "provided"]
    assert told == [each.doc for each in provided.PREDICATES.values()]


def test_the_provided_actions_are_those_of_the_code():
    listed = [row[0].strip("`") for row in rows(LANGUAGE, "Actions", 1) if row[0] != "provided"]
    assert listed == [declaration_text(each.name, each.types, "action ") for each in provided.ACTIONS.values()]
    told = [without_links(row[1]) for row in rows(LANGUAGE, "Actions", 2) if row[0] != "provided"]
    assert told == [each.doc for each in provided.ACTIONS.values()]


def test_the_functions_of_expressions_are_those_of_the_code():
    listed = [row for row in rows(LANGUAGE, "Expressions", 2) if "(" in row[0]]
    grouped = groupby(CALLABLE.values(), key=lambda function: function.doc)
    known = [(" ".join(f"`{each.signature}`" for each in functions), doc) for doc, functions in grouped]
    assert sorted(row for row in listed if not row[0].startswith("`if(")) == sorted(known)
