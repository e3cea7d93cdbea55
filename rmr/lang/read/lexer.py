"""The lexer: a lazy stream of the tokens of a source text.

The grammar defines the terminals. This module adds error tokens, so that the parser can report them: an unterminated
string or comment, a number that continues as a name, operators of other languages, and any other character. A keyword
of the grammar, such as `list`, is a token of its own kind; where the grammar does not expect it, it is a name.
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
"""Kinds of error tokens, from OPEN_COMMENT to here; none is a valid name of a terminal."""

_NUMBER_LIKE = r"@?[0-9]+(?:\.[0-9]+)?[A-Za-z_][A-Za-z0-9_]*"
_ARROWS = r"(?<!-)--+[o>](?![A-Za-z0-9_])|->|:-|[\u2013\u2014\u2212]o(?![A-Za-z0-9_])"
_FOREIGN = rf"{_ARROWS}|===?|!==|=:=|=<|=?\\=+|\\\+|:=|[-+*/]=|\*\*|\+\+"
_WRONG_FIRST = [(BAD_NUMBER, _NUMBER_LIKE), (FOREIGN, _FOREIGN)]
"""Error patterns tried before the terminals of the grammar, except those with a priority."""
_QUOTED = r"'[^'\n]*'|[“”„«][^“”„«»\n]*[“”»]|\u2018[^\u2018\u2019\n]*\u2019"
_WRONG_LATER = [(OPEN_COMMENT, r"/\*[\s\S]*"), (QUOTED, _QUOTED), (OPEN_STRING, '"')]
"""Error patterns tried after the grammar's regular expressions and before its fixed spellings.

None is searched anew at each sign of a run of `-`, of opening marks or of `\\"` that has no end, which takes quadratic
time.
"""


class Token(NamedTuple):
    """A token with its offsets."""

    kind: str
    """The name of the terminal, END, or the kind of an error token."""
    text: str
    start: int
    end: int


COMMENT_SIGNS = ("#", "%", "--", "<!--")
"""Signs that begin a comment in other languages."""


def without_foreign_comments(words: Iterable[Token], text: str) -> Iterator[Token]:
    """Yield `words` without comments in the syntax of other languages, each from its sign to the end of the line.

    `%` and `--` are ambiguous (remainder, two minus signs). They begin a comment at the beginning of an item or of a
    line, behind a comma or an arrow, and before a token that is no variable or number.
    """
    end = -1
    previous = "DOT"
    last = 0
    for word in words:
        if word.start < end and word.kind != END:
            continue
        if text.startswith(COMMENT_SIGNS, word.start) and word.kind != END:
            is_first = previous in {"DOT", "COMMA", "ARROW"} or "\n" in text[last : word.start]
            if word.text == "#" or is_first or re.match(r"%+ *[a-z]", text[word.start : word.start + 80]):
                end = text.find("\n", word.start)
                end = len(text) if end < 0 else end
                continue
        yield word
        previous = word.kind
        last = word.end


class Scanner(NamedTuple):
    """The compiled lexical grammar."""

    pattern: re.Pattern[str]
    """Alternation of all patterns in order of precedence, one named group each."""
    kinds: dict[str, str]
    """Kinds of tokens by the names of the groups."""
    reserved: dict[str, str]
    """Kinds of keywords by their spelling."""
    ignored: frozenset[str]
    """Kinds that are skipped: blanks and comments."""


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
    """Yield the tokens of `text` from `start` on, then END; with `ignored` also comments and blanks."""
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
    """Return the fixed spelling of a terminal; None if it has none."""
    return next((word.spelling for word in tables().terminals if word.name == kind), None)
