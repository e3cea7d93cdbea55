"""Syntax that other languages have (Prolog, Datalog, Meld, Python, C) and people type by habit.

Habits are looked for where a token does not fit, before the general repair (`rmr.lang.read.repair`). Each is a
function of the item's tokens around the unexpected one. It answers with one message, the form that RMR has as the
hint, and, where what was meant is clear, with other tokens to read instead; else the item is given up.
"""

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from rmr.lang.read.grammar import END
from rmr.lang.read.lexer import BAD_NUMBER, QUOTED, Token
from rmr.lang.read.misfit import OR_HINT
from rmr.lang.read.source_text import Span
from rmr.lang.read.tree_builder import RESERVED

LOOKED_AT_MAX = 300
"""Largest number of tokens before the unexpected token for which habits are searched; habits scan all of them."""

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


# ---- whole items: rules the other way round, directives, queries, other tokens for declarations

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


# ---- between the conjuncts of a body and the parts of a head

COMPARING = {"EQ", "NE", "LT", "LE", "GT", "GE"}


def _is(place: MisfitContext) -> Habit | None:
    word = place.word
    previous = place.words[place.at - 1]
    if word.text not in {"is", "mod", "div", "rem"} or previous.kind not in OPERANDS or place.at == 0:
        return None
    if word.text == "is":
        hint = f"`=` gives a variable its value: `{previous.text} = ...`"
        return place.meant("unexpected `is`", hint, word, word, ("EQ", "="))
    if word.text == "div":
        hint = "`/` gives a float, `floor(X / Y)` an int"
        return place.given_up("unexpected `div`", hint)
    return place.meant(f"unexpected {quoted(word)}", "the remainder is `X % Y`", word, word, ("MODULO", "%"))


def _let(place: MisfitContext) -> Habit | None:
    """`p(R, N), let M = N + 1 -o ...`"""
    if place.at == 0 or place.is_in_head or place.word.kind not in {"VARIABLE", "NAME"} or place.kind(1) != "EQ":
        return None
    word = place.words[place.at - 1]
    if word.text not in {"let", "var"}:
        return None
    name = place.word.text[0].upper() + place.word.text[1:]
    hint = f"an equation gives a variable its value: `{name} = ...`"
    if place.word.kind == "NAME":
        return place.given_up(f"unexpected {quoted(word)}", hint, word)
    return place.meant(f"unexpected {quoted(word)}", hint, word, word)


def _let_without_in(place: MisfitContext) -> Habit | None:
    """`p(R, N), let M = N + 1, M > 2 -o ...`"""
    index = place.before("LET")
    if index is None or any(word.kind == "IN" for word in place.words[index : place.at]):
        return None
    name = place.words[index + 1].text
    hint = f"an equation gives a variable its value: `{name} = ...`"
    return place.given_up("unexpected `let`", hint, place.words[index])


def _choice_of_facts(place: MisfitContext) -> Habit | None:
    """`-o if(N > 2, stop(R), go(R))`."""
    opening = place.unclosed()
    if place.word.kind != "COMMA" or not place.is_in_head or not opening or place.kind(opening - 1 - place.at) != "IF":
        return None
    hint = "write `if N > 2 then stop(R) else go(R) end`"
    return place.given_up("`if(C, X, Y)` chooses between values, not between facts", hint, place.words[opening - 1])


def _semicolon(place: MisfitContext) -> Habit | None:
    word = place.word
    if word.text != ";":
        return None
    message = "unexpected `;`"
    following = place.words[place.at + 1] if place.at + 1 < len(place.words) else word
    ends = following.kind == END or "\n" in place.text[word.end : following.start]
    if place.at == 0:
        return place.meant(message, "every item ends with `.`", word, word)
    if place.unclosed() is not None:
        if not place.is_closed_behind:
            return None
        return place.meant(message, "`,` stands between arguments", word, word, ("COMMA", ","))
    if ends:
        return place.meant(message, "every item ends with `.`", word, word, ("DOT", "."))
    if place.is_in_head:
        return place.meant(message, "`,` stands between what a head derives", word, word, ("COMMA", ","))
    return place.meant(message, OR_HINT, word, word, ("COMMA", ","))._replace(uncertain=True)


def _not(place: MisfitContext) -> Habit | None:
    if place.kind(-1) == "NOT" and place.is_in_head and place.kind(-2) in {"ARROW", "COMMA", "THEN"}:
        hint = "a fact goes when a body uses it up: name it there, without `not` and `$`"
        return place.given_up("a head derives facts, not that there are none", hint, place.words[place.at - 1])
    if place.word.text in {"\\+", "~", "¬"}:
        message = f"unexpected {quoted(place.word)}"
        return place.meant(message, "`not p(R)` holds if there is no such fact", place.word, place.word, ("NOT", "not"))
    return None


