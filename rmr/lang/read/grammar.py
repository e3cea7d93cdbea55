"""The grammar's text, and the form of its LALR(1) tables as plain data."""

import zlib
from pathlib import Path
from typing import NamedTuple

END = "$END"
"""The terminal behind the last token of an item."""


class GrammarRule(NamedTuple):
    """One production of the grammar, with its semantic action."""

    name: str
    """The builder's method; empty for a repetition, whose children are spliced into the enclosing production."""
    origin: str
    """The nonterminal on the left side."""
    length: int
    """Number of symbols on the right side."""
    children: list[int | None]
    """Arguments of the method: k the k-th symbol, ~k the children of the k-th (a repetition), None an absent option."""
    single: bool
    """True if a production with one child stands for that child, without a node of its own."""


class Terminal(NamedTuple):
    """A terminal of the grammar."""

    name: str
    spelling: str | None
    """The fixed spelling; None for a regular expression."""
    pattern: str
    """A regular expression."""
    first: bool
    """True for a terminal with priority: it is tried before all others."""


class Tables(NamedTuple):
    """The LALR(1) automaton: states are numbers, `start` the first; in `end` an item is complete."""

    actions: list[dict[str, int]]
    """Actions by state and symbol: a state to shift or go to, or ~r to reduce by rule r."""
    start: int
    end: int
    rules: list[GrammarRule]
    terminals: list[Terminal]
    """Terminals in order of precedence."""
    ignored: list[str]


TABLES_FILE = Path(__file__).with_name("tables.json")


def grammar_text() -> str:
    """Return the grammar."""
    return Path(__file__).with_name("rmr.lark").read_text(encoding="utf-8")


def checksum(text: str) -> str:
    """Return the checksum by which tables identify the grammar `text` that they were made from."""
    return f"{zlib.crc32(text.encode()):08x}"
