"""Habits of whole items: rules the other way round, directives, queries, other tokens for declarations."""

from collections.abc import Iterator
from itertools import pairwise

from rmr.lang.read.habits.item_words import RULE, Habit, MisfitContext, quoted, touch
from rmr.lang.read.lexer import Token
from rmr.lang.read.tree_builder import RESERVED

FOREIGN_ITEMS = {
    "import": '`include "file.rmr".` puts in the items of another file',
    "from": '`include "file.rmr".` puts in the items of another file',
    "let": "a constant is `const n = 3.`",
    "var": "a constant is `const n = 3.`",
    "fact": "a fact is `name(R, 3).`",
    "rule": "a rule is `body -o head.`",
    "goal": "a goal is `?name(R, 3).`",
    "predicate": "`type name(robot, int).` declares a fact",
    "relation": "`type name(robot, int).` declares a fact",
    "action": "`type action name(robot).` declares an action",
    "sensor": "`type sensor name(robot).` declares a sensed fact",
}
RULE_WORDS = ("if", "when", "whenever", "on", "def", "for", "while", "return", "class", "function", "fn", "void")
"""Tokens with which other languages begin what RMR writes as a rule."""


def _reversed_rule(place: MisfitContext) -> Habit | None:
    """`head :- body.` and `head <- body.`"""
    arrow = next(_reversed_arrows(place), None)
    if arrow is None:
        return None
    first, last = arrow
    if first is place.words[0]:
        return place.given_up("there are no directives", "facts, rules and declarations are all there is", first, last)
    end = next((word for word in place.words if word.kind == "DOT" and word.start > last.start), None)
    body = place.text[last.end : end.start].strip() if end is not None else ""
    rule = f"{body} -o {place.text[place.words[0].start : first.start].strip()}."
    is_short = body and len(rule) <= 70 and "\n" not in rule  # a longer one is not shown rewritten
    hint = f"the body stands first: `{rule if is_short else 'body -o head.'}`"
    return place.given_up(f"unexpected `{place.text[first.start : last.end]}`", hint, first, last)


def _reversed_arrows(place: MisfitContext) -> Iterator[tuple[Token, Token]]:
    words = place.words
    if place.word.text == ":-":
        yield place.word, place.word
    for one, other in pairwise(words[: place.at + 1]):
        if one.kind == "LT" and other.kind == "MINUS" and touch(one, other) and not place.is_in_head:
            yield one, other


def _zero_arrow(place: MisfitContext) -> Habit | None:
    if place.kind(-1) != "INT" or place.kind(-2) != "MINUS" or place.word.kind not in {"NAME", "QUESTION", "LBRACE"}:
        return None
    minus, zero = place.words[place.at - 2 : place.at]
    if zero.text != "0" or not touch(minus, zero):
        return None
    return place.meant("unexpected `-0`", "the arrow is `-o`, with the letter o", minus, zero, ("ARROW", "-o"))


def _query(place: MisfitContext) -> Habit | None:
    if place.at == 1 and place.kind(-1) == "QUESTION" and place.word.kind == "MINUS":
        return place.given_up("unexpected `?-`", "a goal is written `?name(R, 3).`", place.words[0], place.word)
    return None


def _foreign_item(place: MisfitContext) -> Habit | None:
    first = place.words[0]
    if place.at != 1 or place.word.kind not in {"NAME", "VARIABLE", "STRING", "NOT", "LBRACE"}:
        return None
    if first.text in RULE_WORDS:
        return place.given_up(f"unexpected {quoted(first)}", RULE, first)
    is_equation = place.word.kind == "VARIABLE" and place.kind(1) == "EQ" and "ARROW" in place.item_kinds
    if first.text in {"let", "var"} and is_equation:
        return None
    hint = FOREIGN_ITEMS.get(first.text)
    return None if hint is None else place.given_up(f"unexpected {quoted(first)}", hint, first)


def _reserved(place: MisfitContext) -> Habit | None:
    """`order(R, 1).`"""
    first = place.words[0]
    if place.at != 1 or place.word.kind != "LPAR" or first.text not in RESERVED:
        return None
    message = f"{quoted(first)} is a reserved word and names nothing"
    return place.given_up(message, "choose another", first)._replace(code="E006")


def _declared_kind(place: MisfitContext) -> Habit | None:
    """`type persistent edge(...)`."""
    if place.at != 2 or place.kind(-2) != "TYPE" or place.word.kind != "NAME":
        return None
    kind, name = place.words[1:3]
    if kind.text in {"persistent", "permanent", "static"}:
        hint = f"`type !{name.text}(...)` declares a persistent fact"
        return place.meant(f"unexpected {quoted(kind)}", hint, kind, kind, ("BANG", "!"))
    if kind.text in {"linear", "temporary", "fact", "predicate", "route"}:
        hint = f"`type {name.text}(...)` declares a temporary fact"
        return place.meant(f"unexpected {quoted(kind)}", hint, kind, kind)
    return None


def _attribute(place: MisfitContext) -> Habit | None:
    """`R.x`."""
    if place.word.kind != "DOT" or place.at + 1 >= len(place.words):
        return None
    before = place.words[place.at - 1]
    dot = place.word
    behind = place.words[place.at + 1]
    if before.kind not in {"VARIABLE", "ROBOT", "RSQB"} or behind.kind != "NAME" or not touch(before, dot, behind):
        return None
    message = f"unexpected `{place.text[before.start : behind.end]}`"
    hint = f"what is known of a robot are facts: `{behind.text}({before.text}, X)`"
    return place.given_up(message, hint, before, behind)


HABITS = (
    _reversed_rule,
    _zero_arrow,
    _query,
    _foreign_item,
    _reserved,
    _declared_kind,
    _attribute,
)
"""Habits in the order in which they are tried."""
