"""What is said about names, in all programs of the tree and in those with mistakes: never a failure."""

from pathlib import Path

import pytest

from rmr.lang.compiler import compile_source
from rmr.lang.read.tree_builder import RESERVED
from rmr.node.logic.deliveries import UNDELIVERED
from rmr_editor.symbols import NAMES_OF_ROBOTS, NameSpace, SymbolIndex, outline

ROOT = Path(__file__).parents[3]
PROGRAMS = sorted(path for folder in ("deploy", "docs", "tests") for path in (ROOT / folder).rglob("*.rmr"))
MISTAKES = sorted((ROOT / "tests" / "diagnostics").rglob("*.txt"))
FILE = "a.rmr"


def asked(text):
    """Ask everything about each name of a text; return the names by kind."""
    program = compile_source(text, FILE)
    index = SymbolIndex(program)
    found = {}
    for start in range(len(text) + 1):
        occurrence = index.at(FILE, start)
        if occurrence is not None and occurrence.span.start == start:
            written = text[occurrence.span.start : occurrence.span.end]
            name = occurrence.symbol.name  # of `Left-arm`, as the parser has repaired it, `left_arm`
            assert written[0].lower() + written[1:].replace("-", "_") == name[0].lower() + name[1:]
            found.setdefault(occurrence.symbol.space, set()).add(written)
            index.described(occurrence)
            assert occurrence in index.all(occurrence.symbol)
            assert index.definitions(occurrence.symbol)
            index.why_fixed(occurrence.symbol)
            why = index.why_not(occurrence.symbol, occurrence.symbol.name)
            assert why is None or "syntax error" in why or written in RESERVED
    for each in outline(program, FILE):
        assert each.name
        assert each.span.start <= each.head.start <= each.head.end <= each.span.end
    for place in range(0, len(text) + 1, max(1, len(text) // 3)):
        index.suggestions(FILE, place)
    return found


def test_predicates_that_robots_state_under_their_names_keep_them():
    assert UNDELIVERED in NAMES_OF_ROBOTS
    index = SymbolIndex(
        compile_source("type action moveto(robot, area).\n?location(R, t).\np(R) -o moveto(R, t).\np(R).\n", FILE)
    )
    [effect] = index.definitions(index.at(FILE, 36).symbol)
    assert index.why_fixed(effect.symbol) == "`location` is provided by robots under this name"
    assert index.why_not(index.at(FILE, len("type action moveto(robot, area).\n?location(R, t).\n")).symbol, "location")


@pytest.mark.medium
def test_all_programs_of_the_tree_can_be_asked_about():
    kinds = [asked(path.read_text("utf-8-sig")) for path in PROGRAMS]
    assert all(any(space in each for each in kinds) for space in NameSpace)


@pytest.mark.medium
@pytest.mark.parametrize("path", MISTAKES, ids=lambda path: path.stem)
def test_programs_with_mistakes_can_be_asked_about(path):
    text = path.read_text("utf-8").partition("----\n")[0][:4000]
    asked(text)
    for cut in range(0, len(text), max(1, len(text) // 8)):
        asked(text[:cut])


@pytest.mark.medium
def test_each_name_of_a_program_can_get_another_one():
    """The program with another name compiles as before: nothing was missed, nothing else was changed."""
    tried = 0
    for path in [each for each in PROGRAMS if "examples" in each.parts or "labs" in each.parts]:
        text = path.read_text("utf-8")
        before = compile_source(text, FILE)
        if before.errors or before.included:
            continue
        index = SymbolIndex(before)
        symbols = {each.symbol: None for start in range(len(text)) if (each := index.at(FILE, start)) is not None}
        for symbol in symbols:
            new = "Zz_renamed" if symbol.space is NameSpace.VARIABLE else "zz_renamed"
            if index.why_fixed(symbol) or index.why_not(symbol, new):
                continue
            changed = text
            for each in reversed(index.all(symbol)):
                changed = changed[: each.span.start] + new + changed[each.span.end :]
            after = compile_source(changed, FILE)
            codes = [each.code for each in after.diagnostics]
            assert codes == [each.code for each in before.diagnostics], (path, symbol)
            tried += 1
    assert tried > 100
