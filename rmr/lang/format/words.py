"""The tokens of a source text, each with its attached comments.

A comment that ends the line of a token is attached after that token. Every other one is attached before the next
token, on lines of its own or on the token's line. The attachment depends only on which side of the comment has a line
end. The printed text preserves that, so that formatting is idempotent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from rmr.lang.read.grammar import END
from rmr.lang.read.lexer import tokens

SPELLINGS = {"NE": "!=", "ARROW": "-o"}
"""Canonical spellings of the tokens that have two."""


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment and how it stood in the source."""

    text: str
    alone: bool
    """On lines of its own, or ended by the end of the line."""
    spaced: bool = False
    """Below a blank line."""

    @property
    def ends_line(self) -> bool:
        """Whether it is one that lasts to the end of the line."""
        return self.text.startswith("//")


@dataclass(slots=True)
class Word:
    """A token, the comments before it, and those that end its line."""

    kind: str
    """The grammar's name for it."""
    text: str
    before: Sequence[Comment] = ()
    after: Sequence[Comment] = ()
    spaced: bool = False
    """Below a blank line."""


@dataclass(frozen=True, slots=True)
class Text:
    """The tokens of a text and the comments behind the last one's line."""

    words: list[Word]
    end: Sequence[Comment]


@dataclass(slots=True)
class _Gap:
    """The gap between two tokens: its comments, and the number of line ends before each and before the next token."""

    lines: list[int]
    comments: list[str] = field(default_factory=list)


def read(text: str) -> Text:
    """Return the tokens of `text`, which has no syntax errors."""
    words: list[Word] = []
    gap = _Gap([1])  # the text begins with a line
    for token in tokens(text.replace("\r\n", "\n"), ignored=True):
        if token.kind == "WHITESPACE":
            gap.lines[-1] += token.text.count("\n")
        elif token.kind == "COMMENT":
            gap.comments.append(token.text.rstrip(" \t\r\f") if token.text.startswith("//") else token.text)
            gap.lines.append(0)
        elif token.kind != END:
            word = Word(token.kind, SPELLINGS.get(token.kind, token.text), spaced=gap.lines[-1] > 1)
            if gap.comments:
                word.before = _settled(gap, words[-1] if words else None)
            words.append(word)
            gap = _Gap([0])
    gap.lines[-1] += 1  # and ends one
    end = _settled(gap, words[-1] if words else None)
    _defer(words)
    return Text(words, end)


def _settled(gap: _Gap, previous: Word | None) -> list[Comment]:
    """Give `previous` the comments that end its line and return the others."""
    comments: list[Comment] = []
    alone = False
    for each, (above, below) in reversed(list(zip(gap.comments, pairwise(gap.lines), strict=True))):
        alone = each.startswith("//") or (above > 0 and (below > 0 or alone))
        comments.append(Comment(each, alone, above > 1))
    comments.reverse()
    count = 0
    while count < len(comments) and gap.lines[count] == 0:
        count += 1
    if previous is None or count == 0 or gap.lines[count] == 0:
        return comments
    previous.after = comments[:count]
    return comments[count:]


def _defer(words: list[Word]) -> None:
    """Move comments that need a line end from before a `,` to behind it, and one before a `.` if it is the last."""
    for i, word in enumerate(words):
        if word.text != ",":
            continue
        previous = words[i - 1]
        following = words[i + 1]
        if any(each.alone for each in (*previous.after, *word.before)):
            below = [*word.before, *(replace(each, alone=each.ends_line) for each in word.after)]
            following.before = [*below, *following.before]
            word.before = ()
            word.after = previous.after
            previous.after = ()
    for previous, word in pairwise(words):
        if word.text == "." and not word.before and not word.after:
            word.after = previous.after
            previous.after = ()
