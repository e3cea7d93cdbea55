"""Syntax that other languages have (Prolog, Datalog, Meld, Python, C) and people type by habit.

Looked for only where a word does not fit, before the general repair (repair.py). Each habit is a function of the
item's words around the misfit. It answers with one message, the form that RMR has as the hint, and, where what was
meant is clear, with other words to read instead; else the item is given up.
"""

import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

from rmr.lang.grammar import END
from rmr.lang.lexer import BAD_NUMBER, QUOTED, Token
from rmr.lang.source import Span

LOOKED_AT_MAX = 300
"""Words of an item before the misfit: in longer ones no habits are looked for."""

REWRITTEN_MAX = 70
"""Characters of a rule that a hint shows rewritten."""

AGGREGATES = ("count", "sum", "min", "max", "collect")
OPENING = {"LPAR": 1, "LSQB": 1, "LBRACE": 1, "RPAR": -1, "RSQB": -1, "RBRACE": -1}
COMPARING = {"EQ", "NE", "LT", "LE", "GT", "GE"}
OPERANDS = {"VARIABLE", "INT", "FLOAT", "TIME", "RPAR", "RSQB"}
NUMBERS = {"INT", "FLOAT", "TIME"}

SECONDS = {"s", "sec", "secs", "second", "seconds"}
UNITS = {**dict.fromkeys(SECONDS, "s")}
UNITS |= dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms")
UNITS |= dict.fromkeys(("m", "min", "mins", "minute", "minutes"), "min")

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
"""Words with which other languages begin what RMR writes as a rule."""

RULE = "a rule is written `body -o head.`"


DIGITS_MAX = 30
"""Of a number in another notation; longer ones are not worked out."""

_DIGITS = re.compile(r"0[xX][0-9a-fA-F]+|0b[01]+|0o[0-7]+|[1-9][0-9]*(_[0-9]+)+")
_TIME = re.compile(r"([0-9]+(?:\.[0-9]+)?)([a-z]+)")


class Habit(NamedTuple):
    """What to say of a habit, and what to read instead."""

    message: str
    span: Span
    hint: str
    patch: tuple[int, int, tuple[Token, ...]] | None = None
    """From where to where these words stand instead; None: the item is given up."""
    doubtful: bool = False
    """The item may say something else than what is read instead."""


class Place(NamedTuple):
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


def habit(place: Place) -> Habit | None:
    """Return what is known of the misfit in `place`, or None."""
    return next((found for look in HABITS if (found := look(place)) is not None), None)


def _quoted(token: Token) -> str:
    return f"`{token.text}`"


def _touch(*tokens: Token) -> bool:
    """Whether words stand side by side without blanks."""
    return all(one.end == other.start for one, other in pairwise(tokens))


# ---- arrows, items


def _reversed_rule(place: Place) -> Habit | None:
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
    is_short = body and len(rule) <= REWRITTEN_MAX and "\n" not in rule
    hint = f"the body stands first: `{rule if is_short else 'body -o head.'}`"
    return place.given_up(f"unexpected `{place.text[first.start : last.end]}`", hint, first, last)


def _reversed_arrows(place: Place) -> Iterator[tuple[Token, Token]]:
    words = place.words
    if place.word.text == ":-":
        yield place.word, place.word
    for one, other in pairwise(words[: place.at + 1]):
        if one.kind == "LT" and other.kind == "MINUS" and _touch(one, other) and not place.is_in_head:
            yield one, other


def _zero_arrow(place: Place) -> Habit | None:
    if place.kind(-1) != "INT" or place.kind(-2) != "MINUS" or place.word.kind not in {"NAME", "QUESTION", "LBRACE"}:
        return None
    minus, zero = place.words[place.at - 2 : place.at]
    if zero.text != "0" or not _touch(minus, zero):
        return None
    return place.meant("unexpected `-0`", "the arrow is `-o`, with the letter o", minus, zero, ("ARROW", "-o"))


def _query(place: Place) -> Habit | None:
    if place.at == 1 and place.kind(-1) == "QUESTION" and place.word.kind == "MINUS":
        return place.given_up("unexpected `?-`", "a goal is written `?name(R, 3).`", place.words[0], place.word)
    return None


def _foreign_item(place: Place) -> Habit | None:
    first = place.words[0]
    if place.at != 1 or place.word.kind not in {"NAME", "VARIABLE", "STRING", "NOT", "LBRACE"}:
        return None
    if first.text in RULE_WORDS:
        return place.given_up(f"unexpected {_quoted(first)}", RULE, first)
    hint = FOREIGN_ITEMS.get(first.text)
    return None if hint is None else place.given_up(f"unexpected {_quoted(first)}", hint, first)


