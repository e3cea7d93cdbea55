"""Whatever the program and however it is laid out, its canonical layout is one text that means the same."""

import re
from random import Random

import pytest
from drawn_programs import program, written
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.format import format_source
from rmr.lang.read.parser import parse
from rmr.lang.read.source_text import SourceText

pytestmark = pytest.mark.medium

COMMENT = re.compile(r'("(?:[^"\\\n]|\\[^\n])*")|(//[^\n]*|/\*.*?\*/)', re.DOTALL)
SPAN = re.compile(r"Span\(file='x', start=\d+, end=\d+\)")


def formatted(text):
    found = Diagnostics()
    result = format_source(SourceText("x", text), found)
    assert result is not None, (text, found)
    return result


def comments(text):
    found = [matched[2] for matched in COMMENT.finditer(text) if matched[2]]
    return [each.replace("\r\n", "\n").rstrip() for each in found]


def without_comments(text):
    return COMMENT.sub(lambda matched: matched[1] or " ", text)


def closed(text):
    """Return `text` without blank lines, which the author sets."""
    return text.replace("\n\n", "\n").removeprefix("\n")


def meaning(text):
    """Return the syntax tree without its places."""
    found = Diagnostics()
    module = parse(SourceText("x", text), found)
    assert not found.failed
    return SPAN.sub("", repr(module.items))


@given(st.integers(min_value=0), st.integers(1, 80), st.sampled_from([0.0, 0.1, 0.5]))
@settings(max_examples=300, deadline=None)
def test_the_layout_is_canonical(seed, length, share):
    random = Random(seed)
    words = program(random, length)
    plain, commented = written(words, random, 0.0), written(words, random, share)
    result = formatted(commented)
    assert formatted(result) == result
    assert comments(result) == comments(commented)
    assert meaning(result) == meaning(plain)
    assert closed(formatted(without_comments(result))) == closed(formatted(plain))
