"""The grammar's text, and the form of its LALR(1) tables as plain data."""

import zlib
from pathlib import Path
from typing import NamedTuple

END = "$END"
"""The terminal behind the last word of an item."""


class GrammarRule(NamedTuple):
    """One right side of a grammar rule: what becomes of its children when it is recognised."""

    name: str
    """Of the method that builds its node; empty for a repetition, whose children become those of the rule around it."""
    origin: str
    """The left side."""
    length: int
    children: list[int | None]
    """Which symbols matter: k the k-th, ~k the children of the k-th, which is a repetition, None an absent option."""
    single: bool
    """With one child it is no more than that child."""


class Terminal(NamedTuple):
    """How a terminal is spelt."""

    name: str
    spelling: str | None
    """None if there is more than one."""
    pattern: str
    """A regular expression."""
    first: bool
    """It is tried before all that are not."""


class Tables(NamedTuple):
    """The automaton: its states are numbers, the first one `start`; with `end` an item is complete."""

    actions: list[dict[str, int]]
    """By state and symbol: the state to go to, or ~r to recognise rule r."""
    start: int
    end: int
    rules: list[GrammarRule]
    terminals: list[Terminal]
    """In the order in which they are tried."""
    ignored: list[str]


TABLES_FILE = Path(__file__).with_name("tables.json")


def grammar_text() -> str:
    """Return the grammar."""
    return Path(__file__).with_name("rmr.lark").read_text(encoding="utf-8")


def checksum(text: str) -> str:
    """Return what tables call the grammar `text` that they were made from."""
    return f"{zlib.crc32(text.encode()):08x}"
