"""The parser's tables, made from the grammar once per machine and kept in the user's cache.

lark reads the grammar and works out the LALR(1) automaton; what it takes to run it is plain data (`Tables`), small
and quick to load, so that lark itself is needed only where the tables are made. What stands in the cache is found
by the grammar's checksum, names the grammar that it was made from, begins with a checksum of its own, is written
whole or not at all, and is made anew whenever it cannot be used; a machine without a writable cache does without.
It is data, never code.
"""

import json
import os
import re
import zlib
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from lark import Lark
    from lark.grammar import Rule as LarkRule

VERSION = 2
"""Of the tables' form and the file's."""

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
    """A terminal: how it is spelt."""

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
    words: list[Terminal]
    """In the order in which they are tried."""
    ignored: list[str]


@cache
def tables() -> Tables:
    """Return the tables, made or loaded once per process."""
    text = grammar_text()
    try:
        path = cache_path(text)
    except RuntimeError:  # a user without a home
        return _made(grammar())
    with suppress(Exception):  # absent, or left by a broken disk: whatever it is, it is made anew
        checksum, _, content = path.read_bytes().partition(b"\n")
        kept = json.loads(content)
        if checksum == _checksum(content) and kept["grammar"] == text and kept["version"] == VERSION:
            return _loaded(kept)
    made = _made(grammar())
    _keep({"grammar": text, "version": VERSION, **made._asdict()}, path)
    return made


def grammar_text() -> str:
    """Return the grammar."""
    return Path(__file__).with_name("rmr.lark").read_text(encoding="utf-8")


def cache_path(text: str) -> Path:
    """Return where the tables of the grammar `text` are kept. Raises RuntimeError for a user without a home."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    return home / "rmr" / f"grammar-{zlib.crc32(text.encode()):08x}.json"


@cache
def grammar() -> "Lark":
    """Return lark's view of the grammar; making it takes some 60 ms."""
    from lark import Lark  # noqa: PLC0415 - not where the tables are at hand

    return Lark(grammar_text(), parser="lalr", lexer="contextual", start="item")


def _checksum(content: bytes) -> bytes:
    return b"%08x" % zlib.crc32(content)


def _keep(tables: dict[str, Any], path: Path) -> None:
    import tempfile  # noqa: PLC0415 - once per machine

    content = json.dumps(tables, separators=(",", ":")).encode()
    temporary = ""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(descriptor, "wb") as file:
            file.write(_checksum(content) + b"\n" + content)
        os.replace(temporary, path)
    except OSError:
        if temporary:
            Path(temporary).unlink(missing_ok=True)


def _loaded(kept: dict[str, Any]) -> Tables:
    rules = [GrammarRule(*rule) for rule in kept["rules"]]
    words = [Terminal(*word) for word in kept["words"]]
    return Tables(kept["actions"], kept["start"], kept["end"], rules, words, kept["ignored"])


# ---- from lark's data


def _made(lark: "Lark") -> Tables:
    automaton = lark.parser.parser._parse_table
    index = {id(rule): number for number, rule in enumerate(lark.rules)}
    actions = [
        {symbol: ~index[id(goal)] if kind.name == "Reduce" else goal for symbol, (kind, goal) in row.items()}
        for _, row in sorted(automaton.states.items())
    ]
    [start], [end] = automaton.start_states.values(), automaton.end_states.values()
    return Tables(actions, start, end, [_rule(rule) for rule in lark.rules], _words(lark), list(lark.ignore_tokens))


def _rule(rule: "LarkRule") -> GrammarRule:
    """Return what lark makes of the symbols of `rule`: words that spell themselves are left out."""
    present = iter(enumerate(rule.expansion))
    children: list[int | None] = []
    for absent in rule.options.empty_indices or (False,) * len(rule.expansion):
        if absent:
            children.append(None)
            continue
        number, symbol = next(present)
        if not getattr(symbol, "filter_out", False):
            children.append(~number if symbol.name.startswith("_") and not symbol.is_term else number)
    origin = str(rule.origin.name)
    name = "" if origin.startswith("_") else str(rule.alias or origin)
    return GrammarRule(name, origin, len(rule.expansion), children, bool(rule.options.expand1 and not rule.alias))


def _words(lark: "Lark") -> list[Terminal]:
    """Return the terminals, fixed spellings last and the longest of them first."""

    def order(word: Any) -> tuple[object, ...]:
        return -word.priority, word.pattern.type == "str", -len(word.pattern.value), word.name

    return [
        Terminal(
            word.name,
            word.pattern.value if word.pattern.type == "str" else None,
            word.pattern.to_regexp() if word.pattern.type == "re" else re.escape(word.pattern.value),
            word.priority > 0,
        )
        for word in sorted(lark.terminals, key=order)
    ]
