"""The pretty printer: marks to lines, by the choice of line breaks (groups as in Oppen, 1980).

A group stands on one line if it fits together with the text up to the next possible break; otherwise each of its own
breaks is used, and the groups in it are tried in turn. A comment that needs a line end breaks every group with tokens
before and behind it. The width of a group is the difference of two prefix sums, so that the work is linear in the
length of the text, independent of nesting.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

COLUMNS_MAX = 100
"""Largest width of a line, except for comments and tokens that are longer themselves."""

TIGHT = frozenset({",", ".", ":", ")", "]", "}"})
"""Tokens that have no space before them."""
OPENING = frozenset({"(", "[", "{"})


class Sign(Enum):
    """Marks that carry nothing."""

    SPACE = auto()
    BREAK = auto()
    """A place for a line end: nothing where its group stands on one line."""
    BLANK = auto()
    """A blank line."""
    BEGIN = auto()
    """The beginning of a group."""
    END = auto()


@dataclass(frozen=True, slots=True)
class Indent:
    """A change of the indentation of the following lines, in columns; negative to the left."""

    columns: int


@dataclass(frozen=True, slots=True)
class CommentMark:
    """A comment."""

    text: str
    alone: bool
    """No token follows on its line and, unless it is trailing, none stands before it."""
    trailing: bool
    """It stays on the line of the token before it."""


Mark = str | Sign | Indent | CommentMark
"""A token stands for itself."""


def printed(marks: Sequence[Mark], columns_max: float = COLUMNS_MAX) -> str:
    """Return the text of `marks`, without blank lines at its beginning and end."""
    widths = _widths(marks)
    pen = _Pen()
    broken = [True]
    for i, mark in enumerate(marks):
        if isinstance(mark, str):
            pen.write(mark)
        elif isinstance(mark, CommentMark):
            pen.note(mark)
        elif isinstance(mark, Indent):
            pen.indent += mark.columns
        elif mark is Sign.BEGIN:
            broken.append(broken[-1] and pen.column + widths[i] > columns_max)
        elif mark is Sign.END:
            broken.pop()
        elif mark is Sign.SPACE:
            pen.apart(_SPACE)
        elif mark is Sign.BLANK:
            pen.apart(_BLANK)
        elif broken[-1]:
            pen.apart(_LINE)
    return pen.text()


def _widths(marks: Sequence[Mark]) -> dict[int, float]:
    """Return the width of every group, by the index of its beginning; infinite if a comment breaks it."""
    columns = [0]
    words = [0]
    notes: list[tuple[int, int]] = []
    for mark in marks:
        if isinstance(mark, CommentMark) and mark.alone:
            notes.append((words[-1], columns[-1]))
        columns.append(columns[-1] + _width(mark))
        words.append(words[-1] + isinstance(mark, str))
    widths: dict[int, float] = {}
    ends: list[tuple[int, int]] = []
    limit = columns[-1]
    for i in range(len(marks) - 1, -1, -1):
        mark = marks[i]
        if mark is Sign.BREAK or (isinstance(mark, CommentMark) and mark.alone):
            limit = columns[i]
        elif mark is Sign.END:
            ends.append((words[i], limit))
        elif mark is Sign.BEGIN:
            end, limit_behind = ends.pop()
            first = bisect_left(notes, (words[i] + 1, 0))
            where, column = notes[first] if first < len(notes) else (end + 1, 0)
            reached = min(limit_behind, column) if where == end else limit_behind
            widths[i] = math.inf if where < end else reached - columns[i]
    return widths


def _width(mark: Mark) -> int:
    if isinstance(mark, str):
        return len(mark)
    if isinstance(mark, CommentMark):
        return 0 if mark.alone else len(mark.text) + 1
    return 1 if mark is Sign.SPACE else 0


_NOTHING, _SPACE, _WIDE, _LINE, _BLANK = range(5)
_GAPS = ("", " ", "  ", "\n", "\n\n")


class _Pen:
    """Writes tokens and comments, separated by the largest of the requested gaps."""

    def __init__(self) -> None:
        self.indent = 0
        self._written: list[str] = []
        self._gap = _NOTHING
        self._column = 0

    @property
    def column(self) -> int:
        """Where the next token begins, from 0."""
        return self.indent if self._gap >= _LINE else self._column + len(_GAPS[self._gap])

    def apart(self, gap: int) -> None:
        """Ask for a gap before what comes next; there is none before the first token."""
        if self._written:
            self._gap = max(self._gap, gap)

    def write(self, word: str) -> None:
        """Write a token; a tight one has no space before it, not even behind a comment."""
        if self._gap == _SPACE and word in TIGHT:
            self._gap = _NOTHING
        self._put(word)

    def note(self, note: CommentMark) -> None:
        """Write a comment."""
        if note.alone:
            self.apart(_WIDE if note.trailing else _LINE)
        elif self._written and self._written[-1] not in OPENING:
            self.apart(_SPACE)
        self._put(note.text)
        self.apart(_LINE if note.alone else _SPACE)

    def _put(self, text: str) -> None:
        column = self.column
        if self._gap:
            self._written.append(_GAPS[self._gap] + " " * self.indent if self._gap >= _LINE else _GAPS[self._gap])
        self._written.append(text)
        self._column = len(text) - text.rfind("\n") - 1 if "\n" in text else column + len(text)
        self._gap = _NOTHING

    def text(self) -> str:
        """Return what has been written, with a line end behind it if there is anything."""
        return "".join([*self._written, "\n"]) if self._written else ""