def _then(place: MisfitContext) -> Habit | None:
    if place.word.text in {"and", "&"} and place.kind(1) == "THEN":
        hint = "`a(R) then b(R)`: `then` stands alone between two steps"
        return place.meant(f"unexpected {quoted(place.word)} before `then`", hint, place.word, place.word)
    if place.kind(-1) == "THEN":
        then = place.words[place.at - 1]
        if place.kind(-2) == "COMMA" and place.word.kind == "NAME":
            comma = place.words[place.at - 2]
            hint = "`a(R) then b(R)`: no comma stands before or behind `then`"
            return place.meant("unexpected `,` before `then`", hint, comma, comma)
        if place.word.kind == "COMMA":
            hint = "`a(R) then b(R)`: no comma stands before or behind `then`"
            return place.meant("unexpected `,` behind `then`", hint, place.word, place.word)
        if place.kind(-2) == "ARROW":
            hint = "`a(R) then b(R)`: `then` stands between two steps"
            return place.meant("unexpected `then`", hint, then, then)
    if place.word.kind == "THEN" and not place.is_in_head:
        return place.given_up("unexpected `then`", f"{RULE}; `then` stands between steps of a head")
    return None


def _condition_in_head(place: MisfitContext) -> Habit | None:
    if not place.is_in_head or place.unclosed() is not None:
        return None
    hint = "name it in the body, `load(R, N), N > 2 -o ...`, or write `if N > 2 then ... else ... end`"
    follows = place.kind(1) in COMPARING | {"PLUS", "MINUS", "FOREIGN"} or place.kind(1) == "->"
    behind = place.words[place.at + 1].text if place.at + 1 < len(place.words) else ""
    if place.word.kind == "VARIABLE" and (follows or behind in {"is", ":="}):
        if behind in {"++", "--"}:
            hint = f"what is derived is worked out in its arguments: `load(R, {place.word.text} {behind[0]} 1)`"
            return place.given_up("a head derives facts, it sets no variable", hint)
        if behind in {"is", "=", ":=", "+=", "-="}:
            hint = "what is derived is worked out in its arguments, `load(R, N + 1)`, or in the body, `M = N + 1`"
            return place.given_up("a head derives facts, it sets no variable", hint)
        return place.given_up("a head has no conditions", hint)
    return None


def _ternary(place: MisfitContext) -> Habit | None:
    behind = [word.kind for word in place.words[place.at :]]
    has_colon = "COLON" in behind[: behind.index("DOT") if "DOT" in behind else None]
    if place.word.kind == "QUESTION" and place.kind(-1) in OPERANDS | {"NAME"} and has_colon:
        return place.given_up("unexpected `?`", "`if(C, X, Y)` is X if C is true, else Y")
    return None


def _chain(place: MisfitContext) -> Habit | None:
    if place.word.kind not in COMPARING:
        return None
    for index in range(place.at - 1, -1, -1):
        word = place.words[index]
        if word.kind in COMPARING:
            hint = "write each of them: `0 < N, N < 9`"
            return place.given_up("comparisons do not chain", hint)
        if word.kind not in {"VARIABLE", "INT", "FLOAT", "NAME", "PLUS", "MINUS", "TIMES"}:
            return None
    return None


def _cut(place: MisfitContext) -> Habit | None:
    if place.kind(-1) == "BANG" and place.word.kind in {"ARROW", "COMMA", "DOT"}:
        bang = place.words[place.at - 1]
        return place.given_up("unexpected `!`", "`!` stands before a persistent fact, `!edge(A, B)`; drop it", bang)
    return None


# ---- single tokens: names, robots, numbers, times, texts

SECONDS = {"s", "sec", "secs", "second", "seconds"}
UNITS = {**dict.fromkeys(SECONDS, "s")}
UNITS |= dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms")
UNITS |= dict.fromkeys(("m", "min", "mins", "minute", "minutes"), "min")

DIGITS_MAX = 30
"""Of a number in another notation; longer ones are not worked out."""

_DIGITS = re.compile(r"0[xX][0-9a-fA-F]+|0b[01]+|0o[0-7]+|[1-9][0-9]*(_[0-9]+)+")
_TIME = re.compile(r"([0-9]+(?:\.[0-9]+)?)([a-z]+)")


def _hyphen(place: MisfitContext) -> Habit | None:
    """`left-arm`."""
    words = place.words
    for start in range(min(place.at, len(words) - 1) + 1):
        end = start
        while end + 2 < len(words) and _is_hyphenated(words[end : end + 3]):
            end += 2
        if end == start:
            continue
        is_called = end + 1 < len(words) and words[end + 1].kind == "LPAR"
        if is_called or start < place.at <= end:
            name = "_".join(word.text for word in words[start : end + 1 : 2])
            message = f"`{place.text[words[start].start : words[end].end]}`: a name has no hyphen"
            return place.meant(message, f"`{name}`", words[start], words[end], ("NAME", name))
    return None


