"""A lexer for Pygments: the compiler's own tokens with Pygments's names, so that no second grammar can differ.

Pygments finds it by an entry point, under the name `rmr` and by `*.rmr`; so do Sphinx and MkDocs.
"""

from collections.abc import Iterator

from pygments.lexer import Lexer  # type: ignore[import-untyped]
from pygments.token import (  # type: ignore[import-untyped]
    Comment,
    Error,
    Keyword,
    Name,
    Number,
    Operator,
    Punctuation,
    String,
    Whitespace,
)

from rmr.lang.read.habits import AGGREGATES
from rmr.lang.read.lexer import Token, scanner, tokens
from rmr.lang.read.tables import tables

WORDS = {
    "VARIABLE": Name.Variable,
    "ROBOT": Name.Constant,
    "INT": Number.Integer,
    "FLOAT": Number.Float,
    "TIME": Number,
    "STRING": String.Double,
    "WHITESPACE": Whitespace,
    "TRUE": Keyword.Constant,
    "FALSE": Keyword.Constant,
    "LIST": Keyword.Type,
    **dict.fromkeys(
        ("TYPE", "CONST", "FUN", "INCLUDE", "ORDER", "ACTION", "SENSOR", "UNORDERED", "SHARED"), Keyword.Declaration
    ),
    **dict.fromkeys(("LPAR", "RPAR", "LSQB", "RSQB", "LBRACE", "RBRACE", "COMMA", "DOT", "COLON", "VBAR"), Punctuation),
}
"""Terminals of the grammar with the tokens of Pygments; the other keywords are keywords, the other signs operators."""

TYPES = frozenset({"robot", "int", "float", "bool", "string"})
"""Names of types: those of sets of symbols are the program's."""


class RmrLexer(Lexer):  # type: ignore[misc]
    """Tokens of RMR programs for Pygments."""

    name = "RMR"
    aliases = ["rmr"]  # noqa: RUF012 - as Pygments declares them
    filenames = ["*.rmr"]  # noqa: RUF012
    mimetypes = ["text/x-rmr"]  # noqa: RUF012

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, object, str]]:
        """Yield the offset, the token of Pygments and the text of each word, blanks and comments included."""
        words = list(tokens(text, ignored=True))[:-1]
        for index, word in enumerate(words):
            yield word.start, _kind(word, words[index + 1 : index + 3]), word.text


def _kind(word: Token, behind: list[Token]) -> object:
    """Return the token of Pygments for a word, given the two behind it."""
    if word.kind == "COMMENT":
        return Comment.Single if word.text.startswith("//") else Comment.Multiline
    if word.kind == "NAME":
        return _name(word.text, behind)
    if word.kind in WORDS:
        return WORDS[word.kind]
    if word.kind in scanner().reserved.values():
        return Keyword
    # Error tokens, of what the language does not have, are no terminals of the grammar.
    return Operator if any(each.name == word.kind for each in tables().terminals) else Error


def _name(text: str, behind: list[Token]) -> object:
    kinds = [each.kind for each in behind if each.kind != "WHITESPACE"]
    if kinds[:1] == ["LPAR"]:
        return Name.Builtin if text in AGGREGATES else Name.Function
    if kinds[:1] == ["COLON"]:
        return Name.Label
    if text in TYPES:
        return Keyword.Type
    return Name.Builtin if text in AGGREGATES else Name
