"""From source text to the syntax tree, one item at a time.

The text is first cut into items at every `.` that stands outside of comments, strings and numbers. Each item
is parsed on its own, so that a syntax error costs that item and no other, and so that the place after the
last mistake is never in doubt. Nesting is bounded before anything walks a tree.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from lark import Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from rmr.lang.build import RESERVED, Builder, in_range
from rmr.lang.diagnostic import Diagnostics
from rmr.lang.grammar import grammar
from rmr.lang.source import Source, Span
from rmr.lang.syntax import Item, Literal, Module, walk

NESTING_MAX = 100
"""Brackets within brackets and operators within operators: more is a mistake or an attack on the stack."""

_PIECE = re.compile(
    r"""(?P<skip> //[^\n]* | /\*.*?\*/ | "(?:[^"\\\n]|\\[^\n])*" | [0-9]+\.[0-9]+ )
      | (?P<comment> /\* ) | (?P<string> " ) | (?P<dot> \. ) | (?P<open> [(\[{] ) | (?P<close> [)\]}] )""",
    re.VERBOSE | re.DOTALL,
)
_BLANK = re.compile(r"(?:[ \t\r\n\f\uFEFF]+|//[^\n]*|/\*.*?\*/)*", re.DOTALL)

_WORDS = {
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
    "$END": "the end",
    "<END-OF-FILE>": "the end",
}
"""What the tokens are called that do not spell themselves."""
_HIDDEN = {
    *("FLOAT", "TIME", "ROBOT", "TRUE", "FALSE", "SENSOR", "LIST"),
    *("OR", "AND", "EQ", "NE", "LT", "LE", "GT", "GE", "PLUS", "MINUS", "TIMES", "DIVIDE", "MODULO"),
}
"""Left out of hints: values where a number or a name is named anyway, and operators."""

_FOREIGN = (
    (re.compile(r"->|=>|:-"), "a rule is written `body -o head.`"),
    (re.compile(r"=="), "equality is written `=`"),
    (re.compile(r"#"), "comments begin with `//`"),
    (re.compile(r"(?i:and)\b"), "write `,` between conditions, or `&&`"),
    (re.compile(r"(?i:or)\b"), "write `||`"),
    (re.compile(r"[A-Z_][A-Za-z0-9_]*\s*\("), "names of facts and actions begin with a lower-case letter"),
)
"""What other languages write, at the place of a syntax error, and what RMR writes."""

EXPECTED_SHOWN_MAX = 6
WORD_SHOWN_MAX = 40


@dataclass(frozen=True, slots=True)
class _Chunk:
    """One item's text: its first character's offset and the offset after its `.` (or the end of the text)."""

    start: int
    end: int
    depth: int
    closed: bool
    spoiled: bool
    """What is wrong with it has been reported already."""


def parse(source: Source, found: Diagnostics) -> Module:
    """Return what `source` holds, and report every syntax error to `found`."""
    items: list[Item] = []
    broken: set[str] = set()
    for chunk in _chunks(source, found):
        item = _parse_chunk(source, chunk, found)
        if item is not None:
            items.append(item)
        else:
            broken.update(re.findall(r"[a-z][A-Za-z0-9_]*", source.text[chunk.start : chunk.end]))
    return Module(tuple(items), frozenset(broken))


def _chunks(source: Source, found: Diagnostics) -> Iterator[_Chunk]:
    text = source.text
    start = position = depth = deepest = 0
    spoiled = False
    while (matched := _PIECE.search(text, position)) is not None:
        position = matched.end()
        kind = matched.lastgroup
        if kind == "open":
            depth += 1
            deepest = max(deepest, depth)
        elif kind == "close":
            depth -= 1
        elif kind == "dot":
            yield _Chunk(start, position, deepest, closed=True, spoiled=spoiled)
            start, depth, deepest, spoiled = position, 0, 0, False
        elif kind == "comment":
            found.report("E001", "this comment has no end", _span(source, matched.start(), position), hint="`*/`")
            spoiled = True
            text, position = text[: matched.start()], len(text)
        elif kind == "string":
            end = _line_end(text, position)
            found.report("E001", "this string has no end", _span(source, matched.start(), end), hint='`"`')
            spoiled = True
    blank = _BLANK.match(text, start)
    if blank is not None and blank.end() < len(text):
        yield _Chunk(start, len(text), deepest, closed=False, spoiled=spoiled)


def _line_end(text: str, position: int) -> int:
    end = text.find("\n", position)
    return len(text) if end < 0 else end


def _span(source: Source, start: int, end: int) -> Span:
    return Span(source.file, start, end)


def _parse_chunk(source: Source, chunk: _Chunk, found: Diagnostics) -> Item | None:
    text = source.text[chunk.start : chunk.end]
    blank = _BLANK.match(text)
    skipped = blank.end() if blank is not None else 0
    whole = _span(source, chunk.start + skipped, chunk.end)
    if chunk.spoiled:
        return None
    if chunk.depth > NESTING_MAX:
        found.report("E004", f"brackets are nested more than {NESTING_MAX} deep", whole)
        return None
    try:
        tree = grammar().parse(text)
    except UnexpectedInput as error:
        _report_syntax(source, chunk, error, found)
        return None
    if _too_deep(tree):
        found.report("E004", f"the expression is nested more than {NESTING_MAX} deep", whole)
        return None
    item: Item = Builder(source.file, chunk.start, found).transform(tree)
    for node in walk(item):
        if isinstance(node, Literal) and not in_range(node.value):
            what = "a 64-bit float" if isinstance(node.value, float) else "64 bits"
            found.report("E005", f"this number does not fit into {what}", node.span)
    return item


def _too_deep(tree: Tree[Token]) -> bool:
    level: list[Tree[Token]] = [tree]
    for _ in range(NESTING_MAX + 10):
        level = [child for node in level for child in node.children if isinstance(child, Tree)]
        if not level:
            return False
    return True


def _report_syntax(source: Source, chunk: _Chunk, error: UnexpectedInput, found: Diagnostics) -> None:
    if isinstance(error, UnexpectedCharacters):
        start = chunk.start + (error.pos_in_stream or 0)
        span = _span(source, start, start + 1)
        what = f"`{source.text[start]}`" if source.text[start].isprintable() else f"character {ord(error.char)}"
        message = f"unexpected {what}"
    elif isinstance(error, UnexpectedToken) and error.token.type != "$END":
        token = error.token
        assert token.start_pos is not None
        assert token.end_pos is not None
        span = _span(source, chunk.start + token.start_pos, chunk.start + token.end_pos)
        word = "reserved word " if token in RESERVED else ""
        message = f"unexpected {word}{_quoted(token)}"
    else:
        end = len(source.text[: chunk.end].rstrip())
        span = _span(source, max(chunk.start, end - 1), end)
        message = "the file ends inside this item" if not chunk.closed else "the item ends too early"
    found.report("E001", message, span, hint=_hint(source, span, _expected(error)) if not found.many else None)


def _expected(error: UnexpectedInput) -> set[str]:
    if isinstance(error, UnexpectedCharacters):
        return set(error.allowed or ())
    return set(error.accepts) if isinstance(error, UnexpectedToken) else set()


def _quoted(word: str) -> str:
    return f"`{word}`" if len(word) <= WORD_SHOWN_MAX else f"`{word[:WORD_SHOWN_MAX]}...`"


def _hint(source: Source, span: Span, expected: set[str]) -> str | None:
    foreign = _foreign(source.text, span.start)
    if foreign is not None:
        return foreign
    first_of_line = not source.text[: span.start].rpartition("\n")[2].strip()
    if "DOT" in expected and (first_of_line or source.text[span.end :].strip() == ""):
        return "every item ends with `.`"
    words = sorted({word for name in expected if name not in _HIDDEN and (word := word_of(name)) is not None})
    return "expected " + " or ".join(words) if 0 < len(words) <= EXPECTED_SHOWN_MAX else None


def _foreign(text: str, start: int) -> str | None:
    """Return what to write instead of another language's sign whose first or second character stands at `start`."""
    for sign, hint in _FOREIGN:
        if sign.match(text, start):
            return hint
        begun = sign.match(text, start - 1) if start else None
        if begun is not None and not text[start].isalnum() and begun.end() == start + 1:
            return hint
    return None


def word_of(terminal: str) -> str | None:
    """Return what a token is called in a hint; None for what is skipped."""
    if terminal in _WORDS:
        return _WORDS[terminal]
    definition = next((each for each in grammar().terminals if each.name == terminal), None)
    return f"`{definition.pattern.value}`" if definition is not None and definition.pattern.type == "str" else None