def _is_hyphenated(words: list[Token]) -> bool:
    kinds = [word.kind for word in words]
    return kinds == ["NAME", "MINUS", "NAME"] and touch(*words)


def _robot(place: MisfitContext) -> Habit | None:
    word = place.word
    if word.text != "@":
        return None
    behind = place.words[place.at + 1] if place.at + 1 < len(place.words) else word
    message = f"unexpected `{place.text[word.start : behind.end]}`"
    last = behind
    hint = "`@4` is robot 4; a variable for a robot has no `@`"
    if behind.kind == "VARIABLE":
        hint = f"a variable for a robot has no `@`; of the robot with number {behind.text}: `peer(R, B), "
        hint += f"id(B) = {behind.text}`"
    elif behind.kind == "NAME":
        hint = "`@4` is robot 4; for each other robot: `{B | peer(R, B) | ...(B)}`"
    return place.given_up(message, hint, word, last)


def _unit(place: MisfitContext) -> Habit | None:
    word = place.word
    previous = place.words[place.at - 1]
    if word.kind == BAD_NUMBER and len(word.text) <= DIGITS_MAX and _DIGITS.fullmatch(word.text):
        value = str(int(word.text, 0))
        hint = f"ints are written in decimal digits: `{value}`"
        return place.meant(f"{quoted(word)} is no number", hint, word, word, ("INT", value))
    if word.kind == BAD_NUMBER:
        match = _TIME.fullmatch(word.text)
        unit = UNITS.get(match[2]) if match else None
        if match is None or unit is None:
            return None
        time = f"{match[1]}{unit}"
        return place.meant(f"{quoted(word)} is no number", f"`{time}`", word, word, ("TIME", time))
    if place.at and word.kind == "NAME" and word.text in UNITS and previous.kind in {"INT", "FLOAT"}:
        time = f"{previous.text}{UNITS[word.text]}"
        hint = f"`{time}`; a number alone is a number of seconds"
        return place.meant(f"unexpected {quoted(word)}", hint, previous, word, ("TIME", time))
    return None


def _float(place: MisfitContext) -> Habit | None:
    """`.5` and `5.`"""
    if place.word.kind not in {"DOT", "RPAR", "COMMA"}:
        return None
    dot = place.word
    behind = place.words[place.at + 1] if place.at + 1 < len(place.words) else dot
    if dot.kind == "DOT" and behind.kind == "INT" and touch(dot, behind) and place.kind(-1) not in OPERANDS:
        hint = f"digits stand on both sides of the point: `0.{behind.text}`"
        return place.meant(f"unexpected `.{behind.text}`", hint, dot, behind, ("FLOAT", f"0.{behind.text}"))
    before = place.words[place.at - 1]
    if dot.kind == "DOT" and before.kind == "INT" and touch(before, dot) and behind.kind in {"RPAR", "COMMA"}:
        hint = f"digits stand on both sides of the point: `{before.text}.0`"
        return place.meant(f"unexpected `{before.text}.`", hint, before, dot, ("FLOAT", f"{before.text}.0"))
    return None


def _division(place: MisfitContext) -> Habit | None:
    """`N // 2`, the rest of whose line is a comment."""
    for one, other in pairwise(place.words[: place.at + 1]):
        gap = place.text[one.end : other.start]
        if one.kind in OPERANDS and re.match(r" *//+ *([0-9]+|[A-Z][A-Za-z0-9_]*)\b", gap):
            start = one.end + gap.index("//")
            span = Span(place.file, start, start + 2)
            return Habit("`//` begins a comment", span, "`/` gives a float, `floor(X / Y)` an int")
    return None


def _empty(place: MisfitContext) -> Habit | None:
    """`body -o .` and `type name.`"""
    if place.word.kind == "DOT" and place.kind(-1) == "ARROW":
        return place.given_up("this rule derives nothing", "if that is meant write `-o 1.`", place.words[place.at - 1])
    if place.word.kind == "DOT" and place.words[0].kind == "TYPE" and place.kind(-1) == "NAME":
        name = place.words[place.at - 1]
        hint = f"the first one is a robot: `type {name.text}(robot).`"
        return place.given_up(f"{quoted(name)} has no arguments", hint, name)
    return None


def _remainder(place: MisfitContext) -> Habit | None:
    if place.kind(-1) == "MODULO" and place.kind(-2) in OPERANDS:
        hint = "the remainder is `X % Y`; comments begin with `//`"
        return place.given_up("`%` has nothing behind it to divide by", hint, place.words[place.at - 1])
    return None


