"""The words of a source text, one after the other, never all at once.

What is a word is in the grammar; here stands what is none, so that the parser can say so: a string or comment
without an end, a number that goes on as a name, signs of other languages, and any other character. A word that the
grammar spells, such as `list`, is of a kind of its own here; where the grammar cannot take it, it is a name.
"""

import re
from collections.abc import Iterable, Iterator
from functools import cache
from typing import NamedTuple

from rmr.lang.read.grammar import END
from rmr.lang.read.tables import tables

OPEN_COMMENT = "/*"
OPEN_STRING = '"'
BAD_NUMBER = "0"
FOREIGN = "->"
QUOTED = "'"
UNKNOWN = "?"
"""The kinds of what is no word. None can be a terminal's name."""

_NUMBER_LIKE = r"@?[0-9]+(?:\.[0-9]+)?[A-Za-z_][A-Za-z0-9_]*"
_ARROWS = r"--+[o>](?![A-Za-z0-9_])|->|:-|[\u2013\u2014\u2212]o(?![A-Za-z0-9_])"
_FOREIGN = rf"{_ARROWS}|===?|!==|=:=|=<|=?\\=+|\\\+|:=|[-+*/]=|\*\*|\+\+"
_WRONG_FIRST = [(BAD_NUMBER, _NUMBER_LIKE), (FOREIGN, _FOREIGN)]
"""Tried before the grammar's patterns, but for those that say to be first."""
_QUOTED = r"'[^'\n]*'|[“”„«][^“”»\n]*[“”»]|\u2018[^\u2019\n]*\u2019"
_WRONG_LATER = [(OPEN_COMMENT, r"/\*[\s\S]*"), (QUOTED, _QUOTED), (OPEN_STRING, '"')]
"""Tried when no pattern of the grammar fits, before what it spells."""


class Token(NamedTuple):
    """A word and where it stands."""

    kind: str
    """The terminal's name, END, or what kind of no word it is."""
    text: str
    start: int
    end: int


COMMENT_SIGNS = ("#", "%", "--", "<!--")
"""What begins a comment in other languages."""


def without_foreign_comments(words: Iterable[Token], text: str) -> Iterator[Token]:
    """Leave out of `words` what other languages' signs of comments begin, each to the end of its line.

    `%` may be the remainder and `--` two signs; they begin a comment at the beginning of an item or of a line, behind
    a comma or an arrow, and before a word that is no variable or number.
    """
    end = -1
    previous = "DOT"
    last = 0
    for word in words:
        if word.start < end and word.kind != END:
            continue
        if text.startswith(COMMENT_SIGNS, word.start) and word.kind != END:
            is_first = previous in {"DOT", "COMMA", "ARROW"} or "\n" in text[last : word.start]
            if word.text == "#" or is_first or re.match(r"%+ *[a-z]", text[word.start :][:80]):
                end = text.find("\n", word.start)
                end = len(text) if end < 0 else end
                continue
        yield word
        previous = word.kind
        last = word.end


class Scanner(NamedTuple):
    """How to find words."""

    pattern: re.Pattern[str]
    kinds: dict[str, str]
    """By the pattern's groups."""
    reserved: dict[str, str]
    """The kinds of the words that look like names."""
    ignored: frozenset[str]


@cache
def scanner() -> Scanner:
    """Return the scanner of the grammar, made once per process."""
    words = tables().terminals
    ignored = tables().ignored
    [name] = [word for word in words if word.name == "NAME"]
    reserved = {
        word.spelling: word.name for word in words if word.spelling and re.fullmatch(name.pattern, word.spelling)
    }
    free = [word for word in words if word.name not in reserved.values()]
    tried = [(word.name, word.pattern) for word in free if word.first]
    tried += _WRONG_FIRST
    tried += [(word.name, word.pattern) for word in free if not word.first and word.spelling is None]
    tried += _WRONG_LATER
    tried += [(word.name, word.pattern) for word in free if not word.first and word.spelling is not None]
    tried.append((UNKNOWN, r"[\s\S]"))
    kinds = {f"g{number}": kind for number, (kind, _) in enumerate(tried)}
    pattern = "|".join(f"(?P<g{number}>{pattern})" for number, (_, pattern) in enumerate(tried))
    return Scanner(re.compile(pattern), kinds, reserved, frozenset(ignored))


def tokens(text: str, start: int = 0, *, ignored: bool = False) -> Iterator[Token]:
    """Yield the words of `text` from `start` on, with comments and blanks if `ignored` is set, and END at last."""
    pattern, kinds, reserved, skipped = scanner()
    if ignored:
        skipped = frozenset()
    for match in pattern.finditer(text, start):
        kind = kinds[match.lastgroup or ""]
        if kind in skipped:
            continue
        word = match.group()
        if kind == "NAME":
            kind = reserved.get(word, kind)
        yield Token(kind, word, match.start(), match.end())
    yield Token(END, "", len(text), len(text))


def spelling(kind: str) -> str | None:
    """Return how a terminal is written; None if there is more than one way."""
    return next((word.spelling for word in tables().terminals if word.name == kind), None)
