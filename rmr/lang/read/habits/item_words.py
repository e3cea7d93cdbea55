"""A word that does not fit with the words of its item around it, and what a habit is."""

from itertools import pairwise
from typing import NamedTuple

from rmr.lang.read.lexer import Token
from rmr.lang.read.source_text import Span

OPENING = {"LPAR": 1, "LSQB": 1, "LBRACE": 1, "RPAR": -1, "RSQB": -1, "RBRACE": -1}
OPERANDS = {"VARIABLE", "INT", "FLOAT", "TIME", "RPAR", "RSQB"}
NUMBERS = {"INT", "FLOAT", "TIME"}

RULE = "a rule is written `body -o head.`"


class Habit(NamedTuple):
    """The report of a habit, and what is read instead."""

    message: str
    span: Span
    hint: str
    patch: tuple[int, int, tuple[Token, ...]] | None = None
    """From where to where these words stand instead; None: the item is given up."""
    uncertain: bool = False
    """The item may say something else than what is read instead."""
    code: str = "E001"


class MisfitContext(NamedTuple):
    """The words of an item around the one that does not fit."""

    file: str
    text: str
    words: list[Token]
    at: int
    """Which of the words does not fit."""

    @property
    def word(self) -> Token:
        """What does not fit."""
        return self.words[self.at]

    def kind(self, offset: int) -> str:
        """Return the kind of a word before or behind the misfit; empty where there is none."""
        index = self.at + offset
        return self.words[index].kind if 0 <= index < len(self.words) else ""

    @property
    def item_kinds(self) -> list[str]:
        """The kinds of the item's words, as far as one has looked, up to its full stop."""
        kinds = [word.kind for word in self.words]
        return kinds[: kinds.index("DOT")] if "DOT" in kinds else kinds

    def span(self, first: Token, last: Token | None = None) -> Span:
        """Return the place of some words."""
        return Span(self.file, first.start, (last or first).end)

    def before(self, kind: str) -> int | None:
        """Return the index of the nearest word of `kind` before the misfit."""
        return next((k for k in range(self.at - 1, -1, -1) if self.words[k].kind == kind), None)

    @property
    def is_in_head(self) -> bool:
        """Whether an arrow stands before the misfit."""
        return self.before("ARROW") is not None

    def unclosed(self) -> int | None:
        """Return the index of the innermost bracket that is open at the misfit."""
        depth = 0
        for index in range(self.at - 1, -1, -1):
            depth -= OPENING.get(self.words[index].kind, 0)
            if depth < 0:
                return index
        return None

    @property
    def is_closed_behind(self) -> bool:
        """Whether the bracket that is open at the misfit is closed before the item ends."""
        depth = 0
        for word in self.words[self.at :]:
            depth += OPENING.get(word.kind, 0)
            if depth < 0 or word.kind == "DOT":
                return depth < 0
        return False

    def given_up(self, message: str, hint: str, first: Token | None = None, last: Token | None = None) -> Habit:
        """Say what is wrong from `first` to `last`, by default the misfit, of an item that is not read."""
        return Habit(message, self.span(first or self.word, last), hint)

    def meant(self, message: str, hint: str, first: Token, last: Token, *words: tuple[str, str]) -> Habit:
        """Say that `words`, kinds and texts, are meant where the words from `first` to `last` stand."""
        tokens = tuple(Token(kind, text, first.start, last.end) for kind, text in words)
        return Habit(message, self.span(first, last), hint, (first.start, last.end, tokens))


def quoted(token: Token) -> str:
    """Return how a message calls a word."""
    return f"`{token.text}`"


def touch(*tokens: Token) -> bool:
    """Whether words stand side by side without blanks."""
    return all(one.end == other.start for one, other in pairwise(tokens))