def _declared_kind(place: Place) -> Habit | None:
    """`type persistent edge(...)`."""
    if place.at != 2 or place.kind(-2) != "TYPE" or place.word.kind != "NAME":
        return None
    kind, name = place.words[1:3]
    if kind.text in {"persistent", "permanent", "static"}:
        hint = f"`type !{name.text}(...)` declares a persistent fact"
        return place.meant(f"unexpected {_quoted(kind)}", hint, kind, kind, ("BANG", "!"))
    if kind.text in {"linear", "temporary", "fact", "predicate", "route"}:
        hint = f"`type {name.text}(...)` declares a temporary fact"
        return place.meant(f"unexpected {_quoted(kind)}", hint, kind, kind)
    return None


def _attribute(place: Place) -> Habit | None:
    """`R.x`."""
    if place.word.kind != "DOT" or place.at + 1 >= len(place.words):
        return None
    before, dot, behind = place.words[place.at - 1], place.word, place.words[place.at + 1]
    if before.kind not in {"VARIABLE", "ROBOT", "RSQB"} or behind.kind != "NAME" or not _touch(before, dot, behind):
        return None
    message = f"unexpected `{place.text[before.start : behind.end]}`"
    hint = f"what is known of a robot are facts: `{behind.text}({before.text}, X)`"
    return place.given_up(message, hint, before, behind)


# ---- words between conditions


def _is(place: Place) -> Habit | None:
    word, previous = place.word, place.words[place.at - 1]
    if word.text not in {"is", "mod", "div", "rem"} or previous.kind not in OPERANDS or place.at == 0:
        return None
    if word.text == "is":
        hint = f"`=` gives a variable its value: `{previous.text} = ...`"
        return place.meant("unexpected `is`", hint, word, word, ("EQ", "="))
    if word.text == "div":
        hint = "`/` gives a float, `floor(X / Y)` an int"
        return place.given_up("unexpected `div`", hint)
    return place.meant(f"unexpected {_quoted(word)}", "the remainder is `X % Y`", word, word, ("MODULO", "%"))


def _semicolon(place: Place) -> Habit | None:
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
    hint = "write a rule for each case; between conditions, not facts, `||` is or"
    return place.meant(message, hint, word, word, ("COMMA", ","))._replace(doubtful=True)


def _not(place: Place) -> Habit | None:
    opening = place.unclosed()
    if place.word.kind == "COMMA" and opening and place.words[opening].kind == "LPAR":
        word = place.words[opening - 1]
        if word.kind == "NOT":
            hint = "`not a(R), not b(R)`: neither; to deny both together derive a fact from the two, and deny that"
            return place.given_up("`not` denies one fact, not several", hint, word)
    if place.kind(-1) == "NOT" and place.is_in_head and place.kind(-2) in {"ARROW", "COMMA", "THEN"}:
        hint = "a fact goes when a body uses it up: name it there, without `not` and `$`"
        return place.given_up("a head derives facts, not that there are none", hint, place.words[place.at - 1])
    if place.word.text in {"\\+", "~", "¬"}:
        message = f"unexpected {_quoted(place.word)}"
        return place.meant(message, "`not p(R)` holds if there is no such fact", place.word, place.word, ("NOT", "not"))
    return None


def _then(place: Place) -> Habit | None:
    if place.word.text in {"and", "&"} and place.kind(1) == "THEN":
        hint = "`a(R) then b(R)`: `then` stands alone between two steps"
        return place.meant(f"unexpected {_quoted(place.word)} before `then`", hint, place.word, place.word)
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


def _condition_in_head(place: Place) -> Habit | None:
    if not place.is_in_head or place.unclosed() is not None:
        return None
    first = place.words[place.at - 1] if place.kind(-1) == "NAME" else place.word
    hint = "name it in the body: `load(R, N), N > 2 -o ...`; one rule for each case"
    if first.text == "if" and place.word.kind in {"VARIABLE", "NAME", "NOT"}:
        return place.given_up("a head has no conditions", hint, first)
    follows = place.kind(1) in COMPARING | {"PLUS", "MINUS", "FOREIGN"} or place.kind(1) == "->"
    behind = place.words[place.at + 1].text if place.at + 1 < len(place.words) else ""
    if place.word.kind == "VARIABLE" and (follows or behind in {"is", ":="}):
        if behind in {"is", "=", ":=", "+=", "-="}:
            hint = "what is derived is worked out in its arguments, `load(R, N + 1)`, or in the body, `M = N + 1`"
            return place.given_up("a head derives facts, it sets no variable", hint)
        return place.given_up("a head has no conditions", hint)
    return None


