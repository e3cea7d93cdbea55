"""Habits of single tokens: names, robots, numbers, times, texts."""

import re
from itertools import pairwise

from rmr.lang.read.habits.item_words import OPERANDS, Habit, MisfitContext, quoted, touch
from rmr.lang.read.lexer import BAD_NUMBER, QUOTED, Token
from rmr.lang.read.source_text import Span

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


HABITS = (
    _unit,
    _float,
    _hyphen,
    _robot,
    _remainder,
    _quotes,
    _empty,
    _division,
)
"""Habits in the order in which they are tried."""
