"""The lexer for Pygments, on all programs of the tree and on some that are none."""

import re
from itertools import accumulate
from pathlib import Path

import pytest
from pygments.lexers import get_lexer_by_name, get_lexer_for_filename
from pygments.token import Comment, Error, Keyword, Name, Number, Operator, Punctuation, String, Whitespace

from rmr.lang.compiler import compile_text
from rmr.lang.read.source_text import read_source
from rmr.lang.read.tree_builder import RESERVED
from rmr_editor.highlight import RmrLexer

ROOT = Path(__file__).parents[3]
PROGRAMS = sorted(
    path
    for folder in ("deploy", "docs", "tests")
    for path in (ROOT / folder).rglob("*.rmr")
    if ".venv" not in path.parts
)


def found(text):
    return [(kind, word) for _, kind, word in RmrLexer().get_tokens_unprocessed(text) if kind is not Whitespace]


def test_pygments_finds_it_by_name_and_by_the_name_of_a_file():
    assert isinstance(get_lexer_by_name("rmr"), RmrLexer)
    assert isinstance(get_lexer_for_filename("shop.rmr"), RmrLexer)


def test_programs_of_the_tree_have_no_token_that_is_an_error():
    good = 0
    for path in PROGRAMS:
        source = read_source(path)
        lexed = list(RmrLexer().get_tokens_unprocessed(source.text))
        assert "".join(word for _, _, word in lexed) == source.text
        ends = accumulate(len(word) for _, _, word in lexed)
        assert [offset for offset, _, _ in lexed] == [0, *ends][: len(lexed)]
        if not any(each.code == "E001" for each in compile_text(source).diagnostics):
            good += 1
            assert [word for _, kind, word in lexed if kind is Error] == [], path
    assert good > 100
    assert good >= len(PROGRAMS) - 20


def test_each_reserved_word_is_a_keyword():
    assert [word for word in sorted(RESERVED) if found(f"{word} ")[0][0] not in Keyword] == []


def test_words_are_told_apart():
    text = 'w: assert(p(R), at(R, exit), 2.5, stop(R)). // note\n[sum X => S | q(@4, 1, "a", 500ms) | r(true)] -o'
    kinds = found(text)
    for kind, word in (
        (Name.Label, "w"),
        (Keyword, "assert"),
        (Name.Function, "p"),
        (Name.Variable, "R"),
        (Name, "exit"),
        (Number.Float, "2.5"),
        (Comment.Single, "// note"),
        (Name.Builtin, "sum"),
        (Operator, "=>"),
        (Name.Constant, "@4"),
        (Number.Integer, "1"),
        (String.Double, '"a"'),
        (Number, "500ms"),
        (Keyword.Constant, "true"),
        (Operator, "-o"),
        (Punctuation, "."),
    ):
        assert (kind, word) in kinds, word
    assert found("type p(robot, list int).")[:3] == [
        (Keyword.Declaration, "type"),
        (Name.Function, "p"),
        (Punctuation, "("),
    ]
    assert (Keyword.Type, "int") in found("type p(robot, list int).")
    assert found("/* a\nb */") == [(Comment.Multiline, "/* a\nb */")]


@pytest.mark.parametrize("text", ["p(R) -> q(R).", 'p("open', "/* open", "p('a')", "p ~ q", "5min3", "\0"])
def test_what_the_language_has_not_is_an_error_and_nothing_is_lost(text):
    assert Error in [kind for kind, _ in found(text)]
    assert "".join(word for _, _, word in RmrLexer().get_tokens_unprocessed(text)) == text
    assert re.sub(r"\s", "", "".join(word for _, word in RmrLexer().get_tokens(text))) == re.sub(r"\s", "", text)