def _ternary(place: Place) -> Habit | None:
    behind = [word.kind for word in place.words[place.at :]]
    has_colon = "COLON" in behind[: behind.index("DOT") if "DOT" in behind else None]
    if place.word.kind == "QUESTION" and place.kind(-1) in OPERANDS | {"NAME"} and has_colon:
        return place.given_up("unexpected `?`", "`if(C, X, Y)` is X if C is true, else Y")
    return None


def _chain(place: Place) -> Habit | None:
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


def _cut(place: Place) -> Habit | None:
    if place.kind(-1) == "BANG" and place.word.kind in {"ARROW", "COMMA", "DOT"}:
        bang = place.words[place.at - 1]
        return place.given_up("unexpected `!`", "`!` stands before a persistent fact, `!edge(A, B)`; drop it", bang)
    return None


# ---- names, numbers, texts


def _hyphen(place: Place) -> Habit | None:
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
    return kinds == ["NAME", "MINUS", "NAME"] and _touch(*words)


def _robot(place: Place) -> Habit | None:
    word = place.word
    if word.text != "@":
        return None
    behind = place.words[place.at + 1] if place.at + 1 < len(place.words) else word
    message, last = f"unexpected `{place.text[word.start : behind.end]}`", behind
    hint = "`@4` is robot 4; a variable for a robot has no `@`"
    if behind.kind == "VARIABLE":
        hint = f"a variable for a robot has no `@`; of the robot with number {behind.text}: `peer(R, B), "
        hint += f"id(B) = {behind.text}`"
    elif behind.kind == "NAME":
        hint = "`@4` is robot 4; for each other robot: `{B | peer(R, B) | ...(B)}`"
    return place.given_up(message, hint, word, last)


def _unit(place: Place) -> Habit | None:
    word, previous = place.word, place.words[place.at - 1]
    if word.kind == BAD_NUMBER and len(word.text) <= DIGITS_MAX and _DIGITS.fullmatch(word.text):
        value = str(int(word.text, 0))
        hint = f"ints are written in decimal digits: `{value}`"
        return place.meant(f"{_quoted(word)} is no number", hint, word, word, ("INT", value))
    if word.kind == BAD_NUMBER:
        match = _TIME.fullmatch(word.text)
        unit = UNITS.get(match[2]) if match else None
        if match is None or unit is None:
            return None
        time = f"{match[1]}{unit}"
        return place.meant(f"{_quoted(word)} is no number", f"`{time}`", word, word, ("TIME", time))
    if place.at and word.kind == "NAME" and word.text in UNITS and previous.kind in {"INT", "FLOAT"}:
        time = f"{previous.text}{UNITS[word.text]}"
        hint = f"`{time}`; a number alone is a number of seconds"
        return place.meant(f"unexpected {_quoted(word)}", hint, previous, word, ("TIME", time))
    return None


def _float(place: Place) -> Habit | None:
    """`.5` and `5.`"""
    if place.word.kind not in {"DOT", "RPAR", "COMMA"}:
        return None
    dot = place.word
    behind = place.words[place.at + 1] if place.at + 1 < len(place.words) else dot
    if dot.kind == "DOT" and behind.kind == "INT" and _touch(dot, behind) and place.kind(-1) not in OPERANDS:
        hint = f"digits stand on both sides of the point: `0.{behind.text}`"
        return place.meant(f"unexpected `.{behind.text}`", hint, dot, behind, ("FLOAT", f"0.{behind.text}"))
    before = place.words[place.at - 1]
    if dot.kind == "DOT" and before.kind == "INT" and _touch(before, dot) and behind.kind in {"RPAR", "COMMA"}:
        hint = f"digits stand on both sides of the point: `{before.text}.0`"
        return place.meant(f"unexpected `{before.text}.`", hint, before, dot, ("FLOAT", f"{before.text}.0"))
    return None


def _division(place: Place) -> Habit | None:
    """`N // 2`, the rest of whose line is a comment."""
    for one, other in pairwise(place.words[: place.at + 1]):
        gap = place.text[one.end : other.start]
        if one.kind in OPERANDS and re.match(r" *//+ *([0-9]+|[A-Z][A-Za-z0-9_]*)\b", gap):
            start = one.end + gap.index("//")
            span = Span(place.file, start, start + 2)
            return Habit("`//` begins a comment", span, "`/` gives a float, `floor(X / Y)` an int")
    return None


