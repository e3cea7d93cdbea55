"""The unexpected token of a syntax error: its context, its message and the hint."""

import re
from typing import NamedTuple

from rmr.lang.read.automaton import Automaton
from rmr.lang.read.grammar import END
from rmr.lang.read.lexer import BAD_NUMBER, OPEN_STRING, UNKNOWN, Token, scanner, spelling
from rmr.lang.read.source_text import Span

WORD_SHOWN_MAX = 40
OR_HINT = "write a rule for each case; between conditions, not facts, `||` is or"

_CALLED = {
    "ARROW": "`-o`",
    "MINUS": "`-`",
    "NE": "`!=`",
    "VARIABLE": "a variable",
    "NAME": "a name",
    "ROBOT": "a robot",
    "INT": "a number",
    "FLOAT": "a number",
    "TIME": "a number",
    "STRING": "a string",
    END: "the end of the file",
}
"""Names in hints of terminals without a fixed spelling."""
_HIDDEN = {
    *("FLOAT", "TIME", "ROBOT", "TRUE", "FALSE", "SENSOR", "UNORDERED", "SHARED", "LIST"),
    *("OR", "AND", "EQ", "NE", "LT", "LE", "GT", "GE", "PLUS", "MINUS", "TIMES", "DIVIDE", "MODULO"),
}
"""Terminals left out of hints: operators, and values that "a number" or "a name" already covers."""

_FOREIGN_HINTS = (
    (re.compile(r"--*[>o]|=>|:-|[→⇒⟶⊢]|[\u2013\u2014\u2212]o"), "a rule is written `body -o head.`"),
    (re.compile(r"===?|=:=|:=|≡"), "equality is written `=`"),
    (re.compile(r"=?\\=+|!==|≠"), "inequality is written `!=`"),
    (re.compile(r"=<|≤"), "at most is written `<=`"),
    (re.compile(r"≥"), "at least is written `>=`"),
    (re.compile(r"\*\*|\^"), "there is no power: `X * X`"),
    (re.compile(r"/="), "inequality is written `!=`; no variable changes its value"),
    (re.compile(r"\+\+|[-+*]="), "no variable changes its value: `N + 1` is another value"),
    (re.compile(r"#"), "comments begin with `//`"),
    (re.compile(r"(?i:and)\b|&|∧"), "write `,` between conditions, or `&&`"),
    (re.compile(r"(?i:or)\b|\u2228"), "write `||`"),
)
"""Signs of other languages, with the hint at the sign of RMR."""


class Misfit(NamedTuple):
    """An unexpected token with its context."""

    file: str
    text: str
    previous: Token
    following: list[Token]
    """The unexpected token and the look-ahead behind it."""
    begins: bool
    """True if the token stands where an item may begin: first on its line, not indented."""

    @property
    def word(self) -> Token:
        """The unexpected token."""
        return self.following[0]

    @property
    def before(self) -> Span:
        """The empty span behind the previous token."""
        return Span(self.file, self.previous.end, self.previous.end)

    def span(self, token: Token) -> Span:
        """Return the place of `token`."""
        return Span(self.file, token.start, token.end)


def unexpected(automaton: Automaton, misfit: Misfit) -> tuple[str, Span, str | None]:
    """Return message, span and hint for an unexpected token."""
    word = misfit.word
    span = misfit.span(word)
    if word.kind == OPEN_STRING:
        end = misfit.text.find("\n", word.end)
        return "this string has no end", Span(misfit.file, word.start, len(misfit.text) if end < 0 else end), '`"`'
    if word.kind == BAD_NUMBER:
        return f"{quoted(word)} is no number", span, "times are written `500ms`, `2s` and `1.5min`"
    if word.kind in {"DOT", END} and word is not misfit.previous:
        message = "the item ends too early" if word.kind == "DOT" else "the file ends inside this item"
        return (
            message,
            Span(misfit.file, max(0, misfit.previous.end - 1), misfit.previous.end),
            _hint(automaton, misfit),
        )
    return f"unexpected {quoted(word)}", span, _hint(automaton, misfit)


def quoted(word: Token) -> str:
    """Return a token as messages quote it."""
    if word.kind == END:
        return "the end of the file"
    if word.kind == UNKNOWN and not word.text.isprintable():
        return f"character {ord(word.text)}"
    text = word.text if len(word.text) <= WORD_SHOWN_MAX else word.text[:WORD_SHOWN_MAX] + "..."
    return f"`{text}`"


def foreign_hint(text: str, start: int) -> str | None:
    """Return the hint for a sign of another language at `start`, or None."""
    return next((hint for sign, hint in _FOREIGN_HINTS if sign.match(text, start)), None)


def _hint(automaton: Automaton, misfit: Misfit) -> str | None:
    foreign = foreign_hint(misfit.text, misfit.word.start)
    if foreign is not None:
        return foreign
    expected = automaton.accepted()
    if "DOT" in expected and (misfit.begins or misfit.word.kind == END):
        return "every item ends with `.`"
    words = sorted({word for kind in expected if kind not in _HIDDEN and (word := word_of(kind)) is not None})
    return "expected " + " or ".join(words) if 0 < len(words) <= 6 else None


def word_of(kind: str) -> str | None:
    """Return the name of a terminal in hints; None for skipped ones."""
    if kind in _CALLED or kind in scanner().ignored:
        return _CALLED.get(kind)
    return f"`{spelling(kind)}`"
