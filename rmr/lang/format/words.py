"""The words of a source text, each with the comments that belong to it.

A comment that ends the line of a word stands after that word. Every other one stands before the next word: on
lines of its own, or on the word's line. What decides is only which of its two sides has a line end, and that is
what the printed text keeps, so that formatting it again changes nothing.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

from lark import Token

from rmr.lang.grammar import grammar

SPELLINGS = {"NE": "!=", "ARROW": "-o"}
"""The kinds of words that can be written in two ways, and the one that stays."""


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
    """A word, the comments before it, and those that end its line."""

    kind: str
    """The grammar's name for it."""
    text: str
    before: list[Comment] = field(default_factory=list)
    after: list[Comment] = field(default_factory=list)
    spaced: bool = False
    """Below a blank line."""


@dataclass(frozen=True, slots=True)
class Text:
    """The words of a text and the comments behind the last one's line."""

    words: list[Word]
    end: list[Comment]


@dataclass(slots=True)
class _Gap:
    """What stands between two words: comments, and the number of line ends before each and before the next word."""

    comments: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=lambda: [0])


def read(text: str) -> Text:
    """Return the words of `text`, which has no syntax errors."""
    words: list[Word] = []
    gap = _Gap()
    gap.lines[0] = 1  # the text begins with a line
    for token in grammar().lex(text.replace("\r\n", "\n"), dont_ignore=True):
        if token.type == "WHITESPACE":
            gap.lines[-1] += token.count("\n")
        elif token.type == "COMMENT":
            gap.comments.append(_comment_text(token))
            gap.lines.append(0)
        else:
            words.append(Word(token.type, SPELLINGS.get(token.type, str(token))))
            words[-1].before, words[-1].spaced = _settled(gap, words[-2] if len(words) > 1 else None)
            gap = _Gap()
    gap.lines[-1] += 1  # and ends one
    end, _ = _settled(gap, words[-1] if words else None)
    _defer(words)
    return Text(words, end)


def _comment_text(token: Token) -> str:
    return token.rstrip(" \t\r\f") if token.startswith("//") else str(token)


def _settled(gap: _Gap, previous: Word | None) -> tuple[list[Comment], bool]:
    """Give `previous` the comments that end its line; return the others, and whether a blank line follows them."""
    comments: list[Comment] = []
    alone = False
    for each, (above, below) in reversed(list(zip(gap.comments, pairwise(gap.lines), strict=True))):
        alone = each.startswith("//") or (above > 0 and (below > 0 or alone))
        comments.append(Comment(each, alone, above > 1))
    comments.reverse()
    count = 0
    while count < len(comments) and gap.lines[count] == 0:
        count += 1
    if previous is not None and count and gap.lines[count]:
        previous.after = comments[:count]
        return comments[count:], gap.lines[-1] > 1
    return comments, gap.lines[-1] > 1


def _defer(words: list[Word]) -> None:
    """Move comments that need a line end from before a `,` to behind it, and one before a `.` if it is the last."""
    for i in range(1, len(words) - 1):
        previous, word, following = words[i - 1 : i + 2]
        if word.text == "," and any(each.alone for each in (*previous.after, *word.before)):
            below = [*word.before, *(replace(each, alone=each.ends_line) for each in word.after)]
            following.before = below + following.before
            word.before, word.after, previous.after = [], previous.after, []
    for previous, word in pairwise(words):
        if word.text == "." and not word.before and not word.after:
            word.after, previous.after = previous.after, []
