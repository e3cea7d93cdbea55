"""The context of an unexpected token within its item, and the report of a habit."""

from itertools import pairwise
from typing import NamedTuple

from rmr.lang.read.lexer import Token
from rmr.lang.read.source_text import Span

OPENING = {"LPAR": 1, "LSQB": 1, "LBRACE": 1, "RPAR": -1, "RSQB": -1, "RBRACE": -1}
OPERANDS = {"VARIABLE", "INT", "FLOAT", "TIME", "RPAR", "RSQB"}
NUMBERS = {"INT", "FLOAT", "TIME"}

RULE = "a rule is written `body -o head.`"


class Habit(NamedTuple):
    """The report of a habit, and the tokens to read instead."""

    message: str
    span: Span
    hint: str
    patch: tuple[int, int, tuple[Token, ...]] | None = None
    """Start and end of the replaced text, and the replacement; None if the item is given up."""
    uncertain: bool = False
    """True if the patched item may differ from the intended one."""
    code: str = "E001"


class MisfitContext(NamedTuple):
    """The tokens of an item around the unexpected one."""

    file: str
    text: str
    words: list[Token]
    at: int
    """Index of the unexpected token."""

    @property
    def word(self) -> Token:
        """The unexpected token."""
        return self.words[self.at]

    def kind(self, offset: int) -> str:
        """Return the kind of a token before or behind the unexpected token; empty where there is none."""
        index = self.at + offset
        return self.words[index].kind if 0 <= index < len(self.words) else ""

    @property
    def item_kinds(self) -> list[str]:
        """The kinds of the item's tokens up to its full stop or the end of the look-ahead."""
        kinds = [word.kind for word in self.words]
        return kinds[: kinds.index("DOT")] if "DOT" in kinds else kinds

    def span(self, first: Token, last: Token | None = None) -> Span:
        """Return the span from `first` to `last`."""
        return Span(self.file, first.start, (last or first).end)

    def before(self, kind: str) -> int | None:
        """Return the index of the nearest token of `kind` before the unexpected token."""
        return next((k for k in range(self.at - 1, -1, -1) if self.words[k].kind == kind), None)

    @property
    def is_in_head(self) -> bool:
        """Whether an arrow stands before the unexpected token."""
        return self.before("ARROW") is not None

    def unclosed(self) -> int | None:
        """Return the index of the innermost bracket that is open at the unexpected token."""
        depth = 0
        for index in range(self.at - 1, -1, -1):
            depth -= OPENING.get(self.words[index].kind, 0)
            if depth < 0:
                return index
        return None

    @property
    def is_closed_behind(self) -> bool:
        """Whether the bracket that is open at the unexpected token is closed before the item ends."""
        depth = 0
        for word in self.words[self.at :]:
            depth += OPENING.get(word.kind, 0)
            if depth < 0 or word.kind == "DOT":
                return depth < 0
        return False

    def given_up(self, message: str, hint: str, first: Token | None = None, last: Token | None = None) -> Habit:
        """Return the report of a dropped item, at `first` to `last`, by default the unexpected token."""
        return Habit(message, self.span(first or self.word, last), hint)

    def meant(self, message: str, hint: str, first: Token, last: Token, *words: tuple[str, str]) -> Habit:
        """Return the report of a patch: `words` (kind, text) replace the tokens from `first` to `last`."""
        tokens = tuple(Token(kind, text, first.start, last.end) for kind, text in words)
        return Habit(message, self.span(first, last), hint, (first.start, last.end, tokens))


def quoted(token: Token) -> str:
    """Return a token as messages quote it."""
    return f"`{token.text}`"


def touch(*tokens: Token) -> bool:
    """Whether tokens are adjacent, without blanks between them."""
    return all(one.end == other.start for one, other in pairwise(tokens))
