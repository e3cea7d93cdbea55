"""Where lines may break: from tokens to marks for the printer.

An item stands on one line if it fits. If it does not, `-o` begins the line of the head; the conjuncts of the body
have a line each if they do not fit on one, and so have the head's items. What stands in brackets breaks by the same
rule, and so does an expression, before its loosest operators.

    location(R, L), edge(L, M)
        -o location(R, M),
           {B
               | peer(R, B)
               | moved(B, R, M)}.

Brackets are kept on a stack of frames and never recursed into; only the levels of operators are.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from rmr.lang.format.printer import OPENING, TIGHT, CommentMark, Indent, Mark, Sign
from rmr.lang.format.words import Comment, Text, Word

INDENT = 4
"""Indentation of continuation lines, in columns."""

LEVELS = (("then",), ("||",), ("&&",), ("=", "!=", "<", "<=", ">", ">="), ("+", "-"), ("*", "/", "%"))
"""Binary operators by precedence, loosest first."""
LEVEL = {operator: level for level, operators in enumerate(LEVELS) for operator in operators}

OPERANDS = frozenset(
    {
        "VARIABLE",
        "NAME",
        "INT",
        "FLOAT",
        "TIME",
        "ROBOT",
        "STRING",
        "TRUE",
        "FALSE",
        "RPAR",
        "RSQB",
        "END",
    },
)
"""Kinds of tokens that end an operand: a `-` behind one is binary."""
CALLED = frozenset({"NAME", "ASSERT", "WATCH", "IF", "END", "UNORDERED", "SHARED"})
"""Kinds of tokens with no space before a following `(`."""
CLOSING = frozenset({")", "]", "}"})
SECTIONS = frozenset({"-o", "else", "|"})
"""Tokens that begin a line if their group breaks."""


@dataclass(slots=True)
class _Part:
    """A token, a pair of brackets with all that is inside, or a comment."""

    marks: list[Mark]
    level: int | None = None
    """The level of an operator between operands."""
    comment: bool = False


@dataclass(slots=True)
class _Section:
    """A list of elements between commas; all sections but the first begin with a token such as `-o`."""

    word: Word | None = None
    elements: list[list[Mark]] = field(default_factory=list)


@dataclass(slots=True)
class _Frame:
    """The present state of an item, or of an open pair of brackets."""

    opening: list[Mark]
    matches: bool
    """A comprehension, an aggregate or a choice."""
    chooses: bool = False
    """A choice, from `if` to `end`."""
    sections: list[_Section] = field(default_factory=lambda: [_Section()])
    parts: list[_Part] = field(default_factory=list)
    """The parts of the present element."""

    def end_element(self, separator: list[Mark]) -> None:
        """End the present element, with `separator` (the comma) behind it."""
        if self.parts:
            self.sections[-1].elements.append(_element(self.parts) + separator)
            self.parts = []


def layout(text: Text) -> list[Mark]:
    """Return the marks of a whole text."""
    marks: list[Mark] = []
    for item in _items(text.words):
        marks += _above(item[0].before)
        marks += [Sign.BLANK] if item[0].spaced else []
        marks += [*_Reader(item).marks(), Sign.BREAK]
    return marks + _above(text.end)


def _items(words: list[Word]) -> Iterator[list[Word]]:
    item: list[Word] = []
    for word in words:
        item.append(word)
        if word.text == ".":
            yield item
            item = []
    assert not item, "the text ends inside an item"


def _above(comments: Sequence[Comment]) -> list[Mark]:
    """Return comments before an item."""
    marks: list[Mark] = []
    for each in comments:
        marks += [Sign.BLANK] if each.spaced else []
        marks.append(CommentMark(each.text, each.alone, trailing=False))
    return marks


class _Reader:
    """Reads the tokens of one item from left to right."""

    def __init__(self, item: list[Word]) -> None:
        self._item = item
        self._frames = [_Frame([], matches=False)]
        self._previous = item[0]
        self._before_previous = item[0]
        self._prefixed = False
        """Whether the previous token is a prefix."""
        self._derives = False
        """Whether the reader is behind the arrow, in the head."""
        self._chooses = False
        """Whether the previous token is the `if` of a choice."""

    def marks(self) -> list[Mark]:
        """Return the marks of the item, without the comments before it."""
        dot = self._item[-1]
        for i, word in enumerate(self._item[:-1]):
            if i:
                self._frames[-1].parts += _inside(word.before)
            self._read(word, self._spaced(word) if i else [])
        [root] = self._frames
        root.parts += _inside(dot.before)
        root.end_element([])
        first, *others = root.sections
        marks = [*_group(_lines(first.elements)), Indent(INDENT), *_behind(others), Indent(-INDENT)]
        return [*_group([*marks, dot.text]), *_trailing(dot)]

    def _read(self, word: Word, space: list[Mark]) -> None:
        frame = self._frames[-1]
        marks = [*space, word.text, *_trailing(word)]
        negates = word.text == "-" and not self._operand_ends()
        if self._begins_choice(word):
            self._frames.append(_Frame(marks, matches=True, chooses=True))
        elif frame.chooses and word.text == "end":
            frame.end_element([])
            self._frames.pop()
            self._frames[-1].parts.append(_Part(_brackets(frame, word)))
        elif frame.chooses and word.text == "then" and len(frame.sections) == 1:
            frame.end_element([])
            frame.sections.append(_Section(word))
        elif word.text in OPENING:
            matches = word.text == "{" or (word.text == "[" and self._derives and self._is_outside())
            self._frames.append(_Frame(marks, matches))
        elif word.text in CLOSING:
            frame.end_element([])
            self._frames.pop()
            self._frames[-1].parts.append(_Part(_brackets(frame, word)))
        elif word.text == ",":
            frame.end_element(marks)
        elif word.text in SECTIONS:
            frame.end_element([])
            frame.sections.append(_Section(word))
        else:
            equates = word.text == "=" and self._item[0].kind in {"CONST", "FUN"}
            frame.parts.append(_Part(marks, None if negates or equates else LEVEL.get(word.text)))
        self._chooses = self._begins_choice(word)
        self._derives = self._derives or word.text == "-o"
        # Prefix tokens, with no space behind them; a unary `-` is one as well.
        self._prefixed = negates or word.text in {"!", "$", "?"}
        self._before_previous = self._previous
        self._previous = word

    def _spaced(self, word: Word) -> list[Mark]:
        """Return the space between the previous token and this one, or nothing."""
        if word.text in TIGHT or self._previous.text in OPENING:
            return []
        if self._prefixed:  # a `-` before the name `o` would be an arrow
            return [Sign.SPACE] if self._previous.text == "-" and word.text == "o" else []
        tight = self._previous.kind in CALLED and not self._chooses and not self._aggregates()
        if word.text == "(" and tight:
            return []
        return [Sign.SPACE]

    def _is_outside(self) -> bool:
        """Whether no bracket is open."""
        return len(self._frames) == 1 or self._frames[-1].chooses

    def _begins_choice(self, word: Word) -> bool:
        """Whether a token is an `if` where an item of the head begins; elsewhere it is a function."""
        begins = self._previous.text in {"-o", ",", "then", "else"}
        return word.text == "if" and self._derives and self._is_outside() and begins and not self._frames[-1].parts

    def _operand_ends(self) -> bool:
        return self._previous.kind in OPERANDS and not self._aggregates()

    def _aggregates(self) -> bool:
        """Whether the previous token is the operator of an aggregate, such as `sum`."""
        inside = len(self._frames) >= 2 and self._frames[-1].matches and not self._frames[-1].chooses
        return inside and self._previous.kind == "NAME" and self._before_previous.text == "["


# ---- groups


def _group(marks: list[Mark]) -> list[Mark]:
    """Return a group of `marks`; the space before it is not part of it."""
    if marks and marks[0] is Sign.SPACE:
        return [Sign.SPACE, Sign.BEGIN, *marks[1:], Sign.END]
    return [Sign.BEGIN, *marks, Sign.END]


def _lines(elements: Iterable[list[Mark]]) -> list[Mark]:
    """Return elements with places for breaks between them."""
    return [mark for i, element in enumerate(elements) for mark in ([Sign.BREAK] if i else []) + element]


def _behind(sections: list[_Section]) -> list[Mark]:
    """Return sections, each on a line that begins with its token."""
    marks: list[Mark] = []
    for each in sections:
        assert each.word is not None
        width = len(each.word.text) + 1
        marks += [Sign.BREAK, Sign.SPACE, each.word.text, *_trailing(each.word)]
        marks += [Indent(width), *_group(_lines(each.elements)), Indent(-width)]
    return marks


def _brackets(frame: _Frame, closing: Word) -> list[Mark]:
    """Return a pair of brackets with what is inside of them."""
    first, *others = frame.sections
    marks = [*frame.opening, Indent(INDENT)]
    if frame.matches:
        marks += [*_group(_lines(first.elements)), *_behind(others), Indent(-INDENT)]
        marks += [Sign.BREAK, Sign.SPACE] if frame.chooses else []
    elif first.elements:
        marks += [Sign.BREAK, *_lines(first.elements), *_behind(others), Indent(-INDENT), Sign.BREAK]
    else:
        marks += [Indent(-INDENT)]
    return [*_group([*marks, closing.text]), *_trailing(closing)]


def _element(parts: list[_Part]) -> list[Mark]:
    """Return the marks of an element; comments at its ends are outside of its groups and break none of them."""
    first = 0
    last = len(parts)
    while first < last and parts[first].comment:
        first += 1
    while last > first and parts[last - 1].comment:
        last -= 1
    return [*_joined(parts[:first]), *_operands(parts[first:last], 0), *_joined(parts[last:])]


def _operands(parts: list[_Part], level: int) -> list[Mark]:
    """Return an expression that breaks before its loosest operators of `level` or tighter."""
    used = [each.level for each in parts if each.level is not None and each.level >= level]
    if not used:
        return _joined(parts)
    loosest = min(used)
    starts = [0, *(i for i, each in enumerate(parts) if each.level == loosest), len(parts)]
    first, *others = (_operands(parts[start:end], loosest + 1) for start, end in pairwise(starts))
    return _group([*first, Indent(INDENT), Sign.BREAK, *_lines(others), Indent(-INDENT)])


def _joined(parts: list[_Part]) -> list[Mark]:
    return [mark for each in parts for mark in each.marks]


# ---- comments


def _inside(comments: Sequence[Comment]) -> list[_Part]:
    return [_Part([CommentMark(each.text, each.alone, trailing=False)], comment=True) for each in comments]


def _trailing(word: Word) -> list[Mark]:
    """Return the comments that end a token's line."""
    return [CommentMark(each.text, each.ends_line, trailing=True) for each in word.after]
