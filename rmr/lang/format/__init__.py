"""`rmr fmt`: the canonical layout of a source text.

The layout is made from the tokens of the text, never from the syntax tree, so that nothing can be lost: numbers,
strings and parentheses stay as they are written, every comment stays between its tokens. Tokens of the same kind in
the same order have the same layout, whatever the spaces and lines between them were; only comments and single
blank lines between items remember where they stood.

`words` reads the tokens, `line_breaks` decides where lines may break, `printer` where they do.
"""

import math

from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.format.line_breaks import layout
from rmr.lang.format.printer import printed
from rmr.lang.format.words import Text, Word, read
from rmr.lang.read.parser import parse
from rmr.lang.read.source_text import SourceText


def format_source(source: SourceText, found: Diagnostics) -> str | None:
    """Return the text of `source` in canonical layout, or None if it has syntax errors, reported to `found`."""
    parse(source, found)
    if found.failed:
        return None
    text = read(source.text)
    result = printed(layout(text))
    assert _content(read(result)) == _content(text), "the layout has lost or gained a word or a comment"
    return result


def one_line(text: str) -> str:
    """Return a part of a program, which has no syntax errors, on one line and without its comments."""
    words = [Word(word.kind, word.text) for word in read(text).words]
    whole = bool(words) and words[-1].text == "."
    line = printed(layout(Text(words if whole else [*words, Word("DOT", ".")], [])), math.inf)
    return line.removesuffix("\n") if whole else line.removesuffix(".\n")


def _content(text: Text) -> tuple[list[str], list[str]]:
    """Return the tokens and the comments of a text."""
    words = [word.text for word in text.words]
    comments = [comment.text for word in text.words for comment in (*word.before, *word.after)]
    return words, comments + [comment.text for comment in text.end]