def _quotes(place: MisfitContext) -> Habit | None:
    word = place.word
    if word.kind != QUOTED:
        return None
    inner = word.text[1:-1]
    symbol = f"a symbol has no quotes, `{inner}`; " if re.fullmatch(r"[a-z][A-Za-z0-9_]*", inner) else ""
    return place.given_up(f"unexpected {quoted(word)}", f'{symbol}a text has straight double ones, `"{inner}"`')


# ---- within brackets: aggregates, comprehensions, the arguments of time assertions

AGGREGATES = ("count", "sum", "min", "max", "collect")


def _aggregate(place: MisfitContext) -> Habit | None:
    opening = place.unclosed()
    if opening is None or place.words[opening].kind != "LSQB":
        return None
    inner = place.words[opening + 1 : place.at]
    bars, gives = [sum(word.text == sign for word in inner) for sign in ("|", "=>")]
    operator = inner[0].text if inner and inner[0].kind == "NAME" else ""
    form = f"[{operator or 'count'}{'' if operator in {'count', ''} else ' X'} => V | body | head]"
    is_first = place.at == opening + 2 and place.word.kind == "VARIABLE"
    if not place.is_in_head and operator in AGGREGATES and (is_first or place.word.text in {"=>", "|"}):
        message = "an aggregate in brackets stands in a head, not in a body"
        return place.given_up(message, aggregate_hint(operator), place.words[opening])
    if place.word.text == "|" and operator in AGGREGATES and not gives:
        return place.given_up("this aggregate does not name its result", f"it is written `{form}`", inner[0])
    if place.word.text == "]" and gives and bars < 2:
        return place.given_up("this aggregate derives nothing", f"it is written `{form}`")
    return None


def _aggregate_behind(place: MisfitContext) -> Habit | None:
    """`[count | near(R, B)] => N`."""
    if place.word.text != "=>" or place.kind(-1) != "RSQB":
        return None
    opening = place.before("LSQB")
    operator = "" if opening is None else place.words[opening + 1].text
    if opening is None or operator not in AGGREGATES:
        return None
    return place.given_up("this aggregate names its result behind the brackets", aggregate_hint(operator))


def aggregate_hint(operator: str) -> str:
    """Return how an aggregate is written and read."""
    call = f"V = {operator}({'' if operator == 'count' else 'X, '}...)"
    form = f"[{operator}{'' if operator == 'count' else ' X'} => V | body | head]"
    return f"in a body it is `{call}`, in a head `{form}`"


def _comprehension(place: MisfitContext) -> Habit | None:
    opening = place.unclosed()
    if opening is None or place.words[opening].kind != "LBRACE" or opening != place.at - 1:
        return None
    if place.word.kind == "NAME" and place.kind(1) in {"COMMA", "VBAR"}:
        name = place.word.text
        hint = f"variables begin with an upper-case letter: `{name[0].upper()}{name[1:]}`"
        return place.given_up(f"{quoted(place.word)} is a symbol, where a variable is needed", hint)
    if place.word.kind in {"NAME", "RBRACE", "BANG", "DOLLAR"}:
        hint = "it is written `{B | edge(R, B) | ready(B)}`: variables, body, head"
        return place.given_up("a comprehension begins with its new variables", hint)
    return None


def _assertion(place: MisfitContext) -> Habit | None:
    first = 2 if [word.kind for word in place.words[1:2]] == ["COLON"] else 0
    if len(place.words) <= first or place.words[first].kind not in {"ASSERT", "WATCH"} or place.at <= first + 1:
        return None
    if place.unclosed() != first + 1:
        return None
    word = place.word
    previous = place.words[place.at - 1]
    is_argument = previous.kind in {"LPAR", "COMMA"} and word.kind in {*NUMBERS, "MINUS", "STRING", "VARIABLE"}
    if not is_argument and word.kind not in {"RPAR", "COMMA"}:
        return None
    name = place.words[first].text
    message = f"`{name}` takes a start fact, a finish fact, a deadline and a violation, in this order"
    hint = f"`{name}(offline(R, L), online(R, L), 10, broadcast(R)).`"
    return place.given_up(message, hint)


HABITS = (
    _reversed_rule,
    _zero_arrow,
    _query,
    _foreign_item,
    _reserved,
    _declared_kind,
    _attribute,
    _is,
    _let,
    _let_without_in,
    _choice_of_facts,
    _semicolon,
    _not,
    _then,
    _condition_in_head,
    _ternary,
    _chain,
    _cut,
    _unit,
    _float,
    _hyphen,
    _robot,
    _remainder,
    _quotes,
    _empty,
    _division,
    _aggregate,
    _aggregate_behind,
    _comprehension,
    _assertion,
)
"""Habits in the order in which they are tried."""


def habit(place: MisfitContext) -> Habit | None:
    """Return the first habit that explains the unexpected token in `place`, or None."""
    return next((found for look in HABITS if (found := look(place)) is not None), None)