def _empty(place: Place) -> Habit | None:
    """`body -o .` and `type name.`"""
    if place.word.kind == "DOT" and place.kind(-1) == "ARROW":
        return place.given_up("this rule derives nothing", "if that is meant write `-o 1.`", place.words[place.at - 1])
    if place.word.kind == "DOT" and place.words[0].kind == "TYPE" and place.kind(-1) == "NAME":
        name = place.words[place.at - 1]
        hint = f"the first one is a robot: `type {name.text}(robot).`"
        return place.given_up(f"{_quoted(name)} has no arguments", hint, name)
    return None


def _remainder(place: Place) -> Habit | None:
    if place.kind(-1) == "MODULO" and place.kind(-2) in OPERANDS:
        hint = "the remainder is `X % Y`; comments begin with `//`"
        return place.given_up("`%` has nothing behind it to divide by", hint, place.words[place.at - 1])
    return None


def _quotes(place: Place) -> Habit | None:
    word = place.word
    if word.kind != QUOTED:
        return None
    inner = word.text[1:-1]
    symbol = f"a symbol has no quotes, `{inner}`; " if re.fullmatch(r"[a-z][A-Za-z0-9_]*", inner) else ""
    return place.given_up(f"unexpected {_quoted(word)}", f'{symbol}a text has straight double ones, `"{inner}"`')


# ---- brackets


def _aggregate(place: Place) -> Habit | None:
    opening = place.unclosed()
    if opening is None or place.words[opening].kind != "LSQB":
        return None
    inner = place.words[opening + 1 : place.at]
    bars, gives = [sum(word.text == sign for word in inner) for sign in ("|", "=>")]
    operator = inner[0].text if inner and inner[0].kind == "NAME" else ""
    form = f"[{operator or 'count'}{'' if operator in {'count', ''} else ' X'} => V | body | head]"
    if not place.is_in_head and operator in AGGREGATES and place.word.text in {"=>", "|"}:
        hint = f"derive a fact by it in one rule, `... -o {form}.`, and read that in another"
        return place.given_up("an aggregate stands in a head, not in a body", hint, place.words[opening])
    if place.word.text == "|" and operator in AGGREGATES and not gives:
        return place.given_up("this aggregate does not name its result", f"it is written `{form}`", inner[0])
    if place.word.text in {",", "then"} and gives and bars >= 2:
        hint = f"derive one, `{form}`, and let another rule turn it into several"
        return place.given_up("an aggregate derives one fact, not several", hint)
    if place.word.text == "]" and gives and bars < 2:
        return place.given_up("this aggregate derives nothing", f"it is written `{form}`")
    return None


def _comprehension(place: Place) -> Habit | None:
    opening = place.unclosed()
    if opening is None or place.words[opening].kind != "LBRACE" or opening != place.at - 1:
        return None
    if place.word.kind == "NAME" and place.kind(1) in {"COMMA", "VBAR"}:
        name = place.word.text
        hint = f"variables begin with an upper-case letter: `{name[0].upper()}{name[1:]}`"
        return place.given_up(f"{_quoted(place.word)} is a symbol, where a variable is needed", hint)
    if place.word.kind in {"NAME", "RBRACE", "BANG", "DOLLAR"}:
        hint = "it is written `{B | edge(R, B) | ready(B)}`: variables, body, head"
        return place.given_up("a comprehension begins with its new variables", hint)
    return None


def _assertion(place: Place) -> Habit | None:
    first = 2 if [word.kind for word in place.words[1:2]] == ["COLON"] else 0
    if len(place.words) <= first or place.words[first].kind not in {"ASSERT", "WATCH"} or place.at <= first + 1:
        return None
    if place.unclosed() != first + 1:
        return None
    word, previous = place.word, place.words[place.at - 1]
    is_argument = previous.kind in {"LPAR", "COMMA"} and word.kind in {*NUMBERS, "MINUS", "STRING", "VARIABLE"}
    if not is_argument and word.kind not in {"RPAR", "COMMA"}:
        return None
    name = place.words[first].text
    message = f"`{name}` takes a start fact, a finish fact, a deadline and a violation, in this order"
    hint = f"`{name}(offline(R, L), online(R, L), 10, broadcast(R)).`"
    return place.given_up(message, hint)


HABITS: tuple[Callable[[Place], Habit | None], ...] = (
    _reversed_rule,
    _zero_arrow,
    _query,
    _foreign_item,
    _declared_kind,
    _is,
    _semicolon,
    _not,
    _then,
    _condition_in_head,
    _unit,
    _float,
    _attribute,
    _ternary,
    _chain,
    _cut,
    _hyphen,
    _robot,
    _remainder,
    _quotes,
    _aggregate,
    _comprehension,
    _assertion,
    _empty,
    _division,
)
